from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from nominal_tower import layout_of, nominal_blocks, nominal_state
from scipy.spatial.transform import Rotation

from jenga_data.geometry import rotation_matrices
from jenga_data.tower import CENTRE, EMPTY, Layout, Place, TowerState, quarter_turns_for, turn_poses, turn_vectors


def play(moves: int, seed: int, blocks: int = 54) -> list[Layout]:
    """Layouts of a random game, the fresh one first; shorter if no move is left."""
    rng = np.random.default_rng(seed)
    layouts = [Layout.fresh(rng.permutation(blocks))]
    for _ in range(moves):
        layout = layouts[-1]
        if not (targets := layout.legal_targets()):
            break
        places = layout.next_places()
        layouts.append(layout.moved(int(rng.choice(targets)), places[rng.integers(len(places))]))
    return layouts


GAMES = [play(40, seed) for seed in range(4)]
LAYOUTS = [layout for game in GAMES for layout in game]


def random_state(seed: int, blocks: int = 6) -> TowerState:
    rng = np.random.default_rng(seed)
    yaw = rng.integers(2, size=blocks) * 90 + rng.normal(0, 3, blocks)
    tilt = rng.normal(0, 1, (blocks, 2))
    x, y, z, w = Rotation.from_euler("ZYX", np.column_stack([yaw, tilt]), degrees=True).as_quat().T
    pose = np.column_stack([rng.normal(size=(blocks, 3)), w, x, y, z])
    pose[:, 3:] *= np.where(w < 0, -1, 1)[:, None]
    layout = Layout.fresh(np.arange(blocks))
    return TowerState(nominal_blocks(blocks), layout, pose, rng.normal(size=(blocks, 6)))


# --- places --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", LAYOUTS[::10])
def test_from_places_is_the_inverse_of_level_and_slot(layout):
    again = Layout.from_places(layout.level, layout.slot, layout.moves)
    np.testing.assert_array_equal(again.grid, layout.grid)
    assert again.round == layout.round
    for block, place in layout:
        assert layout.place(block) == place == Place(int(layout.level[block]), int(layout.slot[block]))
        assert layout.grid[place.level, place.slot] == block


def test_a_fresh_tower_is_filled_from_the_bottom_in_the_given_order():
    order = np.random.default_rng(0).permutation(54)
    layout = Layout.fresh(order)
    np.testing.assert_array_equal(layout.level[order], np.repeat(np.arange(18), 3))
    np.testing.assert_array_equal(layout.slot[order], np.tile([0, 1, 2], 18))
    assert layout.round == 1
    assert len(Layout.fresh().level) == 54


def test_levels_alternate_in_direction():
    np.testing.assert_array_equal(Layout.fresh(np.arange(12)).orientation, np.repeat([0, 1, 0, 1], 3))


def test_layouts_that_cannot_be_are_refused(unchecked_shapes):
    with pytest.raises(ValueError, match="two blocks lie at one place"):
        Layout.from_places(np.array([0, 0]), np.array([1, 1]))
    with pytest.raises(ValueError, match="a block lies at two places"):
        Layout(np.array([[0, 1, 0]]))
    with pytest.raises(ValueError, match=r"3 slots a level, got an array of shape \(1, 2\)"):
        Layout(np.array([[0, 1]]))
    with pytest.raises(ValueError, match="7 blocks do not fill levels of 3"):
        Layout.fresh(np.arange(7))


# --- the rules -----------------------------------------------------------------------------------------------------

LEGAL = {
    # One level, or none complete: nothing lies below the highest completed level.
    ("xxx",): "",
    (".x.", "x.x"): "",
    # Below a completed top, any block of a full level: what remains has the centre, or is both sides.
    ("xxx", "xxx"): "012",
    ("xxx", "xxx", "xxx"): "012345",
    # The level under an incomplete top is the highest completed one: it is not below itself.
    ("xxx", "xxx", "x.."): "012",
    ("xxx", "xxx", "xx."): "012",
    # Two left: the side may go if the centre stays; the centre may not; of two sides neither.
    ("xx.", "xxx"): "0",
    (".xx", "xxx"): "1",
    ("x.x", "xxx"): "",
    # One left: it carries the tower.
    (".x.", "xxx"): "",
    ("x..", "xxx"): "",
    # Incomplete levels between complete ones, and below the highest completed one.
    ("xxx", ".xx", "xxx", ".x."): "0124",
    ("xxx", "x.x", "xxx", "xxx", "xx."): "012567",
}


@pytest.mark.parametrize(("levels", "legal"), LEGAL.items())
def test_legal_targets_of_small_towers(levels, legal):
    layout = layout_of(*levels)
    assert layout.legal_targets() == [int(c) for c in legal]
    assert [b for b, _ in layout if layout.is_legal(b)] == layout.legal_targets()


@pytest.mark.parametrize(
    ("levels", "highest"),
    [(("x.x", ".x."), -1), (("xxx",), 0), (("xxx", "xx."), 0), (("xxx", "x.x", "xxx", "x.."), 2)],
)
def test_highest_completed_level(levels, highest):
    assert layout_of(*levels).highest_completed() == highest


def test_legal_targets_come_in_the_order_of_their_numbers():
    assert Layout.fresh(np.arange(9)[::-1]).legal_targets() == [3, 4, 5, 6, 7, 8]


@pytest.mark.parametrize(
    ("levels", "places"),
    [
        (("xxx", "xxx"), [(2, 0), (2, 1), (2, 2)]),
        (("xxx", ".x."), [(1, 0), (1, 2)]),
        (("xxx", "xx."), [(1, 2)]),
        (("x.x", "xxx"), [(2, 0), (2, 1), (2, 2)]),
    ],
)
def test_a_level_is_completed_before_a_new_one_begins(levels, places):
    assert layout_of(*levels).next_places() == [Place(*p) for p in places]


@pytest.mark.parametrize("game", GAMES)
def test_a_move_keeps_every_other_block(game):
    assert len(game) > 20
    for before, after in pairwise(game):
        moved = [b for b, place in before if after.place(b) != place]
        assert len(moved) == 1
        assert before.is_legal(moved[0])
        assert after.place(moved[0]) in before.next_places()
        assert sorted(b for b, _ in after) == sorted(b for b, _ in before)
        assert after.round == before.round + 1
        assert (after.grid != EMPTY).any(axis=1).all()


@pytest.mark.parametrize("layout", LAYOUTS[::7])
def test_what_remains_under_the_top_can_stand_after_a_legal_move(layout):
    for target in layout.legal_targets():
        grid = layout.grid.copy()
        grid[grid == target] = EMPTY
        for row in grid[: layout.highest_completed()]:
            assert row[CENTRE] != EMPTY or (row != EMPTY).sum() == 2


def test_a_move_leaves_the_layout_it_started_from_alone():
    layout = Layout.fresh(np.arange(9))
    grid = layout.grid.copy()
    layout.moved(1, Place(3, 1))
    np.testing.assert_array_equal(layout.grid, grid)


def test_moves_against_the_rules_are_refused():
    layout = layout_of("xxx", "xxx", "x..")
    with pytest.raises(ValueError, match=r"block 3 is no legal target; legal: \[0, 1, 2\]"):
        layout.moved(3, Place(2, 1))
    for place in (Place(2, 0), Place(3, 0)):
        with pytest.raises(ValueError, match="is taken or floats"):
            layout.moved(1, place)


# --- turning -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("turns", [4, -4, 8])
def test_a_full_turn_changes_nothing(turns):
    state = random_state(0)
    np.testing.assert_array_equal(state.turned(turns).pose, state.pose)
    np.testing.assert_array_equal(state.turned(turns).twist, state.twist)


def test_four_quarter_turns_are_the_identity():
    state = random_state(1)
    turned = state.turned(1).turned(1).turned(1).turned(1)
    np.testing.assert_array_equal(turned.pose[:, :3], state.pose[:, :3])
    np.testing.assert_array_equal(turned.twist, state.twist)
    np.testing.assert_allclose(turned.pose, state.pose, atol=1e-15)


@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize("second", range(4))
def test_turns_add_up_to_the_same_numbers(first, second):
    """The same also in the sign of the quaternion: a model reads its four numbers."""
    state = random_state(2)
    np.testing.assert_allclose(state.turned(first).turned(second).pose, state.turned(first + second).pose, atol=1e-15)


@pytest.mark.parametrize("turns", range(-3, 4))
def test_turning_is_the_rotation_about_z(turns):
    state = random_state(3)
    turned = state.turned(turns)
    rotation = Rotation.from_euler("z", 90 * turns, degrees=True)
    np.testing.assert_allclose(turned.pose[:, :3], rotation.apply(state.pose[:, :3]), atol=1e-14)
    np.testing.assert_allclose(turned.twist[:, :3], rotation.apply(state.twist[:, :3]), atol=1e-14)
    np.testing.assert_allclose(turned.twist[:, 3:], rotation.apply(state.twist[:, 3:]), atol=1e-14)
    expected = rotation.as_matrix() @ rotation_matrices(state.pose[:, 3:])
    np.testing.assert_allclose(rotation_matrices(turned.pose[:, 3:]), expected, atol=1e-14)
    np.testing.assert_allclose(turn_poses(state.pose, turns * np.pi / 2), turned.pose, atol=1e-14)
    np.testing.assert_allclose(turn_vectors(state.pose[:, :3], turns), turned.pose[:, :3], atol=1e-14)


@pytest.mark.parametrize("turns", range(4))
def test_small_tilts_flip_no_quaternion(turns):
    """The sign does not hang on noise for any block of a tower that stands."""
    turned = np.stack([random_state(seed).turned(turns).pose[:, 3:] for seed in range(50)])
    reference = nominal_state(Layout.fresh(np.arange(6))).turned(turns).pose[:, 3:]
    yaw_0, yaw_90 = reference[0], reference[3]
    nearness = np.maximum(turned @ yaw_0, turned @ yaw_90)
    assert nearness.min() > 0.98


def test_turning_keeps_relative_poses():
    state = random_state(4)

    def relative(state: TowerState) -> np.ndarray:
        rotation = rotation_matrices(state.pose[:, 3:])
        between = state.pose[None, :, :3] - state.pose[:, None, :3]
        return np.concatenate(
            [
                np.einsum("iba,ijb->ija", rotation, between),
                np.einsum("iba,jbc->ijac", rotation, rotation).reshape(6, 6, 9),
            ],
            axis=-1,
        )

    for turns in range(1, 4):
        np.testing.assert_allclose(relative(state.turned(turns)), relative(state), atol=1e-13)


@pytest.mark.parametrize("face", [0, 1])
@pytest.mark.parametrize("target", range(6))
def test_the_target_is_turned_along_x_with_the_chosen_end_at_minus_x(target, face):
    state = nominal_state(Layout.fresh(np.arange(6)))
    turned = state.turned(quarter_turns_for(state.layout, target, face)).pose[target]
    own_x = rotation_matrices(turned[3:])[:, 0]
    chosen_end = (2 * face - 1) * own_x  # face 0 is the end at -x in the block's own frame, 1 the one at +x
    np.testing.assert_allclose(chosen_end, [-1, 0, 0], atol=1e-12)


def test_a_state_needs_one_pose_and_one_twist_a_block(unchecked_shapes):
    state = nominal_state(Layout.fresh(np.arange(3)))
    with pytest.raises(ValueError, match="3 blocks, 2 poses, 3 twists"):
        replace(state, pose=state.pose[:2])
