"""The programs of README.md run as they stand there, on less data."""

import re
from pathlib import Path
from typing import Any

import pytest
from made_up_dataset import selection_dataset

README = Path(__file__).parents[2] / "README.md"


def program(word: str) -> str:
    """The one Python block of README.md that holds `word`."""
    (found,) = [block for block in re.findall(r"```python\n(.*?)```", README.read_text(), re.S) if word in block]
    return found


def test_an_own_classifier_gets_its_row_of_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    dataset = selection_dataset(18)
    dataset.folder = tmp_path / "data"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("jenga_data.dataset.read.open_dataset", lambda name: dataset)
    monkeypatch.setattr("jenga_models.registry.SELECTORS", registered := {})
    text = program("SELECTORS[")
    assert len([line for line in text.splitlines() if line]) <= 22
    names: dict[str, Any] = {}
    exec(text.replace("epochs=50", "epochs=1").replace("range(5)", "range(2)"), names)
    assert list(registered) == ["mine"]
    assert re.search(r"^\| mine \|", capsys.readouterr().out, re.M)


def test_the_blocks_of_a_logged_tower_are_ranked(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.chdir(README.parent)
    exec(program("rank("), {})
    chances = [float(line.rpartition(" ")[2]) for line in capsys.readouterr().out.splitlines()]
    assert len(chances) == 3
    assert 0 <= chances[0] <= chances[1] <= chances[2] < 0.5
