"""How many tries a standing tower takes, and what rejecting the others does to the choice of blocks."""

from typing import Any

import numpy as np

from jenga_data.blocks import Blocks
from jenga_data.collect.config import SpawnConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.spawn import GrownTower, grow_tower
from jenga_data.collect.stage import standing_pose
from jenga_data.sim.physics import PhysicsConfig
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
