"""`jenga bench loader` on made-up towers: both sides make the same batches, only then may times be compared."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from fake_towers import FakeDataset

from jenga_data.errors import JengaError
from jenga_data.graph_spec import GRAPHS
from jenga_models.bench.loader import PRESETS_SHOWN, Contest, bench_loader
from jenga_models.bench.pyg import same
from jenga_models.bench.tiled import Tiled
from jenga_models.columns import Rows, Towers
from jenga_models.store import GraphStore


@pytest.mark.parametrize(("kind", "preset"), [(kind, p) for kind, shown in PRESETS_SHOWN.items() for p in shown])
def test_both_sides_make_the_same_batches_and_are_timed(kind, preset, request):
    data: FakeDataset = request.getfixturevalue(f"{kind}_data")
    contest = Contest.of(data, preset, batch_size=64, seed=3, at_least=400)
    assert contest.tiled == -(-400 // len(data))
    assert contest.same_batches()
    speed = contest.run(rounds=2)
    assert speed.as_dict()["ratio"] == pytest.approx(speed.value / speed.reference)
    assert speed.value > speed.reference > 0


@pytest.mark.parametrize("part", ["node", "edge_index", "edge", "action", "target", "graph", "wanted"])
def test_a_batch_that_differs_anywhere_is_noticed(dynamics_data: FakeDataset, part: str):
    contest = Contest.of(dynamics_data, "fast", batch_size=8, seed=0, at_least=8)
    rows = torch.arange(8)
    ours, theirs = contest.batches[rows], contest.their_batch(rows)
    assert same(ours, theirs)
    if part == "wanted":
        changed = replace(ours, wanted=ours.wanted + 1)
    else:
        changed = replace(ours, graphs=replace(ours.graphs, **{part: getattr(ours.graphs, part) + 1}))
    assert not same(changed, theirs)


def test_a_tiled_dataset_repeats_its_rows(dynamics_data: FakeDataset):
    tiled = Tiled(dynamics_data, 3)
    assert isinstance(tiled, Rows)
    count = len(dynamics_data)
    assert len(tiled) == 3 * count
    store = GraphStore.of(GRAPHS["G_e"], Towers.of_dataset(tiled), tiled.column("action"))
    first, again = torch.tensor([5, 17]), torch.tensor([5 + 2 * count, 17 + count])
    assert torch.equal(store.node[first], store.node[again])
    assert all(torch.equal(a, b) for a, b in zip(store.edges_of(first), store.edges_of(again), strict=True))
    assert np.array_equal(tiled.rows("train"), dynamics_data.rows("train"))


@pytest.mark.parametrize("change", [{"rounds": 0}, {"batch_size": 0}])
def test_counts_are_at_least_one(change):
    with pytest.raises(JengaError, match="is 0; allowed: 1 and more"):
        bench_loader([], **change)
