"""Trained models that come with jenga."""

from pathlib import Path

import numpy as np
import pytest

from jenga_data.dataset.manifest import load_manifest
from jenga_data.dataset.merge import merge
from jenga_data.dataset.read import open_dataset
from jenga_data.dataset.reference import DYNAMICS, NOISY, SELECTION
from jenga_data.errors import JengaError
from jenga_models.checkpoint import CARD, load
from jenga_models.metrics import predict_dynamics, predict_selection
from jenga_models.pretrained import pretrained


@pytest.mark.parametrize("kind", ["selection", "dynamics"])
def test_without_a_model_that_comes_along_one_must_be_named(kind, tmp_path, monkeypatch):
    monkeypatch.setattr("jenga_models.pretrained.FOLDER", tmp_path)
    with pytest.raises(JengaError, match=f"no trained {kind} model; name one: --model CKPT"):
        pretrained(kind)
    (tmp_path / kind).mkdir()
    (tmp_path / kind / CARD).touch()
    assert pretrained(kind) == tmp_path / kind


def test_the_selector_that_comes_along_was_trained_on_the_reference_data_and_nothing_else(tmp_path):
    """As its card says: merging the two datasets gives the bytes that it was trained on."""
    card = load(pretrained("selection"))
    merge([SELECTION, NOISY], tmp_path / "more", "jenga-selection-more", "1.1.0")
    assert card.dataset.hash == load_manifest(tmp_path / "more").hash
    assert str(card.dataset) == "jenga-selection-more@1.1.0"


def test_the_selector_that_comes_along_is_as_good_as_its_card_says():
    dataset = open_dataset(SELECTION)
    test = dataset.rows("test")
    right = (predict_selection(pretrained("selection"), dataset, test) > 0.5) == dataset.column("failure")[test]
    assert round(float(right.mean()), 2) == 0.91


def test_the_dynamics_model_that_comes_along_was_trained_on_the_reference_data_and_foresees_the_other_blocks():
    dataset = open_dataset(DYNAMICS)
    card = load(pretrained("dynamics"))
    assert card.dataset.hash == dataset.hash
    test = dataset.rows("test")
    rows = test[~dataset.column("target_clear")[test] & ~dataset.column("collapsed")[test]][::3]
    ahead = predict_dynamics(card, dataset, rows)
    truth, before = dataset.column("next_pose")[rows].astype(float), dataset.column("block_pose")[rows].astype(float)
    others = np.arange(truth.shape[1]) != dataset.column("target")[rows][:, None]
    error, trivial = ((pose[..., :3] - truth[..., :3])[others] for pose in (ahead, before))
    assert 1 - (error**2).sum() / (trivial**2).sum() > 0.8


def test_they_are_found_by_their_kind(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert load("dynamics").hash == load(pretrained("dynamics")).hash
    Path("dynamics").mkdir()  # an own folder comes first
    with pytest.raises(JengaError, match="is no checkpoint"):
        load("dynamics")


def test_another_name_is_refused_with_those_that_there_are():
    with pytest.raises(JengaError, match="`jenga train` makes one, and selection and dynamics come along"):
        load("dynamic")
