"""Whether a tower stands being turned: by half a turn, asleep, and then awake again."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from jenga_data.calibrate import figures
from jenga_data.calibrate.run import Run, quantiles
from jenga_data.collect.config import CollectConfig, SelectionConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.rest import at_rest
from jenga_data.collect.stage import standing_tower
from jenga_data.outcome import THRESHOLDS, collapsed
from jenga_data.report import markdown_table, number
from jenga_data.sim.physics import PhysicsConfig
from jenga_data.sim.scene import add_tower, base_spec
from jenga_data.sim.turntable import TURN_SECONDS, MinimumJerk, Turntable, friction_needed
from jenga_data.sim.world import World
from jenga_data.statistics import Proportion
from jenga_data.tower import TowerState, turn_poses

HALF_TURN = np.pi
_AFTER = 1.0
"""The tower is watched awake for so long after the turn [s]."""
_PATIENCE = 5.0
"""A tower that stood must fall asleep within this [s]."""


def turn_case(config: CollectConfig, seed: int, number: int = 0) -> dict[str, Any]:
    """One tower of round `config.spawn.last_round`, turned by 180 degrees in 4 s of simulated time.

    Returns:
        `round`; `displaced_mm`, the largest displacement of a block against the table during the turn [mm];
        `after_mm`, the largest in the second after it, awake [mm]; `unturned_mm`, the same of the same second had
        the tower not been turned; `fell`, whether a block dropped in the turn or after it; `friction`, the share of
        the friction that is there which the turn needs (`friction_needed`), None where it cannot be computed. Only
        `round` and `rested` where the tower creeps on and does not fall asleep.

    Raises:
        JengaError: no tower stood.
    """
    spawn, physics = config.spawn, config.physics
    name = f"seed {seed}, number {number}"
    state, _ = standing_tower(spawn, physics, spawn.last_round, episode_rng(seed, number, "turn"), name=name)
    spec = base_spec(physics)
    add_tower(spec, state.blocks, state.pose, target=-1, physics=physics)
    world = World(spec, state.blocks, state.layout)
    if not _fall_asleep(world, physics.steps_a_frame):
        return {"round": state.layout.round, "rested": False}
    before, unturned, turntable = world.tower_state(), world.integration_state(), Turntable(world)

    displaced, start = 0.0, turntable.angle
    for _ in turntable.turn(HALF_TURN, TURN_SECONDS):
        on_table = turn_poses(world.pose, start - turntable.angle)
        displaced = max(displaced, _farthest(on_table, before.pose))
    steps = round(_AFTER * 1e9 / physics.timestep_ns)
    after = world.pose
    last = _awake_for(world, steps)
    world.restore(unturned)
    creep = _farthest(_awake_for(world, steps), before.pose)
    return {
        "round": state.layout.round,
        "rested": True,
        "displaced_mm": displaced * 1e3,
        "after_mm": _farthest(last, after) * 1e3,
        "unturned_mm": creep * 1e3,
        "fell": any(collapsed(before.pose, pose, -1, THRESHOLDS.drop) for pose in (after, last)),
        "friction": _friction(before, physics),
    }


def _friction(state: TowerState, physics: PhysicsConfig) -> float | None:
    try:
        return friction_needed(state, MinimumJerk(HALF_TURN, TURN_SECONDS), physics)
    except ValueError:  # at the brink of its equilibrium, where creep and computation differ
        return None


def _awake_for(world: World, steps: int) -> Float[np.ndarray, "block 7"]:
    """The poses after so many steps in which nothing may sleep."""
    world.allow_sleep(False)
    world.step(steps)
    return world.pose


def _fall_asleep(world: World, steps_a_frame: int) -> bool:
    """Wait until the tower is at rest while awake, and then until it sleeps; whether it did."""
    poses = [world.pose]
    while not world.asleep:
        if world.time_ns > _PATIENCE * 1e9:
            return False
        world.step(steps_a_frame)
        poses.append(world.pose)
        if at_rest(poses):
            world.allow_sleep(True)
    return True


def _farthest(pose: Float[np.ndarray, "block 7"], other: Float[np.ndarray, "block 7"]) -> float:
    """Of all blocks the largest distance between two places [m]."""
    return float(np.linalg.norm(pose[:, :3] - other[:, :3], axis=1).max())


def turntable_report(run: Run, config: SelectionConfig, round_number: int) -> dict[str, Any]:
    """Turn towers of one round by half a turn."""
    spawn = replace(config.spawn, first_round=round_number, last_round=round_number)
    arguments = {"config": replace(config, spawn=spawn), "seed": run.seed}
    every = run.cases("turntable", [(turn_case, arguments | {"number": n}) for n in range(run.towers)])
    results = [result for result in every if result["rested"]]
    names = ("displaced_mm", "after_mm", "unturned_mm", "friction")
    column = {name: np.array([r[name] for r in results if r[name] is not None], float) for name in names}
    report = {
        "fallen": Proportion.of(np.array([r["fell"] for r in results], bool)).as_dict(),
        **{name: quantiles(column[name]) for name in names},
        "rested": Proportion.of(np.array([result["rested"] for result in every], bool)).as_dict(),
        "round": round_number,
        "towers": run.towers,
        "seed": run.seed,
    }
    rows = [
        (label, *(report[name][q] for q in ("median", "largest")))
        for name, label in (
            ("displaced_mm", "displaced against the table while turning [mm]"),
            ("after_mm", "moved in the second after it, awake [mm]"),
            ("unturned_mm", "moved in that second without a turn, awake [mm]"),
            ("friction", "friction needed over friction there"),
        )
    ]
    text = (
        f"Towers of round {round_number} that fell asleep: {number(report['rested'])}. Of these fell, turned by "
        f"180 degrees: {number(report['fallen'])}.\n\n"
        + markdown_table(("Largest of all blocks of a tower", "Median tower", "Worst tower"), rows)
    )
    draw = partial(figures.turntable, column["after_mm"], column["unturned_mm"], column["friction"])
    return run.write("turntable", report, text, draw)
