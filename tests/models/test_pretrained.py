"""Trained models that come with jenga."""

import pytest

from jenga_data.errors import JengaError
from jenga_models.checkpoint import CARD
from jenga_models.pretrained import pretrained


@pytest.mark.parametrize("kind", ["selection", "dynamics"])
def test_without_a_model_that_comes_along_one_must_be_named(kind, tmp_path, monkeypatch):
    monkeypatch.setattr("jenga_models.pretrained.FOLDER", tmp_path)
    with pytest.raises(JengaError, match=f"no trained {kind} model; name one: --model CKPT"):
        pretrained(kind)
    (tmp_path / kind).mkdir()
    (tmp_path / kind / CARD).touch()
    assert pretrained(kind) == tmp_path / kind
