"""Checkpoints come back as they were, and are refused with one clear line when they are not."""

import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from fake_towers import FakeDataset

from jenga_data.errors import CheckFailed, JengaError
from jenga_models.checkpoint import CARD, WEIGHTS, check_dataset, load, save
from jenga_models.columns import Towers
from jenga_models.store import GraphStore


@pytest.fixture
def copy(selector_path: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(selector_path, tmp_path / "copy"))


def edit(path: Path, **changes: Any) -> None:
    card = json.loads((path / CARD).read_text())
    (path / CARD).write_text(json.dumps({**card, **changes}))


def test_a_checkpoint_comes_back_as_it_was(selector_path: Path, selection_data: FakeDataset, tmp_path: Path):
    first = load(selector_path)
    normalisation = first.featurizer.normalisation
    save(tmp_path, first.model, first.config, first.spec, normalisation, selection_data, first.metrics)
    again = load(tmp_path)
    assert (again.config, again.spec, again.metrics, again.dataset) == (
        first.config,
        first.spec,
        first.metrics,
        first.dataset,
    )
    assert again.hash == first.hash
    assert not again.model.training
    graphs = GraphStore.of(first.spec, Towers.of_dataset(selection_data)).batch(first.featurizer, torch.arange(9))
    assert torch.equal(first.model(graphs), again.model(graphs))


def test_the_hash_is_that_of_both_files(copy: Path):
    before = load(copy).hash
    assert before == hashlib.sha256((copy / WEIGHTS).read_bytes() + (copy / CARD).read_bytes()).hexdigest()
    edit(copy, metrics={"made": 1.0})
    assert load(copy).hash != before


def test_it_names_what_it_was_trained_on(selector_path: Path, selection_data: FakeDataset):
    checkpoint = load(selector_path)
    assert check_dataset(checkpoint, selection_data) == ""
    line = check_dataset(checkpoint, replace(selection_data, hash="0" * 64))
    assert line.endswith("was trained on tiny@1.0.0, not on tiny@1.0.0 of another content")
    assert "\n" not in line


def test_a_checkpoint_of_the_other_kind_is_refused(
    selector_path: Path, dynamics_data: FakeDataset, simulator_path: Path
):
    with pytest.raises(JengaError, match="is a selection checkpoint; wanted: dynamics"):
        check_dataset(load(selector_path), dynamics_data)
    with pytest.raises(JengaError, match="is a selection checkpoint; wanted: dynamics"):
        _ = load(selector_path).simulator
    assert load(simulator_path).simulator.residual


def test_weights_cut_in_half_are_refused(copy: Path):
    whole = (copy / WEIGHTS).read_bytes()
    (copy / WEIGHTS).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(CheckFailed, match="damaged: its SHA-256 is not the one"):
        load(copy)


def test_a_card_cut_in_half_is_refused(copy: Path):
    whole = (copy / CARD).read_bytes()
    (copy / CARD).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(CheckFailed, match="damaged: it is not whole JSON"):
        load(copy)


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"format_version": 2}, JengaError, "has checkpoint format 2, this code reads 1"),
        ({"format": "other"}, JengaError, "is no checkpoint's card"),
        ({"kind": "other"}, CheckFailed, "kind missing or unknown"),
        ({"graph": {"name": "G_s", "node_features": ["block_mass"], "action": False}}, CheckFailed, "shape"),
        ({"graph": {"name": "G_s", "node_features": ["block_colour"]}}, JengaError, "unknown node features"),
        ({"graph": 3}, CheckFailed, "does not hold together"),
        ({"config": {"layers": 2}}, CheckFailed, "config has other fields"),
        ({"normalisation": {}}, CheckFailed, "lacks numbers"),
        ({"normalisation": []}, CheckFailed, "lacks numbers"),
        ({"metrics": {"a": "b"}}, CheckFailed, "does not hold together"),
        ({"dataset": {}}, CheckFailed, "does not hold together"),
        ({"weights_sha256": "0"}, CheckFailed, "is damaged"),
    ],
)
def test_a_card_that_does_not_fit_is_refused(copy: Path, changes: dict, error: type[JengaError], message: str):
    edit(copy, **changes)
    with pytest.raises(error, match=message) as caught:
        load(copy)
    assert "\n" not in str(caught.value)


def test_a_checkpoint_from_before_a_field_was_added_is_read_as_it_was_trained(copy: Path):
    config = json.loads((copy / CARD).read_text())["config"]
    assert config["motion"] == 0.0
    before = load(copy)
    edit(copy, config={name: value for name, value in config.items() if name != "motion"})
    assert load(copy).config == before.config


def test_weights_for_another_architecture_are_refused(copy: Path):
    config = json.loads((copy / CARD).read_text())["config"]
    edit(copy, config={**config, "width": config["width"] + 1})
    with pytest.raises(CheckFailed, match="do not fit graph"):
        load(copy)
    edit(copy, config={**config, "width": 0})
    with pytest.raises(JengaError, match="width is 0"):
        load(copy)
    edit(copy, config={**config, "model": "mine"})
    with pytest.raises(JengaError, match="unknown model 'mine'"):
        load(copy)


@pytest.mark.parametrize("name", [CARD, WEIGHTS])
def test_a_missing_file_is_refused(copy: Path, name: str):
    (copy / name).unlink()
    with pytest.raises(JengaError, match=f"is no checkpoint: it has no {name}"):
        load(copy)


def test_a_missing_folder_is_refused(tmp_path: Path):
    with pytest.raises(JengaError, match=r"no checkpoint at .*nowhere"):
        load(tmp_path / "nowhere")
