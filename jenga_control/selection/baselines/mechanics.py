"""Mechanics of rigid blocks: how much the target carries, and whether the tower stands without it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jenga_control.selection.baselines.structure import Structure
from jenga_data.blocks import GRAVITY, NOMINAL_SIZE, Blocks
from jenga_data.contact_law import ContactLaw
from jenga_data.statics import Equilibrium, PlanarPose, solve
from jenga_data.tower import CENTRE, Layout, turn_poses

AIR = 2e-4
"""Between neighbours of a level, where no poses are given [m]: slots then are as far apart as blocks put down."""
FALLEN_TILT = 0.06
"""What stands for the change of a tower that falls: tilt [rad]..."""
FALLEN_SINK = 10.0
"""...and sink [mm]."""
PRESSED = 1e-3
"""A block presses on another with more than this [N]."""
MM = 1e3
MILLI = 1e3


@dataclass(frozen=True, eq=False)
class MechanicalCase:
    """One pull to compute: the law of its contacts, and whether metric poses may be used."""

    tower: Structure
    law: ContactLaw
    posed: bool


def mechanical_features(case: MechanicalCase) -> dict[str, float]:
    """Two equilibria, with and without the target (about 30 ms together), as features by name. SI but for mm, mN m."""
    tower = case.tower
    blocks = Blocks(tower.size, tower.mass)
    layout = Layout.from_places(tower.level, tower.slot)
    planar = planar_pose(tower) if case.posed else nominal_planar(layout)
    whole = solve(blocks, layout, planar, case.law)
    without = solve(blocks, layout, planar, case.law, without=tower.target, near=whole)
    level = int(tower.level[tower.target])
    mates = np.flatnonzero((tower.level == level) & (np.arange(len(tower)) != tower.target))
    above = float(tower.mass[tower.level > level].sum()) * GRAVITY
    return {
        **_load(whole, tower, planar, above),
        **_mates(whole, without, mates),
        **_change(whole, without, tower.target),
        "weight_above": above,
    }


def nominal_planar(layout: Layout) -> PlanarPose:
    """Nominal blocks in their slots."""
    _, width, _ = NOMINAL_SIZE
    across, odd = (layout.slot - CENTRE) * (width + AIR), layout.orientation == 1
    xy = np.stack([np.where(odd, -across, 0.0), np.where(odd, 0.0, across)], axis=1)
    return PlanarPose(xy, np.where(odd, np.pi / 2, 0.0))


def planar_pose(tower: Structure) -> PlanarPose:
    """The tower as it stands, turned back so that its even levels lie along x."""
    odd = tower.level[tower.target] % 2 == 1
    pose = turn_poses(tower.pose, np.pi / 2) if odd else tower.pose
    yaw = 2 * np.arctan2(pose[:, 6], pose[:, 3])
    # Blocks are boxes without a front: directions that differ by half a turn are the same.
    return PlanarPose(pose[:, :2], (yaw + np.pi / 4) % np.pi - np.pi / 4)


def _load(whole: Equilibrium, tower: Structure, planar: PlanarPose, above: float) -> dict[str, float]:
    """What rests on the target, in all and off its middle, and how many blocks press on it or bear it."""
    on, under = whole.lower == tower.target, whole.upper == tower.target
    lever = np.abs(_torque(whole, on, planar.xy[tower.target]))
    across = 1 - int(tower.level[tower.target]) % 2
    load = float(whole.force[on].sum())
    return {
        "load": load,
        "log_load": float(np.log10(load + 1e-3)),
        "load_share": load / above if above else 0.0,
        "moment_across": float(lever[across]) * MILLI,
        "moment_along": float(lever[1 - across]) * MILLI,
        "borne": float(whole.force[under].sum()),
        "pressed_by": float(_pressing(whole.upper[on], whole.force[on])),
        "borne_by": float(_pressing(whole.lower[under], whole.force[under])),
    }


def _torque(found: Equilibrium, which: np.ndarray, about: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
    """Sum of forces times their lever along x and y [N m]."""
    return (found.force[which, None] * (found.xy[which] - about)).sum(axis=0)


def _pressing(block: np.ndarray, force: np.ndarray) -> int:
    return sum(bool(force[block == b].sum() > PRESSED) for b in np.unique(block))


def _mates(whole: Equilibrium, without: Equilibrium, mates: np.ndarray) -> dict[str, float]:
    """What the level mates carry with the target and without it; as much as before where the tower falls."""
    after = without if without.stands else whole
    loads = {
        "before": np.array([whole.load_on(int(m)) for m in mates]),
        "after": np.array([after.load_on(int(m)) for m in mates]),
    }
    found = {f"{end}_mate_{when}": 0.0 for when in loads for end in ("least", "most")}
    if len(mates):
        found |= {f"least_mate_{when}": float(load.min()) for when, load in loads.items()}
        found |= {f"most_mate_{when}": float(load.max()) for when, load in loads.items()}
    return found | {"taken_by_mates": float(loads["after"].sum() - loads["before"].sum())}


def _change(whole: Equilibrium, without: Equilibrium, target: int) -> dict[str, float]:
    """How far the others sink and tilt when the target is taken away."""
    if not without.stands:
        return {"stands": 0.0, "tilt": FALLEN_TILT * MILLI, "sink": FALLEN_SINK}
    others = np.arange(len(whole.z)) != target
    tilt = max(np.abs(without.roll - whole.roll)[others].max(), np.abs(without.pitch - whole.pitch)[others].max())
    sink = (whole.z - without.z)[others].max() * MM
    return {"stands": 1.0, "tilt": min(float(tilt), FALLEN_TILT) * MILLI, "sink": min(float(sink), FALLEN_SINK)}
