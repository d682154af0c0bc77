import subprocess
import sys
from dataclasses import replace

import pytest

from jenga_data.errors import JengaError
from jenga_models.config import DYNAMICS_PRESETS, PRESETS, SELECTION_PRESETS


def test_paper_selection_preset_carries_the_papers_numbers():
    paper = SELECTION_PRESETS["paper"]
    assert (paper.graph, paper.model, paper.layers) == ("G_s", "gcn", 6)
    assert (paper.learning_rate, paper.batch_size, paper.epochs) == (1e-3, 100, 150)
    assert (paper.weight_decay, paper.schedule, paper.gradient_clip) == (0, "constant", 0)
    assert (paper.patience, paper.train_on_validation, paper.label) == (0, True, "failure")


def test_paper_dynamics_preset_carries_the_papers_numbers():
    paper = DYNAMICS_PRESETS["paper"]
    assert (paper.graph, paper.model, paper.layers, paper.loss) == ("G_e", "gns", 4, "mse")
    assert (paper.learning_rate, paper.batch_size, paper.epochs) == (1e-4, 100, 150)
    assert (paper.weight_decay, paper.schedule, paper.gradient_clip) == (0, "constant", 0)
    assert (paper.patience, paper.train_on_validation) == (0, True)
    assert not paper.edge_attributes
    assert not paper.residual_to_action


def test_every_kind_has_the_three_presets():
    assert all(list(presets) == ["paper", "best", "fast"] for presets in PRESETS.values())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"layers": 0}, "layers is 0; allowed: 1 and more"),
        ({"learning_rate": 0.0}, "learning_rate is 0.0"),
        ({"graph": "G_x"}, "unknown graph 'G_x'; allowed: G_s"),
        ({"graph": "G_s"}, "holds no action"),
        ({"patience": 5, "train_on_validation": True}, "choose one"),
    ],
)
def test_a_config_refuses_what_cannot_be(change: dict, message: str):
    with pytest.raises(JengaError, match=message):
        replace(DYNAMICS_PRESETS["paper"], **change)


@pytest.mark.parametrize(
    ("modules", "unwanted"),
    [
        ("jenga_models.config", "torch"),
        ("jenga_models.overlay, jenga_models.metrics", "lightning, torch_geometric, mujoco"),
    ],
)
def test_what_takes_seconds_is_imported_only_where_it_is_needed(modules: str, unwanted: str):
    code = f"import sys, {modules}; print(*(set('{unwanted}'.split(', ')) & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert run.stdout.split() == []
