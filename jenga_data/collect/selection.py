"""Selection rollouts: pull a random legal target with a servo and see whether the tower fails (paper, section II-B)."""

from collections.abc import Callable
from contextlib import AbstractContextManager

import numpy as np

from jenga_data.collect.config import SelectionConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.observe import AFTERMATH_SECONDS, let_sleep, observe
from jenga_data.collect.recording import Recorder, Recording
from jenga_data.collect.rollout import OpenLog, header_of
from jenga_data.collect.stage import Stage, set_stage
from jenga_data.episode import CONTROL_STEP_NS, Result
from jenga_data.sim.scene import add_tower, base_spec, xml_with_start
from jenga_data.sim.servo import BlockServo
from jenga_data.sim.world import MakeWorld, World

_AWAY = 0.05
"""The servo carries a block that is clear on by this far [m], so that nothing falls onto it."""


def run_selection(config: SelectionConfig, seed: int, number: int, open_log: OpenLog) -> Result:
    """Run one rollout and log it."""
    stage = set_stage(config, seed, number)
    header = header_of(config, seed, number, stage)
    return pull(config, stage, episode_rng(seed, number, "noise"), lambda xml: open_log(header, xml))


def pull(
    config: SelectionConfig,
    stage: Stage,
    noise: np.random.Generator,
    open_log: Callable[[str], AbstractContextManager[Recorder]],
    sleep: bool = True,
    aftermath: float = AFTERMATH_SECONDS,
    make_world: MakeWorld = World,
) -> Result:
    """Pull the target of a stage and see what becomes of the tower.

    Args:
        noise: draws the speeds along y and z.
        open_log: given the scene's MJCF.
        sleep: whether the tower may sleep once it is at rest and the target clear or let go.
        aftermath: how long a collapse is shown [s].
        make_world: given the scene and its tower, for who wants to watch each step.
    """
    spec = base_spec(config.physics)
    add_tower(spec, stage.blocks, stage.state.pose, stage.target, config.physics)
    world = make_world(spec, stage.blocks, stage.layout)
    limits = np.array([config.force_limit, config.side_force_limit, config.side_force_limit])
    servo = BlockServo(world, stage.target, config.gains, limits)
    period = CONTROL_STEP_NS * 1e-9

    with open_log(xml_with_start(spec, world.data)) as log:
        recording = Recording(world, log, stage.target)
        recording.phase("pull")
        for _ in range(round(config.pull_seconds / period)):
            velocity = np.array([-config.speed, *noise.normal(0.0, config.noise, 2)])
            servo.command(velocity)
            before = recording.poses[-1]
            recording.advance(lambda _: servo.step(), config.physics.steps_a_frame)
            moved = recording.poses[-1][stage.target, :3] - before[stage.target, :3]
            recording.action(recording.frame - 1, velocity * period, moved)
            if recording.has_collapsed() or recording.distance_clear() > _AWAY:
                break
            if sleep and recording.clear_frame() >= 0:
                let_sleep(recording)
            ago = recording.frame - round(config.patience / period)
            if ago >= 0 and recording.target_x(ago) - recording.target_x() < config.least_progress:
                break
        servo.command(np.zeros(3))
        if recording.clear_frame() < 0:
            servo.let_go()
        recording.phase("observe")
        observe(recording, config.physics, lambda _: servo.step(), sleep, aftermath)
        return recording.finish()
