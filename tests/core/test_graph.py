from dataclasses import replace

import numpy as np
import pytest
from nominal_tower import layout_of, nominal_state

from jenga_data.errors import JengaError
from jenga_data.graph import node_features, support_edges, support_matrix
from jenga_data.graph_spec import FEATURE_WIDTH, GRAPHS, GraphSpec, graph_spec
from jenga_data.tower import Layout, nominal_poses

FRESH = nominal_state(Layout.fresh(np.arange(54)))
SMALL = nominal_state(layout_of("xxx", "x.x", "xxx", ".x."))


def pairs(edges: np.ndarray) -> set[tuple[int, int]]:
    return set(map(tuple, edges.T.tolist()))


# --- edges ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("air", [0.0, 0.0002])
def test_a_fresh_tower_has_nine_edges_between_levels_and_no_others(air):
    edges = support_edges(nominal_poses(FRESH.layout, air), FRESH.blocks.size)
    level = FRESH.layout.level
    assert len(pairs(edges)) == edges.shape[1] == 17 * 9
    np.testing.assert_array_equal(level[edges[0]], level[edges[1]] + 1)


def test_edges_of_a_small_tower():
    """Levels xxx, x.x, xxx, .x. hold blocks 012, 34, 567, 8."""
    edges = support_edges(SMALL.pose, SMALL.blocks.size)
    below = {3: {0, 1, 2}, 4: {0, 1, 2}, 5: {3, 4}, 6: {3, 4}, 7: {3, 4}, 8: {5, 6, 7}}
    assert pairs(edges) == {(upper, lower) for upper, lowers in below.items() for lower in lowers}


def test_edges_are_sorted_so_that_a_tower_has_one_list():
    edges = support_edges(FRESH.turned(1).pose, FRESH.blocks.size)
    np.testing.assert_array_equal(edges, edges[:, np.lexsort((edges[1], edges[0]))])
    assert edges.dtype == np.int64


@pytest.mark.parametrize("turns", range(4))
def test_edges_do_not_change_when_the_tower_is_turned_or_moved(turns):
    turned = SMALL.turned(turns).pose
    turned[:, :3] += [0.3, -0.1, 0.7]
    np.testing.assert_array_equal(
        support_edges(turned, SMALL.blocks.size), support_edges(SMALL.pose, SMALL.blocks.size)
    )


def test_edges_follow_the_numbering_of_the_blocks():
    order = np.random.default_rng(0).permutation(len(SMALL.pose))  # new block i is the old block order[i]
    renumbered = support_edges(SMALL.pose[order], SMALL.blocks.size[order])
    assert pairs(order[renumbered]) == pairs(support_edges(SMALL.pose, SMALL.blocks.size))


@pytest.mark.parametrize("where", [[0.4, 0.0, 0.0], [0.0, 0.0, 0.3]])
def test_a_removed_block_has_no_edge_and_the_others_keep_theirs(where):
    pose = FRESH.pose.copy()
    pose[25, :3] += where
    before, after = (pairs(support_edges(p, FRESH.blocks.size)) for p in (FRESH.pose, pose))
    assert after == {pair for pair in before if 25 not in pair}
    assert len(before) - len(after) == 6


@pytest.mark.parametrize(
    ("shift", "joined"),
    [
        ([0, 0, 0.001 - 1e-6], True),
        ([0, 0, 0.001 + 1e-6], False),
        ([0, 0, -0.005 + 1e-6], True),
        ([0, 0, -0.005 - 1e-6], False),
        ([0.049 - 1e-6, 0, 0], True),
        ([0.049 + 1e-6, 0, 0], False),
    ],
)
def test_edges_end_where_the_gap_or_the_overlap_says(shift, joined):
    """1 mm of air, 5 mm of sinking; and 1 mm of overlap: a block along y leaves one along x after 50 mm."""
    state = nominal_state(layout_of(".x.", ".x."))
    pose = state.pose.copy()
    pose[1, :3] += shift
    assert pairs(support_edges(pose, state.blocks.size)) == ({(1, 0)} if joined else set())


def test_a_batch_of_towers_is_a_loop():
    pose = np.stack([SMALL.turned(k).pose + np.array([0, 0, 0.1 * k, 0, 0, 0, 0]) for k in range(4)])
    pose[2, 3, 0] += 0.5
    together = support_matrix(pose, SMALL.blocks.size)
    for k in range(4):
        np.testing.assert_array_equal(np.stack(np.nonzero(together[k])), support_edges(pose[k], SMALL.blocks.size))
    assert (together[2] != together[1]).any()


# --- nodes ---------------------------------------------------------------------------------------------------------


TWIST = np.random.default_rng(2).normal(size=(len(SMALL.pose), 6))


def features(spec: GraphSpec, target: int, batch: tuple[int, ...] = ()) -> np.ndarray:
    def repeat(values: np.ndarray) -> np.ndarray:
        return np.broadcast_to(values, (*batch, *values.shape))

    return node_features(
        spec,
        block_size=repeat(SMALL.blocks.size),
        block_mass=repeat(SMALL.blocks.mass),
        block_pose=repeat(SMALL.pose),
        level=repeat(SMALL.layout.level),
        slot=repeat(SMALL.layout.slot),
        target=np.full(batch, target),
        block_twist=repeat(TWIST),
    )


@pytest.mark.parametrize("spec", GRAPHS.values(), ids=GRAPHS)
def test_node_features_stand_in_the_order_of_the_spec(spec):
    got = features(spec, target=4)
    assert got.shape == (len(SMALL.pose), spec.node_width)
    start = 0
    for name in spec.node_features:
        alone = features(GraphSpec("alone", (name,)), target=4)
        assert alone.shape[1] == FEATURE_WIDTH[name]
        np.testing.assert_array_equal(got[:, start : start + FEATURE_WIDTH[name]], alone)
        start += FEATURE_WIDTH[name]
    backwards = GraphSpec("backwards", spec.node_features[::-1])
    np.testing.assert_array_equal(
        features(backwards, 4)[:, : FEATURE_WIDTH[spec.node_features[-1]]],
        got[:, -FEATURE_WIDTH[spec.node_features[-1]] :],
    )


def test_node_features_hold_what_their_names_say():
    every = GraphSpec(
        "every",
        ("block_size", "block_mass", "block_pose", "target_flag", "level", "slot", "orientation", "block_twist"),
    )
    size, mass, pose, flag, level, slot, orientation, twist = np.split(
        features(every, 4), [3, 4, 11, 12, 13, 16, 17], axis=1
    )
    np.testing.assert_array_equal(twist, TWIST)
    np.testing.assert_array_equal(size, SMALL.blocks.size)
    np.testing.assert_array_equal(mass[:, 0], SMALL.blocks.mass)
    np.testing.assert_array_equal(pose, SMALL.pose)
    np.testing.assert_array_equal(flag[:, 0], [0, 0, 0, 0, 1, 0, 0, 0, 0])
    np.testing.assert_array_equal(level[:, 0], SMALL.layout.level)
    np.testing.assert_array_equal(slot, np.eye(3)[SMALL.layout.slot])
    np.testing.assert_array_equal(orientation[:, 0], SMALL.layout.orientation)


def test_one_block_is_flagged_in_each_tower_of_a_batch():
    targets = np.array([[0, 8], [3, 3]])
    got = node_features(
        GraphSpec("flag", ("target_flag",)),
        block_size=np.zeros((2, 2, 9, 3)),
        block_mass=np.zeros((2, 2, 9)),
        block_pose=np.zeros((2, 2, 9, 7)),
        level=np.zeros((2, 2, 9), np.int64),
        slot=np.zeros((2, 2, 9), np.int64),
        target=targets,
    )
    np.testing.assert_array_equal(got[..., 0], np.eye(9)[targets])


# --- the graphs by name --------------------------------------------------------------------------------------------


def test_the_graphs_of_the_paper():
    """Section II-B: dimensions, weight, target flag, and the pose in G_sp; II-C: the pose instead of the dimensions,
    and the action."""
    assert set(GRAPHS["G_s"].node_features) == {"block_size", "block_mass", "target_flag"}
    assert set(GRAPHS["G_sp"].node_features) == {*GRAPHS["G_s"].node_features, "block_pose"}
    assert set(GRAPHS["G_e"].node_features) == {"block_mass", "block_pose", "target_flag"}
    assert [spec.action for spec in GRAPHS.values()] == [name.startswith("G_e") for name in GRAPHS]
    widths = {"G_s": 5, "G_sp": 12, "G_s+layout": 10, "G_e": 9, "G_e+motion": 18}
    assert {name: graph_spec(name).node_width for name in GRAPHS} == widths


def test_an_unknown_graph_is_refused_with_the_known_ones():
    with pytest.raises(JengaError, match=r"'G_x'; allowed: G_s, G_sp, G_s\+layout, G_e, G_e\+motion$"):
        graph_spec("G_x")


def test_an_unknown_feature_is_refused_with_the_known_ones():
    with pytest.raises(JengaError, match=r"\['colour'\]; allowed: block_size, block_mass, target_flag"):
        replace(GRAPHS["G_s"], node_features=("block_mass", "colour"))
