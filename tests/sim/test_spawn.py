from collections.abc import Iterator
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from short_tower import PHYSICS, short_tower, world_of

from jenga_data.collect.config import SpawnConfig
from jenga_data.collect.spawn import GrownTower, grow_tower, shifted
from jenga_data.geometry import rotation_matrices
from jenga_data.sim.world import World
from jenga_data.statics import solve
from jenga_data.tower import EMPTY, Layout, Place

CONFIG = SpawnConfig()
LAW = PHYSICS.contact_law

Move = tuple[Layout, int, Place]


def grown(round_number: int, seed: int, config: SpawnConfig = CONFIG) -> tuple[GrownTower, list[Move]]:
    """The first tower of a round that can be grown from a seed on, and every move of its history."""
    rng = np.random.default_rng(seed)
    made = Layout.moved
    while True:
        moves: list[Move] = []

        def moved(layout: Layout, block: int, to: Place, moves: list[Move] = moves) -> Layout:
            moves.append((layout, block, to))
            return made(layout, block, to)

        with patch.object(Layout, "moved", moved):
            tower = grow_tower(config, LAW, round_number, rng)
        if tower is not None:
            return tower, moves


@pytest.fixture(scope="module")
def towers() -> list[tuple[GrownTower, list[Move]]]:
    return [grown(1, 0), grown(5, 1), grown(15, 2)]


def each_move(towers: list[tuple[GrownTower, list[Move]]]) -> Iterator[Move]:
    return (move for _, moves in towers for move in moves)


# --- by legal moves that a player could make -----------------------------------------------------------------------


def test_a_tower_of_round_r_has_seen_r_minus_1_legal_moves(towers):
    for (tower, moves), round_number in zip(towers, (1, 5, 15), strict=True):
        assert len(moves) == round_number - 1
        assert tower.layout.round == round_number
        layout = moves[0][0] if moves else tower.layout
        assert layout.round == 1
        for before, block, place in moves:
            np.testing.assert_array_equal(before.grid, layout.grid)
            assert before.is_legal(block)
            assert place in before.next_places()
            layout = before.moved(block, place)
        np.testing.assert_array_equal(tower.layout.grid, layout.grid)


def test_all_blocks_are_still_there_and_a_level_is_completed_before_a_new_one_begins(towers):
    for tower, moves in towers:
        assert sorted(b for b, _ in tower.layout) == list(range(54))
        assert len(tower.layout.grid) == 18 + -(-len(moves) // 3)
        for before, _, place in moves:
            assert place.level == len(before.grid) - bool((before.grid[-1] == EMPTY).any())


def test_a_fresh_tower_is_filled_in_an_order_of_its_own(towers):
    order = towers[0][0].layout.grid.ravel()
    assert sorted(order) == list(range(54))
    assert not np.array_equal(order, np.arange(54))


def test_a_block_under_a_load_is_not_taken():
    config = replace(CONFIG, load_limit=-1.0)
    assert grow_tower(config, LAW, 1, np.random.default_rng(0)) is not None
    assert grow_tower(config, LAW, 2, np.random.default_rng(0)) is None


def test_no_taken_block_carried_more_than_the_limit_and_the_tower_stood_without_it():
    """What the moves of a history looked like just before each of them."""
    limit = 0.5
    seen: list[tuple[float, bool]] = []

    def spied(blocks, layout, planar, law, without=None, near=None):
        equilibrium = solve(blocks, layout, planar, law, without, near)
        if without is not None:
            load = solve(blocks, layout, planar, law).load_on(without)
            seen.append((load, equilibrium.stands))
        return equilibrium

    with patch("jenga_data.collect.spawn.solve", spied):
        _, moves = grown(4, 5, replace(CONFIG, load_limit=limit))
    assert len(moves) == 3
    assert max(load for load, _ in seen) <= limit
    assert sum(stands for _, stands in seen) >= len(moves)


def test_the_same_generator_grows_the_same_tower():
    one, other = grown(4, 3)[0], grown(4, 3)[0]
    np.testing.assert_array_equal(one.layout.grid, other.layout.grid)
    np.testing.assert_array_equal(one.pose, other.pose)
    assert one.blocks.tower == other.blocks.tower
    assert grown(4, 4)[0].blocks.tower != one.blocks.tower


# --- where blocks lie ----------------------------------------------------------------------------------------------


def test_towers_are_in_equilibrium(towers):
    for tower, _ in towers:
        again = solve(tower.blocks, tower.layout, tower.planar, LAW)
        assert tower.equilibrium.stands
        np.testing.assert_allclose(again.z, tower.equilibrium.z, rtol=0, atol=1e-9)


def test_blocks_lie_at_their_places_up_to_the_error_of_a_hand(towers):
    """Even levels along x with slots along +y; odd levels turned by +90 degrees, with slots along -x."""
    errors, turns = [], []
    for tower, _ in towers:
        odd = tower.layout.orientation == 1
        slot = (tower.layout.slot - 1) * 0.0252
        place = np.where(odd[:, None], np.stack([-slot, 0 * slot], 1), np.stack([0 * slot, slot], 1))
        errors.append(tower.planar.xy - place)
        turns.append(tower.planar.yaw - np.where(odd, np.pi / 2, 0.0))
    assert np.std(np.concatenate(errors)) == pytest.approx(CONFIG.position_sigma, rel=0.15)
    assert np.std(np.concatenate(turns)) == pytest.approx(CONFIG.yaw_sigma, rel=0.2)


def test_poses_have_the_yaw_and_the_tilt_that_were_computed(towers):
    for tower, _ in towers:
        pose, equilibrium = tower.pose, tower.equilibrium
        np.testing.assert_array_equal(pose[:, :2], tower.planar.xy)
        np.testing.assert_array_equal(pose[:, 2], equilibrium.z)
        np.testing.assert_allclose(np.linalg.norm(pose[:, 3:], axis=1), 1, atol=1e-15)
        tilt = Rotation.from_rotvec(np.column_stack([equilibrium.roll, equilibrium.pitch, 0 * equilibrium.roll]))
        expected = (tilt * Rotation.from_euler("z", tower.planar.yaw[:, None])).as_matrix()
        np.testing.assert_allclose(rotation_matrices(pose[:, 3:]), expected, atol=1e-4)
        assert np.abs([equilibrium.roll, equilibrium.pitch]).max() > 1e-3


def test_a_computed_tower_is_nearly_at_rest_in_the_simulator(towers):
    """Blocks of a level do not press each other apart, nor does a level slip on the one below, by more than a third of
    the error of a hand in 0.25 s. What adds up over twenty soft contacts is that the whole tower leans a little."""
    for tower, _ in towers:
        world = world_of(tower)
        world.step(125)
        moved = world.pose[:, :3] - tower.pose[:, :3]
        levels = tower.layout.level[:, None] == np.arange(tower.layout.level.max() + 1)
        mean = (levels.T @ moved) / levels.sum(axis=0)[:, None]
        assert np.linalg.norm(moved - levels @ mean, axis=1).max() < CONFIG.position_sigma / 3
        assert np.linalg.norm(np.diff(mean, axis=0), axis=1).max() < CONFIG.position_sigma / 3
        assert np.linalg.norm(moved, axis=1).max() < 0.001


SOFT = replace(PHYSICS, touch_impedance=0.5, impedance=0.99, impedance_width=2e-4)


@pytest.mark.parametrize(
    ("physics", "round_number", "seed"),
    [(PHYSICS, 1, 1), (PHYSICS, 2, 1), (PHYSICS, 1, 2), (SOFT, 1, 1), (SOFT, 2, 1)],
)
def test_a_short_tower_lies_and_bears_in_the_simulator_as_it_was_computed(physics, round_number, seed):
    """Only by the law of force of its contacts: no spring of constant stiffness comes within 80 µm of the heights."""
    standing = short_tower(round_number=round_number, seed=seed)
    equilibrium = solve(standing.blocks, standing.layout, standing.planar, physics.contact_law)
    tower = replace(standing, equilibrium=equilibrium)
    world = world_of(tower, physics=physics)
    world.step(250)
    moved = world.pose - tower.pose
    assert np.abs(moved[:, 2]).max() < 1e-5
    assert np.abs(moved[:, 3:]).max() < 3e-4

    carried = mean_load(world, 100)
    expected = np.array([equilibrium.load_on(block) for block in range(len(carried))])
    np.testing.assert_allclose(carried, expected, atol=0.01 * expected.max())


def mean_load(world: World, steps: int) -> np.ndarray:
    """What rests on each block over some steps [N]."""
    level, load = world.layout.level, np.zeros(len(world.blocks))
    for _ in range(steps):
        world.step()
        contacts = world.contacts()
        for first, second, up in zip(contacts.first, contacts.second, contacts.force[:, 2], strict=True):
            if second >= 0 and level[first] != level[second]:
                lower = first if level[first] < level[second] else second
                load[lower] += (up if lower == second else -up) / steps
    return load


# --- a target that sticks out --------------------------------------------------------------------------------------


@pytest.mark.parametrize("level", [0, 1])
def test_a_shifted_block_moves_along_its_own_x_and_no_other_moves(level):
    tower = short_tower()
    block = int(tower.layout.grid[level, 1])
    out = shifted(tower, block, 0.02, LAW)
    assert out is not None
    moved = out.planar.xy - tower.planar.xy
    np.testing.assert_allclose(moved[block], 0.02 * rotation_matrices(tower.pose[block, 3:])[:2, 0], atol=1e-4)
    assert not np.delete(moved, block, axis=0).any()
    assert out.equilibrium.stands
    assert out.layout is tower.layout


def test_a_block_shifted_out_of_its_support_is_no_tower():
    tower = short_tower()
    assert shifted(tower, int(tower.layout.grid[3, 1]), 0.06, LAW) is None
