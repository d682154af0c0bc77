"""Blocks of a level lie side by side: how they make room for each other when they are put down."""

from itertools import combinations

import numpy as np
import pytest
from short_tower import PHYSICS, SPAWN, short_towers

from jenga_data.blocks import NOMINAL_SIZE, Blocks, sample_blocks
from jenga_data.collect.spawn import _AIR, _push_apart, grow_tower
from jenga_data.statics import PlanarPose
from jenga_data.tower import EMPTY, Layout

NOMINAL = Blocks(np.tile(NOMINAL_SIZE, (6, 1)), np.full(6, 0.02))
NEED = NOMINAL_SIZE[1] + _AIR
SLOTS = np.arange(-1, 2)
LEVELS = pytest.mark.parametrize("level", [0, 1], ids=["along x", "along y"])
MISSING = pytest.mark.parametrize("missing", [None, 0, 1, 2], ids=["full", "no first", "no middle", "no last"])


def two_levels(rng: np.random.Generator, missing: int | None = None) -> tuple[Layout, PlanarPose]:
    """Blocks at their places with errors along, across and of direction; both levels lack the same slot."""
    grid = Layout.fresh(rng.permutation(6)).grid.copy()
    xy, yaw = rng.normal(0, 3e-4, (6, 2)), rng.normal(0, 2e-3, 6)
    xy[grid[0], 1] += SLOTS * 0.0252
    xy[grid[1], 0] -= SLOTS * 0.0252
    yaw[grid[1]] += np.pi / 2
    if missing is not None:
        grid[:, missing] = EMPTY
    return Layout(grid), PlanarPose(xy, yaw)


def row_of(layout: Layout, level: int) -> np.ndarray:
    return layout.grid[level][layout.grid[level] != EMPTY]


def pushed(across: np.ndarray, level: int = 0) -> np.ndarray:
    """Where three nominal blocks of one direction end up across their level [m]."""
    axis, sign = (0, -1.0) if level else (1, 1.0)
    layout = Layout.fresh(np.arange(6))
    planar = PlanarPose(np.zeros((6, 2)), np.full(6, np.pi / 2 * level))
    row = layout.grid[level]
    planar.xy[row, axis] = sign * across
    _push_apart(NOMINAL, layout, planar, level)
    return sign * planar.xy[row, axis]


def footprint(blocks: Blocks, planar: PlanarPose, block: int) -> np.ndarray:
    """The four corners (corner xy)."""
    along = np.array([np.cos(planar.yaw[block]), np.sin(planar.yaw[block])])
    across = np.array([-along[1], along[0]])
    length, width, _ = blocks.size[block] / 2
    return planar.xy[block] + np.array([a * length * along + b * width * across for a in (-1, 1) for b in (-1, 1)])


def air_between(blocks: Blocks, planar: PlanarPose, one: int, other: int) -> float:
    """How far two footprints are apart in the direction that parts them best [m], negative where they overlap."""
    first, second = footprint(blocks, planar, one), footprint(blocks, planar, other)
    angles = planar.yaw[[one, other]][:, None] + [0.0, np.pi / 2]
    apart = []
    for angle in angles.ravel():
        normal = np.array([np.cos(angle), np.sin(angle)])
        a, b = first @ normal, second @ normal
        apart.append(max(b.min() - a.max(), a.min() - b.max()))
    return max(apart)


def test_no_two_blocks_of_a_level_overlap_in_grown_towers():
    """50 towers, those of round 3 with two blocks side by side on top."""
    rng, air, towers = np.random.default_rng(0), [], 0
    with short_towers():
        while towers < 50:
            tower = grow_tower(SPAWN, PHYSICS.contact_law, int(rng.choice([1, 1, 3])), rng)
            if tower is None:
                continue
            towers += 1
            for level in range(len(tower.layout.grid)):
                pairs = combinations(row_of(tower.layout, level).tolist(), 2)
                air += [air_between(tower.blocks, tower.planar, one, other) for one, other in pairs]
    assert len(air) > 500
    assert 0 < min(air) < 5e-5


@LEVELS
@MISSING
def test_no_two_blocks_overlap_and_nothing_else_changes(level, missing):
    """Neither the order of the blocks, nor where they lie along the level, nor their directions, nor other levels."""
    rng, made_room = np.random.default_rng(2), 0.0
    axis, sign = (0, -1.0) if level else (1, 1.0)
    for _ in range(50):
        layout, planar = two_levels(rng, missing)
        blocks, row = sample_blocks("measured", rng, 6), row_of(layout, level)
        xy, yaw = planar.xy.copy(), planar.yaw.copy()
        _push_apart(blocks, layout, planar, level)
        assert min(air_between(blocks, planar, a, b) for a, b in combinations(row.tolist(), 2)) > 0
        assert (np.diff(sign * planar.xy[row, axis]) > 0).all()
        np.testing.assert_array_equal(planar.yaw, yaw)
        np.testing.assert_array_equal(planar.xy[:, 1 - axis], xy[:, 1 - axis])
        others = np.setdiff1d(np.arange(6), row)
        np.testing.assert_array_equal(planar.xy[others], xy[others])
        made_room = max(made_room, np.abs(planar.xy - xy).max())
    if missing != 1:
        assert made_room > 1e-4
    else:
        assert made_room < 1e-15  # with a gap in the middle there is room


@LEVELS
def test_blocks_with_air_between_them_stay_where_they_are(level):
    for air in (1e-7, 2e-4, 0.01):
        across = 0.003 + SLOTS * (NEED + air)
        np.testing.assert_allclose(pushed(across, level), across, rtol=0, atol=1e-15)


@LEVELS
def test_two_that_overlap_make_room_for_each_other_in_equal_parts(level):
    overlap = 4e-4
    across = np.array([-NEED + overlap, 0.0, NEED + 0.01])
    expected = across + np.array([-1, 1, 0]) * overlap / 2
    np.testing.assert_allclose(pushed(across, level), expected, rtol=0, atol=1e-15)


def test_three_that_overlap_keep_their_middle_where_it_is():
    across = 0.001 + SLOTS * (NEED - 3e-4)
    np.testing.assert_allclose(pushed(across), 0.001 + SLOTS * NEED, rtol=0, atol=1e-15)


def test_no_other_way_of_making_room_moves_the_blocks_by_less():
    """Least squares: what they end up at is the projection onto all that is allowed, so that no allowed place lies on
    the side of it on which they were put down."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        wanted = SLOTS * NEED + rng.normal(0, 5e-4, 3)
        found = pushed(wanted)
        assert (np.diff(found) >= NEED - 1e-15).all()
        for _ in range(50):
            air = rng.exponential(3e-4, 2) * rng.integers(0, 2, 2)
            allowed = np.cumsum([rng.normal(-NEED, 1e-3), *(NEED + air)])
            assert (wanted - found) @ (allowed - found) <= 1e-15


def test_blocks_of_different_directions_need_what_their_corners_reach():
    """The second is turned by 10 mrad: at its end it comes nearer by 10 mrad times half its length."""
    layout, planar = Layout.fresh(np.arange(6)), PlanarPose(np.zeros((6, 2)), np.zeros(6))
    planar.yaw[layout.grid[0, 1]] = 0.01
    planar.xy[layout.grid[0], 1] = SLOTS * 0.025
    _push_apart(NOMINAL, layout, planar, 0)
    apart = np.diff(planar.xy[layout.grid[0], 1])
    np.testing.assert_allclose(apart, NEED + 0.01 * NOMINAL_SIZE[0] / 2, atol=1e-15)
    for one, other in ((0, 1), (1, 2)):
        air = air_between(NOMINAL, planar, *layout.grid[0, [one, other]].tolist())
        assert air == pytest.approx(_AIR, abs=1e-5)
