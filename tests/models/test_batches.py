"""Batches gathered from stacked tensors, against torch_geometric's own, and the order they come in."""

from typing import Any

import numpy as np
import pytest
import torch
from fake_towers import FakeDataset
from torch_geometric.data import Batch as PygBatch
from torch_geometric.data import Data

from jenga_data.graph_spec import GRAPHS
from jenga_models.columns import Towers
from jenga_models.config import Flow
from jenga_models.data import Batches, GraphData
from jenga_models.features import Featurizer
from jenga_models.normalisation import Normalisation
from jenga_models.ready import ReadyStore
from jenga_models.store import EpochOrder, GraphStore

SPEC = GRAPHS["G_e"]


def store_of(data: FakeDataset) -> GraphStore:
    return GraphStore.of(SPEC, Towers.of_dataset(data), data.column("action"))


def featurizer(flow: Flow = "down") -> Featurizer:
    return Featurizer(SPEC, flow, False, Normalisation.none(SPEC.node_width, 0))


def test_a_batch_equals_torch_geometrics_of_the_same_graphs(dynamics_data: FakeDataset):
    store, rows = store_of(dynamics_data), torch.tensor([7, 3, 3, 40])
    graphs, edges, action = store.batch(featurizer(), rows), dynamics_data.edges(), dynamics_data.column("action")
    pairs = np.stack([edges.upper, edges.lower]).astype(np.int64)
    composed: Any = PygBatch.from_data_list(
        [
            Data(
                x=store.node[row],
                edge_index=torch.tensor(pairs[:, edges.offset[row] : edges.offset[row + 1]]),
                action=torch.tensor(action[row][None]),
                target_index=store.target[row],
            )
            for row in rows.tolist()
        ]
    )
    for ours, theirs in (
        (graphs.node, composed.x),
        (graphs.edge_index, composed.edge_index),
        (graphs.graph, composed.batch),
        (graphs.action, composed.action),
        (graphs.target, composed.target_index),
    ):
        assert ours is not None
        assert torch.equal(ours, theirs)


@pytest.mark.parametrize("flow", ["up", "both"])
def test_the_flow_turns_edges_round(dynamics_data: FakeDataset, flow: Flow):
    store, rows = store_of(dynamics_data), torch.arange(3)
    down = store.batch(featurizer(), rows)
    other = store.batch(featurizer(flow), rows)
    pairs = set(map(tuple, down.edge_index.T.tolist()))
    turned = {(b, a) for a, b in pairs}
    direction = {
        tuple(edge): sign for edge, sign in zip(other.edge_index.T.tolist(), other.edge[:, 0].tolist(), strict=True)
    }
    assert set(direction) == (turned if flow == "up" else pairs | turned)
    assert all(sign == (1 if edge in pairs else -1) for edge, sign in direction.items())


@pytest.mark.parametrize("flow", ["down", "up", "both"])
@pytest.mark.parametrize("attributes", [False, True])
def test_gathering_what_is_ready_gives_what_computing_it_gives(
    dynamics_data: FakeDataset, flow: Flow, attributes: bool, rng: np.random.Generator
):
    store, rows = store_of(dynamics_data), torch.tensor([7, 3, 3, 40])
    scaled = Normalisation.none(SPEC.node_width, 7 * attributes)
    values = {
        name: torch.from_numpy(rng.uniform(0.5, 2, part.shape).astype(np.float32))
        for name, part in vars(scaled).items()
    }
    scaled = Normalisation(**values)
    seen = Featurizer(SPEC, flow, attributes, scaled)
    computed, gathered = store.batch(seen, rows), ReadyStore.of(store, seen).batch(rows)
    for name, part in vars(computed).items():
        other = getattr(gathered, name)
        assert part is other is None or torch.equal(part, other), name


def test_a_run_resumed_in_mid_epoch_sees_what_an_uninterrupted_one_sees(dynamics_data: FakeDataset):
    store, rows = store_of(dynamics_data), dynamics_data.rows("train")

    def batches() -> Batches:
        return Batches(store, featurizer(), store.node[..., :1])

    whole = [batches()[chosen] for chosen in EpochOrder(rows, 8, seed=2).batches(5)]
    resumed = [batches()[chosen] for chosen in EpochOrder(rows, 8, seed=2).batches(5, position=4)]
    assert len(resumed) == len(whole) - 4 > 2
    for a, b in zip(whole[4:], resumed, strict=True):
        assert torch.equal(a.wanted, b.wanted)
        assert torch.equal(a.graphs.node, b.graphs.node)
        assert torch.equal(a.graphs.edge_index, b.graphs.edge_index)


def test_spread_mean_and_target_of_a_flat_batch_are_those_of_each_graph(dynamics_data: FakeDataset):
    store, rows = store_of(dynamics_data), torch.tensor([2, 9, 5])
    graphs = store.batch(featurizer(), rows)
    each = graphs.node.view(3, store.blocks, -1)
    torch.testing.assert_close(graphs.mean(graphs.node), each.mean(1))
    assert torch.equal(graphs.at_target(graphs.node), each[torch.arange(3), store.target[rows]])
    assert torch.equal(graphs.spread(rows[:, None].float()).view(3, -1), 1.0 * rows[:, None].expand(3, store.blocks))
    assert torch.equal(graphs.is_target().nonzero()[:, 0], graphs.target)


def test_order_is_a_function_of_seed_epoch_and_position():
    rows = np.arange(100, 153)
    order, again = EpochOrder(rows, 10, seed=4), EpochOrder(rows, 10, seed=4)
    list(again.batches(0))  # what was drawn before does not matter
    whole = list(order.batches(3))
    assert len(whole) == len(order) == 6
    for position in (0, 4):
        rest = list(again.batches(3, position))
        assert all(torch.equal(a, b) for a, b in zip(whole[position:], rest, strict=True))
    assert sorted(torch.cat(whole).tolist()) == rows.tolist()
    others = [EpochOrder(rows, 10, seed=5).batches(3), order.batches(2)]
    assert all(not torch.equal(torch.cat(whole), torch.cat(list(other))) for other in others)
    assert torch.cat(list(EpochOrder(rows, 10, seed=None).batches(3))).tolist() == rows.tolist()


def test_loader_pairs_every_graph_with_its_label(dynamics_data: FakeDataset):
    store = store_of(dynamics_data)
    data = GraphData(
        store,
        featurizer(),
        store.node[..., :1] * 2,
        train=dynamics_data.rows("train"),
        validation=np.zeros(0, np.int64),
        batch_size=16,
        seed=1,
    )
    loader = data.train_dataloader()
    assert isinstance(loader.sampler, EpochOrder)
    loader.sampler.set_epoch(2)
    batches = list(loader)
    assert sum(len(batch) for batch in batches) == len(dynamics_data.rows("train"))
    assert all(torch.equal(batch.wanted, batch.graphs.node[:, :1] * 2) for batch in batches)
    assert data.val_dataloader() == []
