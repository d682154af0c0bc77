"""The simulator that answers plans: what it sees, what it says, and how it is trained."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from fake_towers import FakeDataset, fake_dataset, small_episode, small_tower

from jenga_data.errors import JengaError
from jenga_data.graph_spec import graph_spec
from jenga_data.tower import TowerState
from jenga_models.ahead import answers_plans, plan_ahead, rows_of
from jenga_models.batch import Batch
from jenga_models.checkpoint import load
from jenga_models.columns import Towers
from jenga_models.config import DYNAMICS_PRESETS, DynamicsTraining
from jenga_models.features import Featurizer
from jenga_models.graphs import Graphs
from jenga_models.metrics import predict_dynamics, rollout_dynamics, windows
from jenga_models.motion import MILLIMETRE, NODE_WIDTH, PAIR_WIDTH, STEP, Bodies, node_features, pair_features, pairs
from jenga_models.normalisation import Normalisation
from jenga_models.overlay import predict_one_step, predict_open_loop
from jenga_models.plans import chains, lags, mirrored, worth_learning
from jenga_models.predict import LearnedDynamics
from jenga_models.registry import build
from jenga_models.rotations import between, turned
from jenga_models.store import GraphStore

SPEC = graph_spec("G_e+motion")
CONFIG = replace(DYNAMICS_PRESETS["best"], width=16, decoder_width=16, layers=2, accelerator="cpu")
FEATURIZER = Featurizer(SPEC, "down", False, Normalisation.none(SPEC.node_width, 0))


def moving(data: FakeDataset) -> FakeDataset:
    """The same towers, each block with some velocity that means nothing."""
    rng = np.random.default_rng(1)
    shape = (*data.columns["block_mass"].shape, 6)
    data.columns["block_twist"] = rng.normal(0, 0.001, shape).astype(np.float32)
    data.columns["next_twist"] = rng.normal(0, 0.001, shape).astype(np.float32)
    data.columns["target_clear"] = np.zeros(len(data), bool)
    return data


@pytest.fixture(scope="module")
def data() -> FakeDataset:
    return moving(fake_dataset("dynamics", 60))


@pytest.fixture(scope="module")
def path(data: FakeDataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from jenga_models.train import train_dynamics

    config = replace(CONFIG, epochs=25, learning_rate=1e-2, batch_size=8)
    return train_dynamics(data, config, tmp_path_factory.mktemp("models") / "factored").path


def network(seed: int = 3) -> torch.nn.Module:
    return build(replace(CONFIG, seed=seed), SPEC, FEATURIZER.edge_width).eval()


def flat(data: FakeDataset, rows: torch.Tensor, steps: int = 3) -> Graphs:
    rng = np.random.default_rng(5)
    towers = Towers.of_dataset(data, moving=True)
    store = GraphStore.of(SPEC, towers, lag=rng.normal(0, 1e-3, (len(data), 3)))
    plans = torch.tensor(rng.normal(0, 1e-3, (len(rows), steps, 3))).float()
    return replace(store.batch(FEATURIZER, rows), action=plans)


def test_features_are_as_many_as_they_say(data: FakeDataset):
    graphs = flat(data, torch.arange(4))
    bodies = Bodies.of(graphs.node)
    index, kind = pairs(graphs, bodies)
    target = graphs.spread(graphs.at_target(bodies.position))
    assert graphs.lag is not None
    assert node_features(bodies, target, graphs.spread(graphs.lag), graphs.graph).shape[1] == NODE_WIDTH
    assert pair_features(bodies, index, kind).shape == (len(kind), PAIR_WIDTH)
    graph = torch.arange(4).repeat_interleave(6)
    assert (graph[index[0]] == graph[index[1]]).all()
    assert kind.bincount().tolist() == [graphs.edge_index.shape[1]] * 2 + [4 * 2 * 6]  # two levels, six ordered pairs


@pytest.mark.parametrize("network_seed", [0, 1])
def test_where_the_tower_stands_changes_nothing(data: FakeDataset, network_seed: int):
    net, graphs = network(network_seed), flat(data, torch.arange(4))
    moved = graphs.node.clone()
    moved[:, 5:7] += torch.tensor([0.05, -0.03])
    with torch.inference_mode():
        torch.testing.assert_close(net(graphs), net(replace(graphs, node=moved)), atol=2e-6, rtol=0)


def test_which_end_of_a_block_is_which_changes_nothing(data: FakeDataset):
    """A block turned by half a turn about its own z or x is the same box."""
    net, graphs = network(), flat(data, torch.arange(4))
    w, x, y, z = graphs.node[:, 8:12].unbind(-1)
    with torch.inference_mode():
        for half_turn in ((-z, y, -x, w), (-x, w, z, -y), (-w, -x, -y, -z)):
            other = graphs.node.clone()
            other[::2, 8:12] = torch.stack(half_turn, dim=-1)[::2]
            torch.testing.assert_close(net(graphs), net(replace(graphs, node=other)), atol=2e-6, rtol=0)


def test_the_order_of_blocks_changes_nothing(data: FakeDataset):
    net, graphs = network(), flat(data, torch.arange(1))
    order = torch.tensor([3, 0, 5, 1, 4, 2])
    place = order.argsort()
    shuffled = replace(
        graphs, node=graphs.node[order], edge_index=place[graphs.edge_index], target=place[graphs.target]
    )
    with torch.inference_mode():
        torch.testing.assert_close(net(graphs)[order], net(shuffled), atol=2e-6, rtol=0)


def test_velocities_poses_and_the_lag_of_the_hand_matter(data: FakeDataset):
    net, graphs = network(), flat(data, torch.arange(4))
    assert graphs.lag is not None
    with torch.inference_mode():
        said = net(graphs)
        for column, change in ((6, 1e-4), (12, 0.02), (2, 1e-4), (3, 1e-3)):
            other = graphs.node.clone()
            other[1, column] += change
            assert (net(replace(graphs, node=other)) - said).abs().max() > 1e-7
        assert (net(replace(graphs, lag=graphs.lag + 1e-3)) - said).abs().max() > 1e-7


def test_a_step_does_not_see_the_actions_after_it(data: FakeDataset):
    net, graphs = network(), flat(data, torch.arange(4), steps=4)
    assert graphs.action is not None
    later = graphs.action.clone()
    later[:, 2:] += 1e-3
    with torch.inference_mode():
        one, other = net(graphs), net(replace(graphs, action=later))
    torch.testing.assert_close(one[:, :2], other[:, :2], atol=0, rtol=0)
    assert (one[:, 2] - other[:, 2]).abs().max() > 1e-7


def test_a_mirror_seen_in_a_mirror_is_the_thing(data: FakeDataset):
    batch = Batch(flat(data, torch.arange(3)), torch.randn(18, 3, 13))
    once = mirrored(batch, FEATURIZER)
    twice = mirrored(once, FEATURIZER)
    assert (once.graphs.node != batch.graphs.node).any()
    for name in ("node", "action", "lag"):
        torch.testing.assert_close(getattr(twice.graphs, name), getattr(batch.graphs, name), atol=0, rtol=0)
    torch.testing.assert_close(twice.wanted, batch.wanted, atol=0, rtol=0)
    # Mirrored rotations are those of the mirrored poses: y and the axes x and z turn round.
    turn = between(batch.graphs.node[:1, 8:12], batch.graphs.node[1:2, 8:12])
    seen = between(once.graphs.node[:1, 8:12], once.graphs.node[1:2, 8:12])
    torch.testing.assert_close(seen, turn * torch.tensor([-1.0, 1.0, -1.0]), atol=1e-6, rtol=0)


def test_rotations_there_and_back():
    torch.manual_seed(0)
    quat = torch.nn.functional.normalize(torch.randn(50, 4, dtype=torch.float64), dim=-1)
    rotation = torch.randn(50, 3, dtype=torch.float64).clamp(-1.7, 1.7)  # below half a turn
    rotation[0] = 0.0
    torch.testing.assert_close(between(quat, turned(quat, rotation)), rotation)
    torch.testing.assert_close(between(quat, -turned(quat, rotation)), rotation)


def test_chains_follow_an_episode_and_end_with_it():
    episode = np.array(["b", "a", "a", "b", "a", "b"])
    frame = np.array([4, 1, 2, 5, 4, 7])
    chain, made = chains(episode, frame, 3)
    assert made.tolist() == [[True, True, False], [True, True, False]] + [[True, False, False]] * 4
    assert (chain[0, 1], chain[1, 1]) == (3, 2)


def test_the_lag_is_what_the_target_fell_short(data: FakeDataset):
    """The made-up target follows the action, and each row is a tower of its own: what is missing is the difference."""
    found = lags(data)
    frame, target = data.column("frame"), data.column("target").astype(int)
    np.testing.assert_array_equal(found[frame == 0], 0.0)
    rows = np.arange(len(data))
    moved = data.column("next_pose")[rows, target, :3].astype(float) - data.column("block_pose")[rows, target, :3]
    short = data.column("action") - moved
    np.testing.assert_allclose(found[3], short[:3].sum(0), atol=1e-12)
    data = moving(fake_dataset("dynamics", 10))
    data.columns["next_pose"][np.arange(10), data.columns["target"], 0] -= 1e-3
    np.testing.assert_allclose(lags(data)[1:5, 0], 1e-3 * np.arange(1, 5), atol=1e-6)


def test_rows_of_a_fallen_tower_teach_nothing_and_those_after_the_pull_little(data: FakeDataset):
    columns = data.columns | {"collapsed": np.arange(60) == 7, "target_clear": np.arange(60) >= 50}
    keep = worth_learning(FakeDataset(columns, data.edge, data.split, data.manifest))
    assert not keep[7]
    assert keep[:50].sum() == 49
    assert 0 < keep[50:].sum() < 5


def test_training_learns_the_made_up_motion_and_a_loaded_model_says_the_same(path: Path, data: FakeDataset):
    rows = np.flatnonzero(data.column("frame") >= 0)
    predicted = predict_dynamics(path, data, rows)[..., :3]
    now, after, target = data.column("block_pose"), data.column("next_pose"), data.column("target").astype(int)
    error = np.linalg.norm(predicted - after[rows, :, :3], axis=-1)[rows, target[rows]]
    trivial = np.linalg.norm(after[..., :3] - now[..., :3], axis=-1)[rows, target[rows]]
    assert np.median(error) < 0.3 * np.median(trivial)
    np.testing.assert_array_equal(predict_dynamics(load(path), data, rows)[..., :3], predicted)
    assert answers_plans(load(path))


def test_resuming_gives_the_same_weights(data: FakeDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from jenga_models import train
    from jenga_models.callbacks import MetricLog

    config = replace(CONFIG, epochs=3, patience=0, train_on_validation=True)
    whole = train.train_dynamics(data, config, tmp_path / "whole")
    log = MetricLog.on_train_epoch_end

    def interrupted(self: MetricLog, trainer, pl_module) -> None:
        log(self, trainer, pl_module)
        if len(self.rows) == 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(MetricLog, "on_train_epoch_end", interrupted)
        with pytest.raises(KeyboardInterrupt):
            train.train_dynamics(data, config, tmp_path / "parts")
    assert train.train_dynamics(data, config, tmp_path / "parts", resume=True).hash == whole.hash


def test_the_controllers_answers_are_the_evaluations(path: Path, rng: np.random.Generator):
    state = small_tower(rng)
    state = TowerState(state.blocks, state.layout, state.pose, rng.normal(0, 0.01, state.twist.shape))
    target, plans, lag = int(state.layout.grid[0, 0]), rng.normal(0, 1e-3, (4, 5, 3)), rng.normal(0, 1e-3, 3)
    dynamics = LearnedDynamics(path)
    dynamics.start(state, target, lag)
    said = dynamics.rollout(torch.tensor(plans).float())
    assert said.shape == (4, 6, 6, 7)
    blocks, layout = state.blocks, state.layout
    towers = Towers.of_poses(
        blocks.size[None],
        blocks.mass[None],
        state.pose[None],
        layout.level[None],
        layout.slot[None],
        np.array([target]),
        state.twist[None],
    )
    for plan, answer in zip(plans, said, strict=True):
        expected = plan_ahead(load(path), towers, plan[None], lag[None]).pose[0]
        np.testing.assert_allclose(answer[1:], expected, atol=2e-6)
        np.testing.assert_allclose(answer[0], state.pose, atol=1e-6)
    dynamics.start(state, target)
    assert not torch.allclose(dynamics.rollout(torch.tensor(plans).float()), said, atol=1e-7)


def test_single_steps_are_refused(path: Path, rng: np.random.Generator):
    dynamics, state = LearnedDynamics(path), small_tower(rng)
    dynamics.start(state, 0)
    with pytest.raises(JengaError, match="takes no single steps; use rollout"):
        dynamics.step(torch.tensor(state.pose).float()[None], torch.zeros(1, 3))


def test_long_plans_are_answered_piece_by_piece(path: Path, data: FakeDataset):
    checkpoint, rows = load(path), np.array([0, 7])
    towers = rows_of(Towers.of_dataset(data, moving=True), rows)
    assert [len(part) for part in np.split(towers.upper, towers.offset[1:-1])] == np.diff(towers.offset).tolist()
    plans = np.random.default_rng(0).normal(0, 1e-3, (2, 7, 3))
    whole = plan_ahead(checkpoint, towers, plans)
    first = plan_ahead(checkpoint, towers, plans[:, :5])
    np.testing.assert_array_equal(whole.pose[:, :5], first.pose)
    again = Towers.of_poses(
        towers.block_size, towers.block_mass, first.pose[:, -1], towers.level, towers.slot, towers.target, first.twist
    )
    np.testing.assert_allclose(
        plan_ahead(checkpoint, again, plans[:, 5:], first.lag).pose, whole.pose[:, 5:], atol=1e-9
    )
    way = first.pose[[0, 1], -1, towers.target, :3] - towers.block_pose[[0, 1], towers.target, :3]
    np.testing.assert_allclose(first.lag, plans[:, :5].sum(1) - way, atol=1e-9)


def test_rollouts_start_with_the_one_step_prediction(path: Path, data: FakeDataset):
    window = windows(data, data.rows("test"), 3)
    rolled = rollout_dynamics(path, data, window)
    np.testing.assert_allclose(rolled[:, 0], predict_dynamics(path, data, window[:, 0]), atol=1e-6)


def test_predictions_of_an_episode_are_those_of_its_rows(path: Path):
    episode = small_episode()
    one, loop = predict_one_step(path, episode), predict_open_loop(path, episode)
    np.testing.assert_allclose(one.pose[0], loop.pose[0], atol=1e-6)
    assert one.pose.shape == loop.pose.shape == episode.pose[1:].shape


def test_a_block_at_rest_of_an_untrained_model_hardly_moves(data: FakeDataset):
    graphs = flat(data, torch.arange(4))
    assert graphs.action is not None
    still = graphs.node.clone()
    still[:, 12:] = 0.0
    with torch.inference_mode():
        said = network()(replace(graphs, node=still, action=torch.zeros_like(graphs.action)))
    assert said[..., :3].abs().max() < MILLIMETRE
    assert pytest.approx(0.032) == STEP


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"graph": "G_e"}, "makes its own features"),
        ({"scale_features": True}, "makes its own features"),
        ({"horizon": 0}, "horizon is 0"),
        ({"softness": 0.0}, "softness is 0.0"),
    ],
)
def test_settings_that_do_not_fit_are_refused(change: dict, message: str):
    with pytest.raises(JengaError, match=message):
        replace(CONFIG, **change)
    assert DynamicsTraining().model == "gns"


def test_a_model_of_poses_refuses_a_graph_whose_velocities_it_cannot_go_on_with():
    with pytest.raises(JengaError, match="holds velocities, which gns does not predict"):
        DynamicsTraining(graph="G_e+motion")


def test_a_network_that_says_nothing_lets_blocks_go_on_and_the_target_follow_the_hand(data: FakeDataset):
    graphs, net = flat(data, torch.arange(4)), network()
    assert graphs.action is not None
    with torch.no_grad():
        net.get_submodule("motion").weight.zero_()  # pyright: ignore[reportCallIssue]
        said = net(graphs)[..., :6]
    goes_on = (graphs.node[:, 12:] * STEP)[:, None].expand_as(said)
    followed = graphs.action[torch.arange(4).repeat_interleave(6)]
    is_target = torch.zeros(24, dtype=torch.bool)
    is_target[graphs.target] = True
    torch.testing.assert_close(said[~is_target], goes_on[~is_target])
    torch.testing.assert_close(said[is_target][..., :3], followed[is_target])
    assert not said[is_target][..., 3:].any()
