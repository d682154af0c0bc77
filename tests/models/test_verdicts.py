"""What else became of a pull, learnt beside its label."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from fake_towers import FakeDataset
from test_sweep import flat, tall_tower
from torch.nn import functional

from jenga_data.clock import MOMENTS
from jenga_data.errors import JengaError
from jenga_data.graph_spec import graph_spec
from jenga_models.committee import Committee
from jenga_models.config import SelectionTraining
from jenga_models.graphs import Graphs
from jenga_models.predict import Selector
from jenga_models.registry import SELECTORS, build
from jenga_models.train import train_selection
from jenga_models.verdicts import labels, motion_loss, verdict_loss, with_verdicts

CONFIG = SelectionTraining(
    graph="G_s+layout", model="sweep", layers=1, width=8, readout="target", verdict=1.0, epochs=1, accelerator="cpu"
)


MOVED = np.zeros((3, len(MOMENTS), 2, 3))
"""Two blocks; in the last pull the second goes along by a centimetre, and at last off the line by three and four."""
MOVED[2, :, 1, 0] = -0.01
MOVED[2, 2, 1, 1:] = 0.003, 0.004


def three_pulls(dataset: FakeDataset) -> torch.Tensor:
    """Labels and verdicts of a pull of each outcome."""
    outcomes = {
        "outcome": np.array(["extracted", "stuck", "collapsed"]),
        "dragged": np.array([False, False, True]),
        "moved": np.array([0.0, 0.0099, 0.0999]),
        "block_moved": MOVED,
    }
    return with_verdicts(replace(dataset, columns=outcomes), torch.tensor([0, 1, 1]))


def test_beside_the_label_stand_outcome_dragging_and_how_far_others_moved(selection_data):
    found = three_pulls(selection_data)
    torch.testing.assert_close(found[:, :4], torch.tensor([[0.0, 0, 0, -2], [1, 1, 0, 0], [1, 2, 1, 1]]))
    assert labels(found).tolist() == [0, 1, 1]
    motion = found[:, 4:].view(3, 2, 6)
    assert not motion[:2].any()
    assert not motion[2, 0].any()
    torch.testing.assert_close(motion[2, 1].sinh(), torch.tensor([10.0, 10, 10, 0, 0, 5]))
    assert labels(torch.tensor([1, 0])).tolist() == [1, 0]


def test_the_loss_is_that_of_its_three_parts_over_all_members(selection_data):
    torch.manual_seed(0)
    said, each = torch.randn(2, 3, 5), []
    for member in said:
        outcome = functional.cross_entropy(member[:, :3], torch.tensor([0, 1, 2]))
        dragged = functional.binary_cross_entropy_with_logits(member[:, 3], torch.tensor([0.0, 0, 1]))
        each.append(outcome + dragged + (member[:, 4] - torch.tensor([-2.0, 0, 1])).square().mean())
    torch.testing.assert_close(verdict_loss(said, three_pulls(selection_data)), torch.stack(each).mean())


def test_the_loss_of_motions_is_that_of_every_block_of_every_graph(selection_data):
    torch.manual_seed(0)
    said, wanted = torch.randn(2, 6, 6), three_pulls(selection_data)
    each = [(member.view(3, 2, 6) - wanted[:, 4:].view(3, 2, 6)).square().mean() for member in said]
    torch.testing.assert_close(motion_loss(said, wanted), torch.stack(each).mean())


def test_the_motion_of_a_block_depends_on_the_target_and_on_the_levels_between(selection_data):
    spec = graph_spec("G_s+layout")
    network = build(CONFIG, spec, 1)
    graphs = flat(tall_tower(0), tall_tower(0))
    one, other = 3, 20
    graphs = replace(graphs, target=torch.tensor([one, 54 + other]))
    found = network.judge(graphs).motion  # pyright: ignore[reportCallIssue]  # a sweep
    assert found.shape == (1, 108, 6)
    assert not torch.allclose(found[:, :54], found[:, 54:], atol=1e-4)
    same = network.judge(replace(graphs, target=torch.tensor([one, 54 + one]))).motion  # pyright: ignore[reportCallIssue]
    torch.testing.assert_close(same[:, :54], same[:, 54:])


def test_they_are_learnt_only_where_they_are_asked_for(selection_data, tmp_path):
    spec, states = graph_spec("G_s+layout"), {}
    for verdict in (0.0, 1.0):
        config = replace(CONFIG, verdict=verdict, motion=verdict, learning_rate=1e-2)
        path = train_selection(selection_data, config, tmp_path / str(verdict)).path
        states[verdict] = Selector(path).checkpoint.model.state_dict()
    fresh = build(CONFIG, spec, 1).state_dict()
    for name in ("verdict.weight", "motion.apart.weight", "motion.last.weight"):
        assert torch.equal(states[0.0][name], fresh[name])
        assert not torch.equal(states[1.0][name], fresh[name])
    assert not torch.equal(states[1.0]["encode.weight"], states[0.0]["encode.weight"])


def test_a_model_that_says_none_is_not_asked_for_them(monkeypatch):
    with pytest.raises(JengaError, match="verdict is not for model 'interaction'"):
        build(replace(CONFIG, model="interaction"), graph_spec("G_s+layout"), 1)

    class Silent(Committee):
        def each(self, graphs: Graphs) -> torch.Tensor:
            return graphs.node[None, graphs.target, :2]

    monkeypatch.setitem(SELECTORS, "silent", lambda config, widths: Silent())
    with pytest.raises(JengaError, match="verdict and motion are not for model 'silent', which has no `judge`"):
        build(replace(CONFIG, model="silent"), graph_spec("G_s+layout"), 1)
    with pytest.raises(JengaError, match=r"verdict is -1.0; allowed: 0 and more"):
        replace(CONFIG, verdict=-1.0)
