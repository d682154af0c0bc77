"""Laws of features: one code path for rows, live towers and predictions; scaling there and back."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from fake_towers import FakeDataset, small_tower

from jenga_data.errors import CheckFailed
from jenga_data.graph_spec import GRAPHS, GraphSpec
from jenga_models.columns import Towers
from jenga_models.config import DYNAMICS_PRESETS
from jenga_models.features import Featurizer, attribute_width, edge_attributes, feature_slices, raw_nodes
from jenga_models.normalisation import Normalisation
from jenga_models.scaling import fit_features, fit_targets
from jenga_models.store import GraphStore

WITH_SIZES = GraphSpec("G_e and sizes", ("block_size", "block_mass", "target_flag", "block_pose"), action=True)


def fitted(spec: GraphSpec, data: FakeDataset) -> tuple[Featurizer, GraphStore]:
    config = replace(DYNAMICS_PRESETS["fast"], graph="G_e")
    store = GraphStore.of(spec, Towers.of_dataset(data), data.column("action"))
    return Featurizer(spec, config.flow, True, fit_features(config, spec, store, data.rows("train"))), store


@pytest.mark.parametrize("spec", [GRAPHS["G_s+layout"], GRAPHS["G_e"], WITH_SIZES], ids=lambda s: s.name)
def test_training_rows_come_out_with_mean_0_and_scale_1(spec: GraphSpec, dynamics_data: FakeDataset):
    featurizer, store = fitted(spec, dynamics_data)
    graphs = store.batch(featurizer, torch.from_numpy(dynamics_data.rows("train")))
    for name, at in feature_slices(spec).items():
        values = graphs.node[:, at]
        if name in ("target_flag", "slot", "orientation"):
            assert set(values.unique().tolist()) <= {0.0, 1.0}
        elif name != "block_pose":  # of a quaternion two parts hardly vary, and are not blown up
            torch.testing.assert_close(values.mean(0), torch.zeros(values.shape[1]), atol=1e-4, rtol=0)
            torch.testing.assert_close(values.std(0), torch.ones(values.shape[1]), atol=1e-2, rtol=0)
    down = graphs.edge[: graphs.edge.shape[0] // 2, 1:]
    assert down.shape[1] == attribute_width(spec)
    torch.testing.assert_close(down.mean(0), torch.zeros(down.shape[1]), atol=1e-3, rtol=0)


def test_normalisation_survives_json_bit_by_bit(dynamics_data: FakeDataset):
    before = fitted(WITH_SIZES, dynamics_data)[0].normalisation
    after = Normalisation.from_json(json.loads(json.dumps(before.to_json())), WITH_SIZES.node_width, 8)
    assert all(torch.equal(value, vars(after)[name]) for name, value in vars(before).items())


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("node_scale", [1.0], "shape"),
        ("action_scale", [1, 0, 1], "not positive"),
        ("edge_mean", "x", "lacks"),
        ("delta_mean", [[float("nan")] * 7] * 2, "not finite"),
    ],
)
def test_normalisation_that_cannot_be_is_refused(name: str, value: object, message: str):
    plain = Normalisation.none(5, 0).to_json() | {name: value}
    with pytest.raises(CheckFailed, match=message):
        Normalisation.from_json(plain, 5, 0)


def test_a_live_tower_gives_the_same_graph_as_its_row(rng: np.random.Generator):
    state = small_tower(rng)
    target = int(state.layout.grid[0, 1])
    size, mass, pose = (a[None].astype(np.float32) for a in (state.blocks.size, state.blocks.mass, state.pose))
    row = Towers.of_poses(
        size,
        mass,
        pose,
        state.layout.level[None],
        state.layout.slot[None],
        np.array([target]),
    )
    live = Towers.of_state(state, np.array([target]))
    assert torch.equal(raw_nodes(GRAPHS["G_sp"], row), raw_nodes(GRAPHS["G_sp"], live))
    assert np.array_equal([row.upper, row.lower], [live.upper, live.lower])


def test_a_target_across_is_turned_to_lie_along_x(rng: np.random.Generator):
    state = small_tower(rng)
    above, below = int(state.layout.grid[1, 0]), int(state.layout.grid[0, 0])
    turned, as_it_is = Towers.of_state(state, np.array([above, below])).block_pose
    assert np.array_equal(as_it_is, state.pose)
    np.testing.assert_allclose(turned, state.turned(-1).pose, atol=1e-12)


def test_edge_attributes_do_not_change_when_the_tower_is_moved(rng: np.random.Generator):
    towers = Towers.of_state(small_tower(rng), np.array([0]))
    moved = replace(towers, block_pose=towers.block_pose + np.array([0.3, -0.2, 0.1, 0, 0, 0, 0]))
    ends = torch.from_numpy(towers.upper), torch.from_numpy(towers.lower)
    here, there = (edge_attributes(WITH_SIZES, raw_nodes(WITH_SIZES, t), *ends) for t in (towers, moved))
    torch.testing.assert_close(here, there, atol=1e-6, rtol=0)


def test_edge_attributes_do_not_see_the_sign_of_a_quaternion(rng: np.random.Generator):
    towers = Towers.of_state(small_tower(rng), np.array([0]))
    flipped = towers.block_pose.copy()
    flipped[:, ::2, 3:] *= -1
    ends = torch.from_numpy(towers.upper), torch.from_numpy(towers.lower)
    poses = (towers, replace(towers, block_pose=flipped))
    here, there = (edge_attributes(WITH_SIZES, raw_nodes(WITH_SIZES, t), *ends) for t in poses)
    torch.testing.assert_close(here, there)


def test_edge_attributes_hold_the_gap_between_blocks(rng: np.random.Generator):
    state = small_tower(rng)
    towers = Towers.of_state(state, np.array([0]))
    lifted = state.pose.copy()
    upper = int(towers.upper[0])
    lifted[upper, 2] += 5e-5
    ends = torch.from_numpy(towers.upper), torch.from_numpy(towers.lower)
    rows = [raw_nodes(WITH_SIZES, t) for t in (towers, replace(towers, block_pose=lifted[None]))]
    change = (
        edge_attributes(WITH_SIZES, rows[1], *ends)[0, :, -1] - edge_attributes(WITH_SIZES, rows[0], *ends)[0, :, -1]
    )
    torch.testing.assert_close(change, torch.from_numpy(5e-5 * (towers.upper == upper)).float(), atol=1e-7, rtol=0)


def test_targets_by_role_have_one_scale_each_and_leave_collapses_out():
    delta = torch.zeros(4, 3, 7)
    delta[:, 0], delta[:, 1:] = 2.0, 0.5
    delta[3] = 100.0
    is_target = torch.tensor([[1.0, 0, 0]] * 4)
    standing = np.array([True, True, True, False])
    mean, scale = fit_targets("role", delta, is_target, standing)
    assert torch.equal(mean, torch.zeros(2, 7))
    torch.testing.assert_close(scale, torch.tensor([[0.5], [2.0]]).expand(2, 7))
    assert torch.equal(fit_targets("none", delta, is_target, standing)[1], torch.ones(2, 7))
