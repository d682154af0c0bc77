"""How many blocks of a fresh tower are movable: pushed with limited force they slide out without taking others along.

Robots and people find 47 % (the paper, after Fazeli et al., Science Robotics 2019), loose by hand test are 39 %:
53.7 % of the middle blocks and 31.6 % of those at the side (JengaRobot, 188 real layers).
"""

import math
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from jenga_data.calibrate import figures
from jenga_data.calibrate.run import Run, quantiles
from jenga_data.clock import CONTROL_STEP_NS
from jenga_data.collect.config import SpawnConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.rest import at_rest
from jenga_data.collect.stage import standing_tower
from jenga_data.errors import JengaError
from jenga_data.outcome import THRESHOLDS, collapsed
from jenga_data.report import markdown_table
from jenga_data.sim.physics import PhysicsConfig
from jenga_data.sim.scene import add_tower, base_spec
from jenga_data.sim.servo import BlockServo
from jenga_data.sim.world import World
from jenga_data.statistics import Proportion, proportion_over_towers
from jenga_data.tower import TowerState


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
    patience: float = 0.32
    """A block that does not get on by a millimetre in so long [s], and is pushed with all force, is stuck."""
    gains: tuple[float, float] = (2.0, 150.0)
    """Proportional [N s/m] and integral [N/m] gain of the servo: on a block that sticks the force starts at 0.1 N and
    rises by 7.5 N/s."""

    def __post_init__(self) -> None:
        if not 0 < self.force_limit < math.inf:
            raise JengaError(f"force-limit is {self.force_limit}; allowed: a positive number [N]")


@dataclass(frozen=True)
class MovableConfig:
    """The experiment: fresh towers, of which every block is pushed, one at a time."""

    push: PushConfig = field(default_factory=PushConfig)
    spawn: SpawnConfig = field(default_factory=lambda: SpawnConfig(last_round=1))
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)


_PROGRESS = 0.001
"""A block that slid so far [m] has broken away."""


PARTS = 3
"""Of a tower, so that even one is shared out between workers."""


def push_blocks(config: MovableConfig, seed: int, number: int, part: int) -> dict[str, Any]:
    """Push each block of a part (0 to `PARTS` - 1) of one fresh tower, always from the same state.

    Returns:
        The tower's name, and lists with an entry a block: `level`, `slot`, `end` (movable, stuck, dragged, collapsed),
        `travel` and `moved` (of the block, and the most of any other) [mm], `breakaway` [N], the force at which it
        began to slide, NaN as None where it never did.
    """
    rng = episode_rng(seed, number, "movable")
    state, tries = standing_tower(config.spawn, config.physics, 1, rng, name=f"seed {seed}, number {number}")
    world = _world_of(config, state)
    start = world.integration_state()
    sign = rng.choice([-1.0, 1.0], len(state.blocks))
    blocks = np.array_split(np.arange(len(state.blocks)), PARTS)[part]
    pushes = [_push(world, start, block, float(sign[block]), config) for block in blocks.tolist()]
    return {
        "tower": state.blocks.tower,
        "tries": tries,
        "level": state.layout.level[blocks].tolist(),
        "slot": state.layout.slot[blocks].tolist(),
        **{name: [push[name] for push in pushes] for name in pushes[0]},
    }


def push_block(config: MovableConfig, state: TowerState, block: int, sign: float) -> dict[str, Any]:
    """Push one block of a tower that stands, along its own x (`sign` 1) or against it (-1); as `push_blocks`."""
    world = _world_of(config, state)
    return _push(world, world.integration_state(), block, sign, config)


def _world_of(config: MovableConfig, state: TowerState) -> World:
    spec = base_spec(config.physics)
    add_tower(spec, state.blocks, state.pose, target=-1, physics=config.physics)
    return World(spec, state.blocks, state.layout)


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
            forces.append(float(servo.force @ along) if travel[-1] < _PROGRESS else 0.0)
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
        elif len(travel) > patience:
            gets_on = travel[-1] - travel[-1 - patience] >= _PROGRESS
            end = "" if gets_on or servo.force @ along < push.force_limit else "stuck"
    return {
        "end": end,
        "travel": travel[-1] * 1e3,
        "moved": _moved(poses, block) * 1e3,
        "breakaway": max(forces) if max(travel) >= _PROGRESS else None,
    }


def _moved(poses: list[np.ndarray], block: int) -> float:
    """The most that another block is away from where it was [m]."""
    return float(np.delete(np.linalg.norm(poses[-1][:, :3] - poses[0][:, :3], axis=1), block).max())


REAL_MOVABLE = {"movable": 0.47, "middle": 0.537, "side": 0.316}
"""The paper, after Fazeli et al. 2019 (movable in a fresh tower), and JengaRobot's hand test (loose, 188 layers)."""


def movable_report(run: Run, config: MovableConfig) -> dict[str, Any]:
    """Push every block of fresh towers."""
    cases = [
        (push_blocks, {"config": config, "seed": run.seed, "number": number, "part": part})
        for number in range(run.towers)
        for part in range(PARTS)
    ]
    results = run.cases("movable", cases)
    end = np.array([end for result in results for end in result["end"]])
    slot = np.array([slot for result in results for slot in result["slot"]])
    tower = np.repeat([result["tower"] for result in results], [len(result["end"]) for result in results])
    free, middle = end == "movable", slot == 1
    force = np.array([f for result in results for f in result["breakaway"]], float)
    report = {
        "movable": proportion_over_towers(free, tower),
        "middle": proportion_over_towers(free[middle], tower[middle]),
        "side": proportion_over_towers(free[~middle], tower[~middle]),
        "force_limit_n": config.push.force_limit,
        "friction": config.physics.friction,
        "towers": run.towers,
        "seed": run.seed,
        "ends": dict(sorted(Counter(end.tolist()).items())),
        "breakaway_n": quantiles(force[np.isfinite(force)]),
        "never_broke_away": Proportion.of(~np.isfinite(force)).as_dict(),
        "real": REAL_MOVABLE,
    }
    rows = [(name, report[name], REAL_MOVABLE[name]) for name in ("movable", "middle", "side")]
    text = (
        f"{run.towers} fresh towers, every block pushed with at most {config.push.force_limit} N at "
        f"{config.push.speed} m/s; friction {config.physics.friction}.\n\n"
        + markdown_table(("Blocks", "Movable here", "Real towers"), rows)
        + "\n"
        + markdown_table(("What became of a push", "Blocks"), list(report["ends"].items()))
        + "\n"
        + markdown_table(("Breakaway force", "N"), list(report["breakaway_n"].items()))
    )
    level = np.array([level for result in results for level in result["level"]])
    draw = partial(figures.movable, free, middle, level, force, config.push.force_limit, REAL_MOVABLE)
    return run.write("movable", report, text, draw)
