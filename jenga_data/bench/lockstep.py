"""An awake step as episodes make it, beside a bare `mj_step` of the same model from the same states."""

from dataclasses import dataclass
from time import thread_time_ns

import numpy as np
from jaxtyping import Float

from jenga_data.bench.trace import EpisodeTrace
from jenga_data.collect.config import SelectionConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.sim.scene import add_tower, base_spec
from jenga_data.sim.servo import BlockServo
from jenga_data.sim.traced import Twin
from jenga_data.sim.world import World

_MOST_STEPS = 256
"""Of a pull, from its start: as many as say what a step costs."""


@dataclass(frozen=True, eq=False)
class Lockstep:
    """CPU time of each step [s], and whether both ended in the same state, bit for bit."""

    own: Float[np.ndarray, " step"]
    bare: Float[np.ndarray, " step"]
    same: bool


def lockstep(config: SelectionConfig, seed: int, number: int, trace: EpisodeTrace) -> Lockstep:
    """Pull once more with the servo, each step beside one of MuJoCo alone under the force that the trace holds.

    Which of the two goes first changes from step to step, so that neither finds the warmer cache.
    """
    stage = trace.stage
    spec = base_spec(config.physics)
    add_tower(spec, stage.blocks, stage.state.pose, stage.target, config.physics)
    world = World(spec, stage.blocks, stage.layout)
    limits = np.array([config.force_limit, config.side_force_limit, config.side_force_limit])
    servo = BlockServo(world, stage.target, config.gains, limits)
    twin = Twin(world)
    noise = episode_rng(seed, number, "noise")

    def own_step(_: int) -> float:
        began = thread_time_ns()
        servo.step()
        return (thread_time_ns() - began) * 1e-9

    def bare_step(step: int) -> float:
        return twin.step(stage.target, trace.steps.force[step, stage.target])

    pulled = trace.steps_of("pull")
    times = np.zeros((min(pulled.stop - pulled.start, _MOST_STEPS), 2))
    for step in range(len(times)):
        if step % config.physics.steps_a_frame == 0:
            servo.command(np.array([-config.speed, *noise.normal(0.0, config.noise, 2)]))
        order = (0, 1) if step % 2 else (1, 0)
        for which in order:
            times[step, which] = (own_step, bare_step)[which](step)
    return Lockstep(times[:, 0], times[:, 1], twin.is_where(world))
