"""How many blocks of a fresh tower are movable: pushed with limited force they slide out without taking others along.

Robots and people find 47 % (the paper, after Fazeli et al., Science Robotics 2019), loose by hand test are 39 %:
53.7 % of the middle blocks and 31.6 % of those at the side (JengaRobot, 188 real layers).
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jenga_data.clock import CONTROL_STEP_NS
from jenga_data.collect.config import SpawnConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.rest import at_rest
from jenga_data.collect.stage import standing_tower
from jenga_data.outcome import THRESHOLDS, collapsed
from jenga_data.sim.physics import PhysicsConfig
from jenga_data.sim.scene import add_tower, base_spec
from jenga_data.sim.servo import BlockServo
from jenga_data.sim.world import World


@dataclass(frozen=True)
class PushConfig:
    """A push along a block's own axis, by a velocity servo at its centre."""

    force_limit: float = 1.5
    """The most force of the push [N]. A player feels for loose blocks with a fingertip's light touch, of one to two
    newtons; harder pushes are felt as resistance, and the block is left alone."""
    speed: float = 0.05
    """[m/s]"""
    distance: float = 0.02
    """How far the block has to get [m]."""
    others: float = 0.005
    """No other block may move by more [m]."""
    patience: float = 0.256
    """A block that does not get on by a millimetre in so long [s] is stuck."""
    gains: tuple[float, float] = (4.0, 400.0)
    """Proportional [N s/m] and integral [N/m] gain of the servo."""


@dataclass(frozen=True)
class MovableConfig:
    """The experiment: fresh towers, of which every block is pushed, one at a time."""

    push: PushConfig = field(default_factory=PushConfig)
    spawn: SpawnConfig = field(default_factory=lambda: SpawnConfig(last_round=1))
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)


_PROGRESS = 0.001
"""A block that slid so far [m] has broken away."""


def push_every_block(config: MovableConfig, seed: int, number: int) -> dict[str, Any]:
    """Push each block of one fresh tower, always from the same state.

    Returns:
        Lists with an entry a block: `level`, `slot`, `end` (movable, stuck, dragged, collapsed), `travel` and `moved`
        (of the block, and the most of any other) [mm], `breakaway` [N], the force at which it began to slide, NaN
        as None where it never did, and `load` [N], the computed weight on it.
    """
    rng = episode_rng(seed, number, "movable")
    state, tries = standing_tower(config.spawn, config.physics, 1, rng, name=f"seed {seed}, number {number}")
    spec = base_spec(config.physics)
    add_tower(spec, state.blocks, state.pose, target=-1, physics=config.physics)
    world = World(spec, state.blocks, state.layout)
    start = world.integration_state()
    sign = rng.choice([-1.0, 1.0], len(state.blocks))
    pushes = [_push(world, start, block, sign[block], config) for block in range(len(state.blocks))]
    return {
        "tower": state.blocks.tower,
        "tries": tries,
        "level": state.layout.level.tolist(),
        "slot": state.layout.slot.tolist(),
        **{name: [push[name] for push in pushes] for name in pushes[0]},
    }


def _push(world: World, start: np.ndarray, block: int, sign: float, config: MovableConfig) -> dict[str, Any]:
    push, physics = config.push, config.physics
    world.restore(start)
    along = np.zeros(3)
    along[world.layout.orientation[block]] = sign
    servo = BlockServo(world, block, push.gains, push.force_limit * np.abs(along))
    servo.command(push.speed * along)
    poses, travel, forces = [world.pose], [0.0], [0.0]
    end, held = "", 0
    patience = round(push.patience * 1e9 / CONTROL_STEP_NS)
    while not end:
        for _ in range(physics.steps_a_frame):
            servo.step()
            forces.append(servo.force @ along if travel[-1] < _PROGRESS else 0.0)
        poses.append(world.pose)
        travel.append(float((poses[-1][block, :3] - poses[0][block, :3]) @ along))
        if collapsed(poses[0], poses[-1], block, THRESHOLDS.drop):
            end = "collapsed"
        elif _moved(poses, block) > push.others:
            end = "dragged"
        elif travel[-1] >= push.distance or held:
            servo.let_go()
            held += 1
            end = "movable" if at_rest(poses[-held:]) or held * CONTROL_STEP_NS > 1e9 else ""
        elif len(travel) > patience and travel[-1] - travel[-1 - patience] < _PROGRESS:
            end = "stuck"
    return {
        "end": end,
        "travel": travel[-1] * 1e3,
        "moved": _moved(poses, block) * 1e3,
        "breakaway": max(forces) if max(travel) >= _PROGRESS else None,
    }


def _moved(poses: list[np.ndarray], block: int) -> float:
    """The most that another block is away from where it was [m]."""
    return float(np.delete(np.linalg.norm(poses[-1][:, :3] - poses[0][:, :3], axis=1), block).max())
