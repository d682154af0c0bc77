"""Hand-made features of G_s+layout: those of G_s, and where in the tower the target and its level mates lie.

Every feature stays the same when the tower is mirrored or turned by 180 degrees: sides are "own" and "other", never
left and right. Positions are those of nominal blocks in their slots, as no metric pose is given.
"""

import numpy as np
from jaxtyping import Float

from jenga_control.selection.baselines.graph_features import MM, graph_features, spread
from jenga_control.selection.baselines.structure import Structure
from jenga_data.blocks import NOMINAL_SIZE
from jenga_data.tower import CENTRE, EMPTY, SLOTS, Layout, nominal_poses

HALF_WIDTH = NOMINAL_SIZE[1] / 2 * MM


def layout_features(tower: Structure) -> dict[str, float]:
    """Features by name. Lengths in mm, masses in g, forces in N; what there is none of counts as 0."""
    layout = Layout.from_places(tower.level, tower.slot)
    level = int(tower.level[tower.target])
    height = tower.size[:, 2] * MM
    rows = {"same": _heights(layout, level, height)}
    rows |= {"above": _heights(layout, level + 1, height), "below": _heights(layout, level - 1, height)}
    slot = int(tower.slot[tower.target])
    if slot == 2:  # the target's own side comes first
        rows["same"] = rows["same"][::-1]
    return {
        **graph_features(tower),
        "level": level,
        "levels": len(layout.grid),
        "centre": float(slot == CENTRE),
        "mates": float(np.isfinite(rows["same"]).sum() - 1),
        **_among_mates(rows["same"], centre=slot == CENTRE),
        **_level("above", rows["above"]),
        **_level("below", rows["below"]),
        **_balance(tower, layout),
    }


def _heights(layout: Layout, level: int, height: Float[np.ndarray, " block"]) -> Float[np.ndarray, "3"]:
    """Heights across a level [mm]; NaN where no block lies."""
    if not 0 <= level < len(layout.grid):
        return np.full(SLOTS, np.nan)
    row = layout.grid[level]
    return np.where(row == EMPTY, np.nan, height[row])


def _crown(row: Float[np.ndarray, "3"]) -> float:
    """How much the centre block rises above the line between both sides: above 0 it carries, below 0 it is loose."""
    return _known(row[CENTRE] - (row[0] + row[2]) / 2)


def _known(value: float) -> float:
    return float(value) if np.isfinite(value) else 0.0


def _among_mates(row: Float[np.ndarray, "3"], *, centre: bool) -> dict[str, float]:
    """Heights within the target's level; `row` begins with the target, or with either side of a centre target."""
    sides = row[[0, 2]] if np.isfinite(row[[0, 2]]).any() else np.zeros(2)
    return {
        "crown": _crown(row),
        "crown_against": _crown(row) * (1.0 if centre else -1.0),
        "over_centre": 0.0 if centre else _known(row[0] - row[CENTRE]),
        "over_other_side": 0.0 if centre else _known(row[0] - row[2]),
        "over_highest_side": _known(row[CENTRE] - np.nanmax(sides)) if centre else 0.0,
        "over_lowest_side": _known(row[CENTRE] - np.nanmin(sides)) if centre else 0.0,
    }


def _level(name: str, row: Float[np.ndarray, "3"]) -> dict[str, float]:
    held = row[np.isfinite(row)]
    layout = {f"crown_{name}": _crown(row), f"centre_{name}": float(np.isfinite(row[CENTRE]))}
    ends = {f"slope_{name}": abs(_known(row[0] - row[2]))}
    return {f"level_{k}": v for k, v in spread(name, held).items()} | layout | ends


def _balance(tower: Structure, layout: Layout) -> dict[str, float]:
    """Where the centre of mass of all higher levels falls, seen from the target, and how far inside what is left of
    the level: the margin is below 0 where it would lie outside of the mates' footprint."""
    level = tower.level[tower.target]
    xy = nominal_poses(layout)[:, :2] * MM
    along, across = (xy[:, 0], xy[:, 1]) if level % 2 == 0 else (xy[:, 1], xy[:, 0])
    higher = tower.level > level
    if not higher.any():
        return {"mass_off_target": 0.0, "mass_off_centre": 0.0, "mass_along": 0.0, "margin": 0.0}
    mass = tower.mass[higher]
    centre = float((mass * across[higher]).sum() / mass.sum())
    along_centre = float((mass * along[higher]).sum() / mass.sum())
    mates = across[(tower.level == level) & (np.arange(len(tower)) != tower.target)]
    margin = min(centre - mates.min(), mates.max() - centre) + HALF_WIDTH if len(mates) else -HALF_WIDTH
    toward_target = np.sign(across[tower.target])
    return {
        "mass_off_target": centre * toward_target,
        "mass_off_centre": abs(centre),
        "mass_along": abs(along_centre),
        "margin": float(margin),
    }
