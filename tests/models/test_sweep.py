"""Levels are told by the edges alone, news crosses the whole tower, and the mirror changes nothing but the slots."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from fake_towers import FakeDataset
from torch import Tensor

from jenga_data.blocks import sample_blocks
from jenga_data.errors import JengaError
from jenga_data.graph_spec import graph_spec
from jenga_data.tower import Layout, TowerState, nominal_poses
from jenga_models.columns import Towers
from jenga_models.config import SELECTION_PRESETS, SelectionTraining
from jenga_models.features import Featurizer, feature_slices
from jenga_models.gns import Widths
from jenga_models.graphs import Graphs
from jenga_models.levels import Levels
from jenga_models.mirror import mirrored
from jenga_models.normalisation import Normalisation
from jenga_models.predict import Selector
from jenga_models.registry import build
from jenga_models.store import GraphStore
from jenga_models.sweep import SweepClassifier
from jenga_models.train import train_selection

SPEC = graph_spec("G_s+layout")
SWEEP = SelectionTraining(graph="G_s+layout", model="sweep", layers=3, width=8, readout="target")


def tall_tower(seed: int = 0, moves: int = 5) -> TowerState:
    """54 nominally placed blocks after some legal moves."""
    rng = np.random.default_rng(seed)
    layout = Layout.fresh(rng.permutation(54))
    for _ in range(moves):
        layout = layout.moved(int(rng.choice(layout.legal_targets())), layout.next_places()[0])
    return TowerState(sample_blocks("measured", rng), layout, nominal_poses(layout), np.zeros((54, 6)))


def flat(*states: TowerState, target: int = 0) -> Graphs:
    """Several towers as one batch, not normalised."""
    columns = [(s.blocks.size, s.blocks.mass, s.pose, s.layout.level, s.layout.slot) for s in states]
    size, mass, pose, level, slot = (np.stack(values) for values in zip(*columns, strict=True))
    towers = Towers.of_poses(size, mass, pose, level, slot, np.full(len(states), target))
    featurizer = Featurizer(SPEC, "down", attributes=False, normalisation=Normalisation.none(SPEC.node_width, 0))
    return GraphStore.of(SPEC, towers).batch(featurizer, torch.arange(len(states)))


def test_levels_are_those_of_the_layout():
    states = [tall_tower(0), tall_tower(1, moves=12), tall_tower(2, moves=0)]
    levels = Levels.of(flat(*states))
    _, tall, wide = levels.held.shape
    assert wide == 3
    found = (levels.cell // wide % tall).view(3, 54)
    assert found.tolist() == [s.layout.level.tolist() for s in states]
    blocks = [[(row >= 0).sum() for row in s.layout.grid] for s in states]
    assert [levels.held[k].sum(1).tolist()[: len(b)] for k, b in enumerate(blocks)] == blocks
    assert levels.on.sum() == flat(*states).edge_index.shape[1]


def test_values_come_back_from_their_places():
    graphs = flat(tall_tower(0), tall_tower(1))
    levels = Levels.of(graphs)
    placed = levels.spread(graphs.node)
    assert torch.equal(levels.gathered(placed, graphs.node), graphs.node)
    assert (placed[levels.held == 0] == 0).all()


def test_an_edge_that_skips_a_level_is_left_out():
    """2 on 1 on 0, and 2 on 3 besides, which lies beside 0."""
    edges, graph = torch.tensor([[1, 2, 2], [0, 1, 3]]), torch.zeros(4, dtype=torch.long)
    graphs = Graphs(torch.ones(4, 1), edges, torch.ones(3, 1), torch.tensor([0]), graph=graph)
    levels = Levels.of(graphs)
    assert levels.held[0].tolist() == [[1, 1], [1, 0], [1, 0]]
    assert levels.on.nonzero().tolist() == [[0, 1, 0, 0], [0, 2, 0, 0]]


def blocks_that_notice(sweeps: int, changed: int, state: TowerState) -> Tensor:
    """Which targets' logits change with the mass of one block."""
    torch.manual_seed(0)
    network = SweepClassifier(
        Widths(SPEC.node_width, 1, 0, feature_slices(SPEC)), width=16, sweeps=sweeps, members=1, dropout=0.0
    )
    network = network.double().eval()  # what comes from far away is faint before a network has learnt anything
    graphs = flat(state)
    graphs = replace(graphs, node=graphs.node.double(), target=torch.arange(54))
    heavier = graphs.node.clone()
    heavier[changed, 3] += 1.0
    return (network(replace(graphs, node=heavier)) - network(graphs)).abs().amax(-1) > 0


def test_one_sweep_carries_news_from_the_top_to_all_below_and_two_to_all():
    state = tall_tower(moves=0)
    level = torch.tensor(state.layout.level)
    top = int(state.layout.grid[-1, 0])
    assert blocks_that_notice(1, top, state)[level < 17].all()
    middle = int(state.layout.grid[9, 0])
    one = blocks_that_notice(1, middle, state)
    assert one[level < 9].all()
    assert not one[level > 9].any()
    assert blocks_that_notice(2, middle, state).all()


def test_one_pass_serves_every_target_of_a_tower():
    network = build(SWEEP, SPEC, 1).eval()
    state = tall_tower()
    many = [flat(state, target=t) for t in (3, 17, 40)]
    alone = torch.cat([network(graphs) for graphs in many])
    node = many[0].node[None]
    shared = replace(many[0], node=node, graph=None, target=torch.tensor([3, 17, 40]))
    torch.testing.assert_close(network(shared), alone, atol=1e-6, rtol=1e-5)


def test_ranking_shows_the_network_one_tower_and_not_one_a_target(
    selection_data: FakeDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    config = replace(SWEEP, epochs=1, accelerator="cpu")
    selector = Selector(train_selection(selection_data, config, tmp_path / "out").path)
    seen: list[int] = []
    each = SweepClassifier.each

    def noted(self: SweepClassifier, graphs: Graphs) -> Tensor:
        seen.append(len(graphs.node))
        return each(self, graphs)

    monkeypatch.setattr(SweepClassifier, "each", noted)
    assert len(selector.failure_probability(tall_tower(), [3, 17, 40])) == 3
    assert seen == [1]


def test_the_mirror_reverses_the_slots_of_whole_levels_and_nothing_else():
    graphs = flat(*[tall_tower(seed) for seed in range(12)])
    torch.manual_seed(3)
    after = mirrored(graphs, SPEC).node.view(12, 54, -1)
    before, at = graphs.node.view(12, 54, -1), feature_slices(SPEC)
    rest = [k for k in range(SPEC.node_width) if not at["slot"].start <= k < at["slot"].stop]
    assert torch.equal(after[..., rest], before[..., rest])
    odd = before[..., at["orientation"].start] == 1
    seen = set()
    for tower in range(12):
        turned = []
        for side in (odd[tower], ~odd[tower]):
            slots, was = after[tower][side][:, at["slot"]], before[tower][side][:, at["slot"]]
            assert torch.equal(slots, was) or torch.equal(slots, was.flip(-1))
            turned.append(not torch.equal(slots, was))
        seen.add(tuple(turned))
    assert seen == {(False, False), (False, True), (True, False), (True, True)}


def test_what_has_no_slots_looks_the_same_in_the_mirror(selection_data: FakeDataset):
    spec = graph_spec("G_s")
    featurizer = Featurizer(spec, "down", attributes=False, normalisation=Normalisation.none(spec.node_width, 0))
    graphs = GraphStore.of(spec, Towers.of_dataset(selection_data)).batch(featurizer, torch.arange(3))
    assert mirrored(graphs, spec) is graphs


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"flow": "both"}, "flow is 'both'; allowed for the model sweep: down"),
        ({"readout": "mean"}, "readout is 'mean'; allowed for the model sweep: target"),
        ({"model": "interaction", "members": 2}, "members is not for model 'interaction'"),
        ({"model": "interaction", "calibrate": True}, "calibrate is not for model 'interaction'"),
    ],
)
def test_what_the_model_cannot_do_is_refused(change: dict, message: str):
    with pytest.raises(JengaError, match=message):
        build(replace(SWEEP, **change), SPEC, 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"members": 0}, "members is 0; allowed: 1 and more"),
        ({"dropout": 1.0}, "dropout is 1.0; allowed: 0 to below 1"),
        ({"calibrate": True, "train_on_validation": True}, "calibrate needs validation towers"),
        ({"graph": "G_sp", "mirror": True}, "holds poses"),
    ],
)
def test_a_config_that_cannot_be_is_refused(change: dict, message: str):
    with pytest.raises(JengaError, match=message):
        replace(SELECTION_PRESETS["paper"], **{"train_on_validation": False} | change)
