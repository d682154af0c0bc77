from dataclasses import replace

import numpy as np
import pytest
from nominal_tower import layout_of, nominal_blocks

from jenga_data.blocks import GRAVITY, NOMINAL_SIZE, Blocks, sample_blocks
from jenga_data.contact_law import ContactLaw
from jenga_data.statics import Equilibrium, PlanarPose, solve
from jenga_data.tower import Layout, nominal_poses

STIFFNESS = 5e5
LAW = ContactLaw.linear(STIFFNESS)
LENGTH, WIDTH, HEIGHT = NOMINAL_SIZE


def planar_of(layout: Layout, noise: float = 0.0, seed: int = 0) -> PlanarPose:
    rng = np.random.default_rng(seed)
    xy = nominal_poses(layout, air=0.0002)[:, :2]
    yaw = np.pi / 2 * layout.orientation
    return PlanarPose(xy + rng.normal(0, noise, xy.shape), yaw + rng.normal(0, 4 * noise, yaw.shape))


def measured_tower(seed: int, levels: int = 18, moves: int = 0) -> tuple[Blocks, Layout, PlanarPose]:
    rng = np.random.default_rng(seed)
    blocks = sample_blocks("measured", rng, 3 * levels)
    layout = Layout.fresh(rng.permutation(3 * levels))
    for _ in range(moves):
        layout = layout.moved(int(rng.choice(layout.legal_targets())), layout.next_places()[0])
    return blocks, layout, planar_of(layout, 0.0003, seed)


def nominal(*levels: str, shift: dict[int, tuple[float, float]] | None = None) -> Equilibrium:
    """The equilibrium of blocks as on the box, some of them shifted [m]."""
    layout = layout_of(*levels)
    planar = planar_of(layout)
    for block, by in (shift or {}).items():
        planar.xy[block] += by
    return solve(nominal_blocks(len(planar.yaw)), layout, planar, LAW)


def carried(equilibrium: Equilibrium, block: int) -> float:
    """What holds a block up, minus what rests on it [N]."""
    return float(equilibrium.force[equilibrium.upper == block].sum()) - equilibrium.load_on(block)


# --- balance -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("seed", "moves"), [(0, 0), (1, 0), (2, 1), (3, 2)])
def test_each_block_is_balanced_and_the_table_carries_the_tower(seed, moves):
    blocks, layout, planar = measured_tower(seed, moves=moves)
    equilibrium = solve(blocks, layout, planar, LAW)
    assert equilibrium.stands
    assert equilibrium.force.min() >= 0
    for block, mass in enumerate(blocks.mass):
        assert carried(equilibrium, block) == pytest.approx(mass * GRAVITY, abs=1e-4)
    assert equilibrium.load_on(-1) == pytest.approx(blocks.mass.sum() * GRAVITY, abs=1e-4)


def test_contacts_join_a_level_with_the_one_below():
    blocks, layout, planar = measured_tower(4)
    equilibrium = solve(blocks, layout, planar, LAW)
    below = np.where(equilibrium.lower == -1, -1, layout.level[equilibrium.lower])
    np.testing.assert_array_equal(layout.level[equilibrium.upper], below + 1)


@pytest.mark.parametrize("shift", [-0.012, 0.0, 0.006, 0.012])
def test_two_narrow_supports_share_a_load_by_the_lever_rule(shift):
    layout = layout_of("x.x", ".x.")
    blocks = Blocks(np.array([[LENGTH, 0.0005, HEIGHT]] * 2 + [list(NOMINAL_SIZE)]), np.full(3, 0.02))
    planar = planar_of(layout)
    planar.xy[2, 1] += shift
    equilibrium = solve(blocks, layout, planar, LAW)
    arm = abs(planar.xy[1, 1])
    right = 0.02 * GRAVITY * (arm + shift) / (2 * arm)
    assert equilibrium.stands
    assert equilibrium.load_on(1) == pytest.approx(right, abs=0.02 * right)
    assert equilibrium.load_on(0) == pytest.approx(0.02 * GRAVITY - right, abs=0.02 * right)


def test_masses_ten_times_as_heavy_press_ten_times_as_hard_and_lie_where_they_lay():
    """Springs are in proportion to the masses, as MuJoCo's contacts are."""
    blocks, layout, planar = measured_tower(5, levels=4)
    light, heavy = (solve(replace(blocks, mass=blocks.mass * k), layout, planar, LAW) for k in (1, 10))
    np.testing.assert_allclose(heavy.force, 10 * light.force, atol=1e-4)
    np.testing.assert_allclose(heavy.z, light.z, atol=1e-8)


# --- where blocks lie ----------------------------------------------------------------------------------------------


def test_nominal_blocks_lie_level_on_each_other():
    equilibrium = nominal("xxx", "xxx", "xxx", "xxx")
    level = np.repeat(np.arange(4), 3)
    assert equilibrium.stands
    np.testing.assert_allclose(equilibrium.z, (level + 0.5) * HEIGHT, atol=5e-5)
    assert (equilibrium.z < (level + 0.5) * HEIGHT).all()
    assert np.abs([equilibrium.roll, equilibrium.pitch]).max() < 1e-4


def test_stiffer_contacts_sink_in_proportion_less():
    layout = layout_of("xxx", "xxx")
    blocks, planar = nominal_blocks(6), planar_of(layout)
    soft, stiff = (solve(blocks, layout, planar, ContactLaw.linear(k)).z for k in (STIFFNESS, 4 * STIFFNESS))
    flat = (layout.level + 0.5) * HEIGHT
    np.testing.assert_allclose(flat - soft, 4 * (flat - stiff), rtol=1e-3)


def test_a_block_on_supports_of_different_height_leans_to_the_lower_one():
    """Rotations about x are positive where +y goes up."""
    layout = layout_of("x.x", ".x.")
    blocks = nominal_blocks(3)
    size = blocks.size.copy()
    size[1, 2] += 0.0004  # the support at +y
    equilibrium = solve(replace(blocks, size=size), layout, planar_of(layout), LAW)
    inner_edge, far_end = WIDTH / 2 + 0.0002, -LENGTH / 2
    assert equilibrium.roll[2] == pytest.approx(0.0004 / (inner_edge - far_end), rel=0.05)
    assert abs(equilibrium.pitch[2]) < 1e-6


def test_a_taller_block_carries_more_than_its_neighbours():
    layout = layout_of("xxx", "xxx", "xxx")
    blocks, planar = nominal_blocks(9), planar_of(layout)
    even = solve(blocks, layout, planar, LAW)
    loads = []
    for taller in (0.0, 0.00001, 0.0001):
        size = blocks.size.copy()
        size[1, 2] += taller
        loads.append(solve(replace(blocks, size=size), layout, planar, LAW).load_on(1))
    assert loads[0] == pytest.approx(even.load_on(1))
    assert loads[0] < loads[1] < loads[2] <= 6 * blocks.mass[0] * GRAVITY + 1e-6


# --- towers that fall ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("levels", "stands"),
    [
        (("xxx", ".x.", "xxx"), True),
        (("xxx", "x.x", "xxx"), True),
        (("xxx", "xx.", "xxx"), True),
        (("xxx", "x..", "xxx"), False),
        (("xxx", "..x", "xxx"), False),
        ((".x.", ".x.", ".x.", ".x."), True),
        (("..x", "xxx"), False),
        (("xxx", "xxx", "x.."), True),
    ],
)
def test_a_tower_stands_when_the_centre_of_mass_lies_over_its_support(levels, stands):
    assert nominal(*levels).stands is stands


@pytest.mark.parametrize(
    ("shift", "stands"), [(0.0, True), (0.0115, True), (-0.0115, True), (0.0135, False), (-0.0135, False)]
)
def test_a_block_falls_off_a_support_of_half_its_reach(shift, stands):
    """A centre block is 25 mm wide: the block across it may be moved by 12.5 mm."""
    assert nominal(".x.", ".x.", shift={1: (0.0, shift)}).stands is stands


def test_blocks_that_would_each_stand_fall_together():
    """8 mm off the middle and the next 12 mm further: together 14 mm off, and the support ends at 12.5 mm."""
    # Level 1 lies along y on a centre block along x; level 2 lies along x at the end of level 1.
    assert nominal(".x.", ".x.", ".x.", shift={1: (0.0, 0.008), 2: (0.0, 0.008)}).stands
    assert not nominal(".x.", ".x.", ".x.", shift={1: (0.0, 0.008), 2: (0.0, 0.020)}).stands
    assert nominal("xxx", ".x.", ".x.", shift={1: (0.0, 0.008), 2: (0.0, 0.020)}).stands


def test_a_block_that_leans_more_than_heights_differ_does_not_stand():
    layout = layout_of("x.x", ".x.")
    blocks = nominal_blocks(3)
    for taller, stands in [(0.001, True), (0.005, False)]:
        size = blocks.size.copy()
        size[1, 2] += taller
        assert solve(replace(blocks, size=size), layout, planar_of(layout), LAW).stands is stands


def test_a_block_in_the_air_does_not_stand():
    assert not nominal("xxx", "xxx", shift={4: (0.3, 0.0)}).stands


# --- symmetry ------------------------------------------------------------------------------------------------------


def test_a_mirrored_tower_has_mirrored_loads():
    """Mirrored at the plane y = 0: even levels swap their slots, odd levels keep them."""
    blocks, layout, planar = measured_tower(6, levels=6)
    grid = layout.grid.copy()
    grid[::2] = grid[::2, ::-1]
    mirrored = PlanarPose(planar.xy * [1, -1], np.where(layout.orientation, np.pi, 0.0) - planar.yaw)
    one, other = solve(blocks, layout, planar, LAW), solve(blocks, Layout(grid), mirrored, LAW)
    np.testing.assert_allclose(other.z, one.z, atol=1e-8)
    np.testing.assert_allclose(other.roll, -one.roll, atol=1e-6)
    np.testing.assert_allclose(other.pitch, one.pitch, atol=1e-6)
    loads = np.array([[e.load_on(b) for b in range(len(blocks))] for e in (one, other)])
    np.testing.assert_allclose(loads[1], loads[0], atol=1e-3)


def test_the_numbering_of_the_blocks_does_not_matter():
    blocks, layout, planar = measured_tower(7, levels=5)
    order = np.random.default_rng(7).permutation(len(blocks))  # new block i is the old block order[i]
    new = Layout(np.argsort(order)[layout.grid])
    one = solve(blocks, layout, planar, LAW)
    other = solve(
        Blocks(blocks.size[order], blocks.mass[order]), new, PlanarPose(planar.xy[order], planar.yaw[order]), LAW
    )
    np.testing.assert_allclose(other.z, one.z[order], atol=1e-9)


# --- a block left out ----------------------------------------------------------------------------------------------


def test_without_a_block_is_the_tower_from_which_it_was_taken():
    blocks, layout, planar = measured_tower(8, levels=5)
    gone = int(layout.grid[2, 0])
    grid = layout.grid.copy()
    grid[2, 0] = -1
    kept = np.delete(np.arange(len(blocks)), gone)
    taken = Layout(np.where(grid > gone, grid - 1, grid))
    left_out = solve(blocks, layout, planar, LAW, without=gone)
    expected = solve(
        Blocks(blocks.size[kept], blocks.mass[kept]), taken, PlanarPose(planar.xy[kept], planar.yaw[kept]), LAW
    )
    assert left_out.stands
    assert expected.stands
    np.testing.assert_allclose(left_out.z[kept], expected.z, atol=1e-7)
    assert not np.isin(gone, [left_out.upper, left_out.lower])
    assert left_out.load_on(-1) == pytest.approx(blocks.mass[kept].sum() * GRAVITY, abs=1e-3)


def test_a_tower_may_not_stand_without_a_block():
    layout = layout_of("xxx", "xx.", "xxx")
    blocks, planar = nominal_blocks(8), planar_of(layout)
    assert solve(blocks, layout, planar, LAW, without=3).stands
    assert not solve(blocks, layout, planar, LAW, without=4).stands


# --- a search that starts near its end -----------------------------------------------------------------------------


@pytest.mark.parametrize("law", [LAW, ContactLaw(4e4, 0.9, 0.999, 7e-5)])
def test_where_the_search_starts_changes_nothing_but_the_time(law):
    blocks, layout, planar = measured_tower(6, levels=8)
    start = solve(blocks, layout, planar, law)
    moved = layout.moved(int(layout.legal_targets()[0]), layout.next_places()[0])
    for then, without in ((moved, None), (layout, int(layout.legal_targets()[3]))):
        here = planar_of(then, 0.0003, 6)
        cold = solve(blocks, then, here, law, without)
        warm = solve(blocks, then, here, law, without, near=start)
        assert warm.stands == cold.stands
        np.testing.assert_allclose(warm.z, cold.z, rtol=0, atol=1e-9)
        np.testing.assert_allclose([warm.roll, warm.pitch], [cold.roll, cold.pitch], rtol=0, atol=1e-7)
        np.testing.assert_allclose(warm.force, cold.force, rtol=0, atol=1e-5)
    at_once = solve(blocks, layout, planar, law, near=start, iterations=0)
    np.testing.assert_allclose(at_once.z, start.z, rtol=0, atol=1e-15)
