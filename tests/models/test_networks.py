"""Laws of the networks: symmetry under renumbering, one result for either form of a batch, cheap equals naive."""

from dataclasses import replace

import pytest
import torch
from fake_towers import FakeDataset, fake_dataset
from torch import Tensor, nn

from jenga_data.errors import JengaError
from jenga_data.graph_spec import GRAPHS, graph_spec
from jenga_models.columns import Towers
from jenga_models.config import DYNAMICS_PRESETS, SELECTION_PRESETS, Training
from jenga_models.features import Featurizer
from jenga_models.gns import Trunk, Widths
from jenga_models.graphs import Graphs
from jenga_models.layers import LightInteraction, MemoryInteraction, SplitLinear
from jenga_models.registry import SELECTORS, build
from jenga_models.scaling import fit_features
from jenga_models.store import GraphStore

CONFIGS: dict[str, Training] = {
    **{f"selection {name}": replace(c, width=16) for name, c in SELECTION_PRESETS.items()},
    **{f"dynamics {name}": replace(c, width=16) for name, c in DYNAMICS_PRESETS.items() if c.model == "gns"},
    "selection by poses": replace(SELECTION_PRESETS["fast"], graph="G_sp", edge_attributes=True, readout="mean"),
    "selection residual": replace(SELECTION_PRESETS["paper"], residual=True, readout="target", flow="both"),
}


def prepared(config: Training, data: FakeDataset) -> tuple[nn.Module, Featurizer, GraphStore]:
    spec = graph_spec(config.graph)
    store = GraphStore.of(spec, Towers.of_dataset(data), data.column("action"))
    normalisation = fit_features(config, spec, store, data.rows("train"))
    featurizer = Featurizer(spec, config.flow, config.edge_attributes, normalisation)
    return build(config, spec, featurizer.edge_width).eval(), featurizer, store


@pytest.mark.parametrize("name", CONFIGS)
def test_renumbering_blocks_changes_nothing_but_the_order(name: str, dynamics_data: FakeDataset):
    model, featurizer, store = prepared(CONFIGS[name], dynamics_data)
    graphs = store.batch(featurizer, torch.arange(4))
    order = torch.randperm(len(graphs.node), generator=torch.Generator().manual_seed(1))
    new_name = order.argsort()
    assert graphs.graph is not None
    renumbered = replace(
        graphs,
        node=graphs.node[order],
        graph=graphs.graph[order],
        edge_index=new_name[graphs.edge_index].flip(1),
        edge=graphs.edge.flip(0),
        target=new_name[graphs.target],
    )
    said, again = model(graphs), model(renumbered)
    expected = said if name.startswith("selection") else said[order]
    torch.testing.assert_close(again, expected, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("name", CONFIGS)
def test_samples_on_one_topology_equal_a_flat_batch(name: str, dynamics_data: FakeDataset):
    model, featurizer, store = prepared(CONFIGS[name], dynamics_data)
    row, samples = torch.tensor([5]), 7
    noise = 1e-4 * torch.randn(samples, *store.node.shape[1:], generator=torch.Generator().manual_seed(0))
    node = store.node[row] + noise
    action = 1e-3 * torch.randn(samples, 3, generator=torch.Generator().manual_seed(1))
    upper, lower = store.edges_of(row)
    target = store.target[row].expand(samples)
    static = featurizer.graphs(node, upper, lower, target, action)

    shift = torch.arange(samples)[:, None] * store.blocks
    flat = featurizer.graphs(
        node.flatten(0, 1),
        (upper + shift).flatten(),
        (lower + shift).flatten(),
        target + shift[:, 0],
        action,
        torch.arange(samples).repeat_interleave(store.blocks),
    )
    torch.testing.assert_close(model(static).flatten(0, -2), model(flat), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("name", ["dynamics paper", "dynamics fast"])
def test_a_masked_edge_is_no_edge(name: str, dynamics_data: FakeDataset):
    model, featurizer, store = prepared(CONFIGS[name], dynamics_data)
    graphs = store.batch(featurizer, torch.arange(2))
    keep = torch.arange(len(graphs.edge)) % 3 != 0
    without = replace(graphs, edge_index=graphs.edge_index[:, keep], edge=graphs.edge[keep])
    masked = replace(graphs, edge_mask=keep.float())
    torch.testing.assert_close(model(masked), model(without), atol=1e-6, rtol=1e-5)
    assert not torch.allclose(model(masked), model(graphs), atol=1e-4)


def some_graph() -> tuple[Tensor, Tensor, Graphs]:
    generator = torch.Generator().manual_seed(2)
    node, edge = torch.randn(6, 8, generator=generator), torch.randn(11, 8, generator=generator)
    edge_index = torch.randint(0, 6, (2, 11), generator=generator)
    return node, edge, Graphs(node, edge_index, edge, torch.tensor([0]), graph=torch.zeros(6, dtype=torch.long))


def concatenated(node: Tensor, edge: Tensor, graphs: Graphs) -> Tensor:
    sender, receiver = graphs.edge_index
    return torch.cat([node[receiver], node[sender], edge], dim=1)


def summed_at_receivers(values: Tensor, graphs: Graphs) -> Tensor:
    """By a dense matrix, as no layer does."""
    return torch.nn.functional.one_hot(graphs.edge_index[1], 6).float().T @ values


def test_a_split_linear_layer_equals_one_over_all_inputs():
    layer, parts = SplitLinear([3, 1, 2], 4), torch.randn(5, 6).split([3, 1, 2], dim=1)
    whole = nn.functional.linear(torch.cat(parts, dim=1), layer.weight, layer.bias)
    torch.testing.assert_close(sum(layer.part(i, x) for i, x in enumerate(parts)), whole)


def test_the_memory_layer_equals_the_naive_interaction_network():
    node, edge, graphs = some_graph()
    layer = MemoryInteraction(8, hidden_layers=2)
    first = nn.functional.linear(concatenated(node, edge, graphs), layer.first.weight, layer.first.bias)
    message = layer.message(first)
    update = layer.update(torch.cat([node, summed_at_receivers(message, graphs)], dim=1))
    after_node, after_edge = layer(node, edge, graphs)
    torch.testing.assert_close(after_node, node + update, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(after_edge, edge + message, atol=1e-5, rtol=1e-5)


def test_the_light_layer_equals_a_message_mlp_that_is_summed_after_its_last_linear_layer():
    """With message MLP L2 relu(L1 [v_r, v_s, e]) and update layer W [v, sum]: the light one holds W L2."""
    node, edge, graphs = some_graph()
    layer, last = LightInteraction(8, 8, hidden_layers=1), nn.Linear(8, 8, bias=False)
    wide = layer.update[0]
    assert isinstance(wide, nn.Linear)
    own, of_sum = wide.weight.split(8, dim=1)
    first = nn.functional.linear(concatenated(node, edge, graphs), layer.first.weight, layer.first.bias)
    summed = summed_at_receivers(last(first.relu()), graphs)
    naive = node + layer.update[1:](node @ own.T + summed @ of_sum.T + wide.bias)
    with torch.no_grad():
        wide.weight[:, 8:] = of_sum @ last.weight
    torch.testing.assert_close(layer(node, edge, graphs)[0], naive, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("memory", [False, True])
def test_a_layer_carries_news_one_edge_further(memory: bool, shared: bool):
    torch.manual_seed(0)  # of some weights all units that hear the news are dead
    trunk = Trunk(Widths(2, 1, 0, {}), width=8, layers=3, hidden_layers=1, edge_memory=memory, shared=shared)
    chain = torch.stack([torch.arange(5), torch.arange(1, 6)])
    graphs = Graphs(
        torch.randn(6, 2), chain, torch.ones(5, 1), torch.tensor([0]), graph=torch.zeros(6, dtype=torch.long)
    )
    news = torch.zeros(6, 2)
    news[0] = 1
    changed = (trunk(replace(graphs, node=graphs.node + news)) - trunk(graphs)).abs().sum(1) > 0
    assert changed.tolist() == [True, True, True, True, False, False]


def test_the_action_reaches_every_node(dynamics_data: FakeDataset):
    model, featurizer, store = prepared(CONFIGS["dynamics paper"], dynamics_data)
    graphs = store.batch(featurizer, torch.arange(2))
    assert graphs.action is not None
    changed = replace(graphs, action=graphs.action + torch.tensor([[0.0, 0, 0], [0.5, 0, 0]]))
    moved = (model(changed) - model(graphs)).abs().sum(1).view(2, -1)
    assert (moved[0] == 0).all()
    assert (moved[1] > 0).all()


def test_a_seed_decides_the_weights_and_leaves_the_generator_alone():
    config = SELECTION_PRESETS["fast"]
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    first, second, other = (build(c, graph_spec("G_s+layout"), 1) for c in (config, config, replace(config, seed=1)))
    assert torch.equal(torch.rand(3), expected)
    assert all(torch.equal(a, b) for a, b in zip(first.parameters(), second.parameters(), strict=True))
    assert not all(torch.equal(a, b) for a, b in zip(first.parameters(), other.parameters(), strict=True))


def test_an_own_architecture_is_used_once_it_is_registered(monkeypatch: pytest.MonkeyPatch):
    config = replace(SELECTION_PRESETS["fast"], model="mine")
    with pytest.raises(JengaError, match="unknown model 'mine' for selection; registered: gcn, interaction"):
        build(config, graph_spec("G_s+layout"), 1)
    monkeypatch.setitem(SELECTORS, "mine", lambda config, widths: nn.Linear(widths.node, config.width))
    model = build(config, graph_spec("G_s+layout"), 1)
    assert isinstance(model, nn.Linear)
    assert model.in_features == graph_spec("G_s+layout").node_width


def test_graph_features_have_the_width_that_the_spec_says():
    towers = Towers.of_dataset(fake_dataset("selection", 5))
    for spec in GRAPHS.values():
        assert GraphStore.of(spec, towers).node.shape == (5, 6, spec.node_width)
