"""How many tries a standing tower takes, and what rejecting the others does to the choice of blocks."""

from collections import Counter
from functools import partial
from typing import Any

import numpy as np

from jenga_data.blocks import Blocks
from jenga_data.calibrate import figures
from jenga_data.calibrate.cases import Case
from jenga_data.calibrate.run import Run
from jenga_data.collect.config import SelectionConfig, SpawnConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.spawn import GrownTower, grow_tower
from jenga_data.collect.stage import standing_pose, standing_tower
from jenga_data.replay.side_by_side import tower_grid
from jenga_data.report import markdown_table, with_interval
from jenga_data.sim.physics import PhysicsConfig
from jenga_data.statistics import Proportion, ratio_bootstrap
from jenga_data.tower import CENTRE, Layout


def tries_of_round(
    spawn: SpawnConfig, physics: PhysicsConfig, seed: int, number: int, round_number: int
) -> dict[str, Any]:
    """Grow towers of one round until one stands.

    Returns:
        `tries`, 0 if none of `spawn.tries` stood; `first`, what became of the first try (stands, cannot be grown,
        falls); `rejected` and `accepted`, what characterises the grown towers (see `_character`), rejected ones
        only where they could be grown.
    """
    rng = episode_rng(seed, number, f"round {round_number}")
    fates: list[str] = []
    rejected: list[dict[str, float]] = []
    accepted: dict[str, float] | None = None
    while accepted is None and len(fates) < spawn.tries:
        grown = grow_tower(spawn, physics.contact_law, round_number, rng)
        if grown is None:
            fates.append("cannot be grown")
        elif standing_pose(spawn, physics, grown) is None:
            fates.append("falls")
            rejected.append(_character(grown))
        else:
            fates.append("stands")
            accepted = _character(grown)
    return {
        "round": round_number,
        "tries": len(fates) if accepted is not None else 0,
        "first": fates[0],
        "rejected": rejected,
        "accepted": accepted,
    }


def _character(tower: GrownTower) -> dict[str, float]:
    """What rejection could favour: spread of heights within a level [mm], masses [g], and where blocks were taken."""
    blocks, layout = tower.blocks, tower.layout
    return {
        "height_spread_mm": _height_spread(blocks, layout) * 1e3,
        "mass_g": float(blocks.mass.mean() * 1e3),
        "levels": float(len(layout.grid)),
        "middles_taken": _taken(layout, {CENTRE}),
        "sides_taken": _taken(layout, {0, 2}),
    }


def _height_spread(blocks: Blocks, layout: Layout) -> float:
    """Mean over the levels of the difference between the highest and the lowest block [m]."""
    rows = [blocks.size[row[row >= 0], 2] for row in layout.grid]
    return float(np.mean([np.ptp(row) for row in rows]))


def _taken(layout: Layout, slots: set[int]) -> float:
    """How many of these slots are empty below the highest completed level."""
    return float((layout.grid[: layout.highest_completed(), sorted(slots)] < 0).sum())


_FATES = ("stands", "cannot be grown", "falls")


def rounds_report(run: Run, config: SelectionConfig) -> dict[str, Any]:
    """Spawn towers of every round."""
    spawn = config.spawn
    each = range(spawn.first_round, spawn.last_round + 1)
    arguments = {"spawn": spawn, "physics": config.physics, "seed": run.seed}
    cases: list[Case] = [
        (tries_of_round, arguments | {"number": n, "round_number": r}) for r in each for n in range(run.towers)
    ]
    results = run.cases("rounds", cases)
    by_round = {}
    for r in each:
        mine = [result for result in results if result["round"] == r]
        tries = np.array([result["tries"] for result in mine])
        fates = Counter(result["first"] for result in mine)
        by_round[str(r)] = {
            "stood": Proportion.of(tries > 0).as_dict(),
            "mean_tries": float(tries[tries > 0].mean()) if (tries > 0).any() else None,
            "most_tries": int(tries.max()),
            "first_try": dict(sorted(fates.items())),
        }
    accepted = [r["accepted"] for r in results if r["accepted"] is not None]
    rejected = [character for r in results for character in r["rejected"]]
    bias = {
        name: {
            "accepted": _mean(accepted, name),
            "rejected": _mean(rejected, name),
        }
        for name in (accepted[0] if accepted else {})
    }
    report = {"rounds": by_round, "bias": bias, "rejected": len(rejected), "towers": run.towers, "seed": run.seed}
    rows = [
        (r, s["stood"], s["mean_tries"], s["most_tries"], *(s["first_try"].get(f, 0) for f in _FATES))
        for r, s in by_round.items()
    ]
    text = (
        markdown_table(("Round", "Seeds that stood", "Mean tries", "Most", *(f"First try {f}" for f in _FATES)), rows)
        + f"\nWhat rejecting does to the towers ({len(rejected)} were grown and fell):\n\n"
        + markdown_table(
            ("Mean of", "Accepted", "Rejected"), [(n, b["accepted"], b["rejected"]) for n, b in bias.items()]
        )
    )
    shown = [r for r in each if r % 2 == each[0] % 2]
    towers = [standing_tower(spawn, config.physics, r, episode_rng(run.seed, r, "shown"))[0] for r in shown]
    run.draw("towers", partial(tower_grid, towers, [f"round {r}" for r in shown]))
    return run.write("rounds", report, text + "\n![towers](towers.png)\n", partial(figures.tries, by_round))


def _mean(characters: list[dict[str, float]], name: str) -> str | None:
    if not characters:
        return None
    values = np.array([character[name] for character in characters])
    interval = ratio_bootstrap(values, np.ones(len(values)), np.arange(len(values)))
    return with_interval(float(values.mean()), interval)
