"""Extraction rollouts: a gripper grasps the block that sticks out and pulls it over T actions (paper, section II-C)."""

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from jenga_data.collect.config import NOBODY, PULL_FRAMES, Actor, ExtractionConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.observe import let_sleep, observe
from jenga_data.collect.recording import Recording
from jenga_data.collect.rollout import OpenLog, header_of
from jenga_data.collect.stage import Stage, set_stage
from jenga_data.episode import Result
from jenga_data.errors import UnreachableError
from jenga_data.sim.gripper import Gripper, add_gripper
from jenga_data.sim.scene import add_tower, base_spec, xml_with_start
from jenga_data.sim.world import World
from jenga_data.tower import TowerState

MAX_STEP_CHANGE = 0.013
"""a_x may change by so much from one period to the next [m]: 13 m/s^2, the arm's limit, over 32 ms."""
LIMITS = np.array([0.02, 0.001, 0.001])
"""Largest displacement a period along x, y, z [m] (paper, sections II-A and II-C)."""

_APPROACH = 0.04
_APPROACH_FRAMES = 10
_GRASP_FRAMES = 8
SLIP = 0.005
"""What moves by more in the fingers is not held [m]."""
_AWAY = 0.05
"""A controller stops when the target is clear by so much [m]: nothing can fall onto it."""


@runtime_checkable
class Hand(Protocol):
    """What pulls: a gripper that floats, or an arm's."""

    @property
    def position(self) -> Float[np.ndarray, "3"]: ...
    def begin(self, displacement: Float[np.ndarray, "3"]) -> None: ...


@runtime_checkable
class Policy(Protocol):
    """Chooses the displacement of the end effector for the next control period."""

    def act(self, state: TowerState, target: int) -> Float[np.ndarray, "3"]: ...


class RandomPull:
    """Pulls along -x at a speed drawn for the episode, with noise: what the dynamics data are made of."""

    def __init__(self, config: ExtractionConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._rng = rng
        self._mean = float(np.exp(rng.uniform(np.log(config.slowest), np.log(config.fastest))))

    def act(self, state: TowerState, target: int) -> Float[np.ndarray, "3"]:
        forward = self._mean * (1 + self._config.speed_noise * self._rng.normal())
        return np.array([-forward, *self._rng.uniform(-self._config.side, self._config.side, 2)])


def executable(wanted: Float[np.ndarray, "3"], previous: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The nearest action that the arm can make: within the paper's limits, and within the arm's acceleration."""
    action = np.clip(wanted, -LIMITS, LIMITS)
    action[0] = np.clip(action[0], previous[0] - MAX_STEP_CHANGE, previous[0] + MAX_STEP_CHANGE)
    return action


def run_extraction(
    config: ExtractionConfig,
    seed: int,
    number: int,
    open_log: OpenLog,
    policy: Policy | None = None,
    actor: Actor = NOBODY,
) -> Result:
    """Run one rollout and log it.

    Args:
        policy: who pulls, named by `actor`, and no longer than it takes to get the block clear; without one a
            `RandomPull` makes all T actions.
    """
    stage = set_stage(config, seed, number)
    puller = policy or RandomPull(config, episode_rng(seed, number, "policy"))
    pull = Pull(puller, all_actions=policy is None)
    if config.body == "robot":
        from jenga_data.collect.robot_extraction import run_with_robot  # loads inverse kinematics

        return run_with_robot(config, seed, number, stage, open_log, pull, actor)
    return _run_with_gripper(config, seed, number, stage, open_log, pull, actor)


def _run_with_gripper(
    config: ExtractionConfig, seed: int, number: int, stage: Stage, open_log: OpenLog, pull: "Pull", actor: Actor
) -> Result:
    world, gripper = gripper_scene(config, stage)
    steps = config.physics.steps_a_frame
    header = header_of(config, seed, number, stage, actor)

    with open_log(header, xml_with_start(world.spec, world.data)) as log:
        recording = Recording(world, log, stage.target)

        def substep(i: int) -> None:
            gripper.drive(i / steps)
            world.step()
            if (i + 1) % config.physics.steps_a_touch == 0:
                recording.gripper(gripper.sample(recording.time_ns()))

        def hold(i: int) -> None:
            if i == 0:
                gripper.begin(np.zeros(3))
            substep(i)

        def move(displacement: Float[np.ndarray, "3"], frames: int) -> None:
            for _ in range(frames):
                gripper.begin(displacement / frames)
                recording.advance(substep, steps)

        world.allow_sleep(True)  # nothing touches the tower yet; the fingers will wake it
        recording.phase("approach")
        move(np.array([_APPROACH, 0.0, 0.0]), _APPROACH_FRAMES)
        move(np.zeros(3), 1)
        recording.phase("grasp")
        for frame in range(_GRASP_FRAMES):
            gripper.close((frame + 1) / _GRASP_FRAMES)
            move(np.zeros(3), 1)
        cause = "" if _holds(recording, gripper) else "grasp_missed"
        world.allow_sleep(False)
        if not cause:
            recording.phase("pull")
            cause = pull.run(recording, gripper, substep, steps)
        recording.phase("observe")
        observe(recording, config.physics, hold)
        return recording.finish(cause)


def gripper_scene(config: ExtractionConfig, stage: Stage) -> tuple[World, Gripper]:
    """The tower with the open gripper in front of the end that sticks out."""
    spec = base_spec(config.physics)
    add_tower(spec, stage.blocks, stage.state.pose, stage.target, config.physics)
    grasp = stage.state.pose[stage.target, :3].copy()
    grasp[0] -= stage.blocks.size[stage.target, 0] / 2 - config.sticks_out / 2
    add_gripper(spec, grasp - [_APPROACH, 0, 0], config.gripper, config.physics)
    world = World(spec, stage.blocks, stage.layout)
    return world, Gripper(world, config.gripper)


def _holds(recording: Recording, gripper: Gripper) -> bool:
    """Whether the fingers are as far apart as the target is wide: on it, and not on air or on two blocks."""
    width = recording.world.blocks.size[recording.target, 1]
    return bool(abs(gripper.width - width) < SLIP)


class Pull:
    """T actions of a policy, one a control step.

    It ends when the tower has collapsed or the target is well clear of it; `all_actions` makes them all, the hand at
    rest once the target is clear.
    """

    def __init__(self, policy: Policy, all_actions: bool) -> None:
        self._policy = policy
        self._all = all_actions

    def run(self, recording: Recording, hand: Hand, substep: Callable[[int], None], steps: int) -> str:
        """Execute the actions; returns the cause of a pull that went wrong."""
        held = recording.poses[-1][recording.target, :3] - hand.position
        action = np.zeros(3)
        for _ in range(PULL_FRAMES):
            away = recording.distance_clear() > _AWAY
            if recording.has_collapsed() or (away and not self._all):
                break
            wanted = self._policy.act(recording.world.tower_state(), recording.target)
            action = executable(np.zeros(3) if away else wanted, action)
            before, frame = hand.position, recording.frame
            try:
                hand.begin(action)
            except UnreachableError:
                return "out_of_reach"
            recording.advance(substep, steps)
            recording.action(frame, action, hand.position - before)
            if recording.clear_frame() >= 0:
                let_sleep(recording)
        slip = recording.poses[-1][recording.target, :3] - hand.position - held
        if np.linalg.norm(slip) > SLIP:
            return "slipped"
        stopped = recording.has_collapsed() or recording.clear_frame() >= 0
        return "" if stopped else "out_of_time"
