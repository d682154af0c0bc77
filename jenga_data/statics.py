"""Static equilibrium of a tower: which block carries how much, computed without simulating.

Each block is rigid and may sink, roll and pitch by small amounts; blocks touch through stiff unilateral springs
at the corners of the areas in which they overlap. The equilibrium is the minimum of a convex energy

    E(q) = sum_i m_i g z_i + sum_c U_c(max(0, -gap_c(q))),    U_c' the normal force of a contact (`ContactLaw`),

found by Newton's method. Where the energy has no minimum near the start, the tower does not stand: the centre of
mass of some part of it lies outside its support.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import solveh_banded

from jenga_data.blocks import GRAVITY, Blocks
from jenga_data.contact_law import ContactLaw
from jenga_data.tower import EMPTY, Layout

_TABLE = -1
_EVERYWHERE = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
_CORNER_X, _CORNER_Y = [0, 0, 1, 1], [0, 1, 0, 1]
_ROW, _COLUMN = np.tril_indices(6)
_BALANCED = 1e-8
"""Largest force [N] or torque [N m] left over at which the search ends: blocks then lie where they do to 1e-9 m."""
_AT_REST = 1e-4
"""Largest one at which a block counts as balanced where the search did not end so."""
_DEEP = 1e-4
"""A contact sinks by less [m]: its stiffness there sets the scale."""
_FLAT = 0.1
"""A line search ends where the energy's slope has fallen to this part of what it was at its start..."""
_NARROW = 1e-6
"""...or where it is known to this part of the step."""
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
    near: Equilibrium | None = None,
    iterations: int = 60,
) -> Equilibrium:
    """Find the equilibrium of a tower.

    Args:
        law: force of a contact corner, `PhysicsConfig.contact_law`, so that a computed tower is at rest when it is
            simulated.
        without: a block to leave out, as if it had been taken away.
        near: an equilibrium of almost the same tower, from which the search starts. It changes the time that takes,
            not what is found.
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

    q = _start(blocks, near, stacked, without)[gaps.order].ravel()
    at = _Contacts(law, mass, gaps.at(q))
    for _ in range(iterations):
        gradient = weight - gaps.transposed(at.force)
        if np.abs(gradient).max() < _BALANCED:
            break
        bands = gaps.hessian(at.stiffness, ridge)
        step = -solveh_banded(bands, gradient, overwrite_ab=True, lower=True, check_finite=False)
        length, at = _line_search(at, gaps.slope(step), float(weight @ step))
        q = q + step * length

    force = _Contacts(law, mass, gaps.at(q)).force
    at_rest = np.abs(weight - gaps.transposed(force)).max() < _AT_REST
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


def _start(
    blocks: Blocks, near: Equilibrium | None, stacked: Float[np.ndarray, " block"], without: int | None
) -> Float[np.ndarray, "block 3"]:
    """Height above the stack, roll and pitch from which the search starts: as in `near` where a block lies on the
    same level there, on the stack otherwise."""
    start = np.zeros((len(blocks), 3))
    if near is not None:
        same = np.abs(near.z - stacked) < blocks.size[:, 2] / 2
        if without is not None:
            same[without] = False
        start[same] = np.stack([near.z - stacked, near.roll, near.pitch], axis=1)[same]
    return start


class _Contacts:
    """Force [N] and stiffness [N/m] of all contacts at their gaps [m]."""

    def __init__(self, law: ContactLaw, mass: Float[np.ndarray, " contact"], gap: Float[np.ndarray, " contact"]):
        self.law, self.mass, self.gap = law, mass, gap
        force, stiffness = law.force_and_stiffness(-gap)
        self.force, self.stiffness = mass * force, mass * stiffness

    def opened(self, by: Float[np.ndarray, " contact"]) -> "_Contacts":
        return _Contacts(self.law, self.mass, self.gap + by)


def _effective_mass(blocks: Blocks, gaps: "_GapModel") -> Float[np.ndarray, " contact"]:
    """m1 m2 / (m1 + m2) of each contact's two blocks [kg]; the table is infinitely heavy."""
    inverse = 1.0 / blocks.mass[gaps.upper] + np.where(gaps.lower == _TABLE, 0.0, 1.0 / blocks.mass[gaps.lower])
    return 1.0 / inverse


def _line_search(start: _Contacts, gap_slope: Float[np.ndarray, " contact"], work: float) -> tuple[float, _Contacts]:
    """The step in (0, 1] at which the convex energy is least, and the contacts there.

    Newton's method on the energy's slope along the step, inside a bracket that bisection shrinks where Newton leaves
    it: the slope is monotonic, but its own slope jumps where a contact opens or closes.

    Args:
        gap_slope: by how much each gap opens over the whole step [m].
        work: of the weights over the whole step [J], negative where they fall.
    """
    low, high, t = 0.0, 1.0, 1.0
    least = _FLAT * abs(work - float(start.force @ gap_slope))
    while True:
        at = start.opened(t * gap_slope)
        slope = work - float(at.force @ gap_slope)
        if abs(slope) <= least or (t == 1.0 and slope <= 0) or high - low < _NARROW:
            return t, at
        low, high = (t, high) if slope < 0 else (low, t)
        curvature = float(at.stiffness @ gap_slope**2)
        t = t - slope / curvature if curvature > 0 else low
        if not low < t < high:
            t = (low + high) / 2


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
    grid = layout.grid if without is None else np.where(layout.grid == without, EMPTY, layout.grid)
    upper, lower = np.broadcast_arrays(grid[1:, :, None], grid[:-1, None, :])
    both = (upper != EMPTY) & (lower != EMPTY)
    ground = grid[0][grid[0] != EMPTY]
    upper = np.concatenate([ground, upper[both]])
    lower = np.concatenate([np.full(len(ground), _TABLE), lower[both]])
    rectangle = _rectangles(blocks, planar)
    below = np.where((lower == _TABLE)[:, None, None], _EVERYWHERE, rectangle[lower])
    low = np.maximum(rectangle[upper, 0], below[:, 0])
    high = np.minimum(rectangle[upper, 1], below[:, 1])
    touch = (high > low).all(axis=1)
    sides = np.stack([low[touch], high[touch]], axis=1)  # (contact area, low or high, xy)
    corners = np.stack([sides[:, _CORNER_X, 0], sides[:, _CORNER_Y, 1]], axis=-1)
    return _Corners(np.repeat(upper[touch], 4), np.repeat(lower[touch], 4), corners.reshape(-1, 2))


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
        weights = self.product * stiffness[:, None]
        shape = self.bandwidth + 1, len(ridge)
        bands = np.bincount(self.entry.ravel(), weights.ravel(), minlength=shape[0] * shape[1]).reshape(shape)
        bands[0] += ridge
        return bands

    @cached_property
    def product(self) -> Float[np.ndarray, "contact 21"]:
        """What a contact of stiffness one adds to the Hessian: the lower triangle of its 6 x 6 part."""
        return self.value[:, _ROW] * self.value[:, _COLUMN]

    @cached_property
    def entry(self) -> Int[np.ndarray, "contact 21"]:
        """Where in the flattened bands that goes. The table's columns repeat the block's, with zeros as values."""
        first, second = self.column[:, _ROW], self.column[:, _COLUMN]
        return np.abs(first - second) * 3 * len(self.order) + np.minimum(first, second)


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
        if sign < 0:  # what lies on a wedge touches its tilted top
            along = lever[:, 0] * np.cos(planar.yaw[b]) + lever[:, 1] * np.sin(planar.yaw[b])
            offset[held] -= blocks.wedge[b] * along / blocks.size[b, 0]
    # A table contact repeats the upper block's columns with zeros, so that it widens no band.
    grounded = corners.lower == _TABLE
    column[grounded, 1] = column[grounded, 0]
    column = column.reshape(contacts, 6)
    bandwidth = int(np.ptp(column, axis=1).max()) if contacts else 0
    return _GapModel(order, corners.upper, corners.lower, column, value.reshape(contacts, 6), offset, bandwidth)
