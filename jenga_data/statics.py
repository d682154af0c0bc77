"""Static equilibrium of a tower: which block carries how much, computed without simulating.

Each block is rigid and may sink, roll and pitch by small amounts; blocks touch through stiff unilateral springs
at the corners of the areas in which they overlap. The equilibrium is the minimum of a convex energy

    E(q) = sum_i m_i g z_i + sum_c U_c(max(0, -gap_c(q))),    U_c' the normal force of a contact (`ContactLaw`),

found by Newton's method. Where the energy has no minimum near the start, the tower does not stand: the centre of
mass of some part of it lies outside its support.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import solveh_banded

from jenga_data.blocks import GRAVITY, Blocks
from jenga_data.contact_law import ContactLaw
from jenga_data.tower import Layout

_TABLE = -1
_BALANCED = 1e-6
"""Largest force [N] or torque [N m] left over at which a block counts as balanced."""
_DEEP = 1e-4
"""A contact sinks by less [m]: its stiffness there sets the scale."""
_MAX_TILT = 0.06
"""A block that leans by more [rad] has lost its support: heights within a level differ by at most 0.7 mm, and so do
the heights of a block's supports, which are at least 12 mm apart."""


@dataclass(frozen=True, eq=False)
class PlanarPose:
    """Where blocks lie seen from above: centre x, y [m] and yaw [rad] in the tower's frame, one row a block."""

    xy: Float[np.ndarray, "block 2"]
    yaw: Float[np.ndarray, " block"]


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A tower at rest. Tilts are small rotations about the world's x and y [rad]."""

    z: Float[np.ndarray, " block"]
    roll: Float[np.ndarray, " block"]
    pitch: Float[np.ndarray, " block"]
    upper: Int[np.ndarray, " contact"]
    lower: Int[np.ndarray, " contact"]
    """-1 for the table."""
    force: Float[np.ndarray, " contact"]
    """Normal force of each contact corner [N]."""
    xy: Float[np.ndarray, "contact 2"]
    """Where each contact corner is, seen from above [m]."""
    stands: bool

    def load_on(self, block: int) -> float:
        """Weight that rests on top of `block` [N]."""
        return float(self.force[self.lower == block].sum())


def solve(
    blocks: Blocks,
    layout: Layout,
    planar: PlanarPose,
    law: ContactLaw,
    without: int | None = None,
    iterations: int = 60,
) -> Equilibrium:
    """Find the equilibrium of a tower.

    Args:
        law: force of a contact corner, `PhysicsConfig.contact_law`, so that a computed tower is at rest when it is
            simulated.
        without: a block to leave out, as if it had been taken away.
    """
    stacked = _stack_heights(blocks, layout)
    corners = _contact_corners(blocks, layout, planar, without)
    gaps = _gap_model(blocks, planar, layout, corners, stacked)
    mass = _effective_mass(blocks, gaps)
    weight = np.zeros((len(blocks), 3))
    weight[:, 0] = blocks.mass * GRAVITY
    if without is not None:
        weight[without] = 0.0
    weight = weight[gaps.order].ravel()
    # A block that is left out, and directions that no contact holds, stay where they are.
    ridge = np.tile([1e-6, 1e-9, 1e-9], len(blocks)) * max(1.0, law.stiffness(np.array([_DEEP]))[0])

    q = np.zeros(3 * len(blocks))
    for _ in range(iterations):
        gap = gaps.at(q)
        gradient = weight - gaps.transposed(mass * law.force(-gap))
        if np.abs(gradient).max() < _BALANCED:
            break
        step = -solveh_banded(gaps.hessian(mass * law.stiffness(-gap), ridge), gradient, lower=True)
        q = q + step * _line_search(gap, gaps.slope(step), float(weight @ step), law, mass)

    force = mass * law.force(-gaps.at(q))
    at_rest = np.abs(weight - gaps.transposed(force)).max() < 100 * _BALANCED
    pose = np.empty((len(blocks), 3))
    pose[gaps.order] = q.reshape(-1, 3)
    return Equilibrium(
        z=stacked + pose[:, 0],
        roll=pose[:, 1],
        pitch=pose[:, 2],
        upper=gaps.upper,
        lower=gaps.lower,
        force=force,
        xy=corners.xy,
        stands=bool(at_rest and np.abs(pose[:, 1:]).max() < _MAX_TILT),
    )


def _effective_mass(blocks: Blocks, gaps: "_GapModel") -> Float[np.ndarray, " contact"]:
    """m1 m2 / (m1 + m2) of each contact's two blocks [kg]; the table is infinitely heavy."""
    inverse = 1.0 / blocks.mass[gaps.upper] + np.where(gaps.lower == _TABLE, 0.0, 1.0 / blocks.mass[gaps.lower])
    return 1.0 / inverse


def _line_search(
    gap: Float[np.ndarray, " contact"],
    gap_slope: Float[np.ndarray, " contact"],
    work: float,
    law: ContactLaw,
    mass: Float[np.ndarray, " contact"],
) -> float:
    """The step in (0, 1] at which the convex energy is least, by bisection on its slope."""

    def slope(t: float) -> float:
        return work - float((mass * law.force(-(gap + t * gap_slope))) @ gap_slope)

    low, high = 0.0, 1.0
    if slope(high) <= 0:
        return high
    for _ in range(20):
        middle = (low + high) / 2
        low, high = (middle, high) if slope(middle) < 0 else (low, middle)
    return (low + high) / 2


@dataclass(frozen=True, eq=False)
class _Corners:
    upper: Int[np.ndarray, " contact"]
    lower: Int[np.ndarray, " contact"]
    xy: Float[np.ndarray, "contact 2"]


def _stack_heights(blocks: Blocks, layout: Layout) -> Float[np.ndarray, " block"]:
    """Centre heights if every level rested on the highest block of the one below: no contact is missed from there."""
    z = np.zeros(len(blocks))
    base = 0.0
    for row in layout.grid:
        ids = row[row >= 0]
        z[ids] = base + blocks.size[ids, 2] / 2
        base += blocks.size[ids, 2].max()
    return z


def _rectangles(blocks: Blocks, planar: PlanarPose) -> Float[np.ndarray, "block 2 2"]:
    """Low and high corner of each footprint; blocks lie along x or y up to a yaw so small that its cosine is one."""
    along_y = np.abs(np.sin(planar.yaw)) > np.sqrt(0.5)
    half = np.where(along_y[:, None], blocks.size[:, [1, 0]], blocks.size[:, [0, 1]]) / 2
    return np.stack([planar.xy - half, planar.xy + half], axis=1)


def _contact_corners(blocks: Blocks, layout: Layout, planar: PlanarPose, without: int | None) -> _Corners:
    rectangle = _rectangles(blocks, planar)
    upper, lower, points = [], [], []
    for level, row in enumerate(layout.grid):
        below = layout.grid[level - 1] if level else [_TABLE]
        for u in row:
            for b in below:
                if u < 0 or u == without or (level and (b < 0 or b == without)):
                    continue
                low, high = rectangle[u]
                if level:
                    low, high = np.maximum(low, rectangle[b][0]), np.minimum(high, rectangle[b][1])
                if (high <= low).any():
                    continue
                for x in (low[0], high[0]):
                    for y in (low[1], high[1]):
                        upper.append(u)
                        lower.append(b)
                        points.append((x, y))
    return _Corners(np.array(upper, np.int64), np.array(lower, np.int64), np.array(points, float).reshape(-1, 2))


@dataclass(frozen=True, eq=False)
class _GapModel:
    """Gaps of all corners as a linear function of q = (dz, roll, pitch) of each block, blocks in order of level.

    In that order the stiffness matrix is banded, which makes one Newton step a fraction of a millisecond.
    """

    order: Int[np.ndarray, " block"]
    upper: Int[np.ndarray, " contact"]
    lower: Int[np.ndarray, " contact"]
    column: Int[np.ndarray, "contact 6"]
    value: Float[np.ndarray, "contact 6"]
    offset: Float[np.ndarray, " contact"]
    bandwidth: int

    def slope(self, q: Float[np.ndarray, " coordinate"]) -> Float[np.ndarray, " contact"]:
        return (self.value * q[self.column]).sum(axis=1)

    def at(self, q: Float[np.ndarray, " coordinate"]) -> Float[np.ndarray, " contact"]:
        return self.slope(q) + self.offset

    def transposed(self, force: Float[np.ndarray, " contact"]) -> Float[np.ndarray, " coordinate"]:
        return np.bincount(self.column.ravel(), (self.value * force[:, None]).ravel(), minlength=3 * len(self.order))

    def hessian(
        self, stiffness: Float[np.ndarray, " contact"], ridge: Float[np.ndarray, " coordinate"]
    ) -> Float[np.ndarray, "band coordinate"]:
        """Lower bands of J^T diag(stiffness) J + diag(ridge), as `scipy.linalg.solveh_banded` takes them."""
        products = stiffness[:, None, None] * self.value[:, :, None] * self.value[:, None, :]
        row, column = np.broadcast_arrays(self.column[:, :, None], self.column[:, None, :])
        below = row >= column
        size = len(ridge)
        flat = (row[below] - column[below]) * size + column[below]
        bands = np.bincount(flat, products[below], minlength=(self.bandwidth + 1) * size).reshape(-1, size)
        bands[0] += ridge
        return bands


def _gap_model(
    blocks: Blocks, planar: PlanarPose, layout: Layout, corners: _Corners, stacked: Float[np.ndarray, " block"]
) -> _GapModel:
    order = layout.grid[layout.grid >= 0]
    rank = np.empty(len(blocks), np.int64)
    rank[order] = np.arange(len(blocks))
    contacts = len(corners.upper)
    column = np.zeros((contacts, 2, 3), np.int64)
    value = np.zeros((contacts, 2, 3))
    offset = np.zeros(contacts)
    for side, (body, sign) in enumerate(((corners.upper, 1.0), (corners.lower, -1.0))):
        held = np.flatnonzero(body >= 0)  # the table neither moves nor has a height
        b = body[held]
        lever = corners.xy[held] - planar.xy[b]
        column[held, side] = 3 * rank[b][:, None] + np.arange(3)
        value[held, side] = sign * np.stack([np.ones(len(b)), lever[:, 1], -lever[:, 0]], axis=1)
        offset[held] += sign * stacked[b] - blocks.size[b, 2] / 2
    # A table contact repeats the upper block's columns with zeros, so that it widens no band.
    grounded = corners.lower == _TABLE
    column[grounded, 1] = column[grounded, 0]
    column = column.reshape(contacts, 6)
    bandwidth = int(np.ptp(column, axis=1).max()) if contacts else 0
    return _GapModel(order, corners.upper, corners.lower, column, value.reshape(contacts, 6), offset, bandwidth)
