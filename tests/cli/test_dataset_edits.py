"""The verbs that make a dataset of others say what they did, and refuse in one line what cannot be done."""

import os
import shutil
from pathlib import Path

import pytest
from jenga_runs import Made, contents, jenga

LEAST = 3
"""Towers that a dataset needs."""


@pytest.fixture
def halves(selection_logs: Made, tmp_path: Path) -> list[Path]:
    """Datasets of the first and of the last three of four episodes."""
    logs = sorted(selection_logs.path.glob("*.mcap"))
    folders = []
    for name, part in (("first", logs[:LEAST]), ("last", logs[-LEAST:])):
        (tmp_path / f"{name}-logs").mkdir()
        for log in part:
            os.link(log, tmp_path / f"{name}-logs" / log.name)
        out = tmp_path / name
        assert jenga("convert", f"{out}-logs", "--name", "pulls", "--version", "0.0.1", "--out", out).code == 0
        folders.append(out)
    return folders


def test_convert_sums_up_by_outcome_and_round(selection: Made, selection_logs: Made, tmp_path):
    said = selection.ran.object()
    assert sum(sum(outcomes.values()) for outcomes in said["rounds"].values()) == said["counts"]["episodes"]
    assert {n: sum(outcomes.values()) for n, outcomes in said["rounds"].items()} == said["counts"]["round"]
    ran = jenga("convert", selection_logs.path, "--name", "x", "--version", "0.1.0", "--out", tmp_path / "x")
    lines = [line.split() for line in ran.out.splitlines()]
    outcomes = [o for o in ("collapsed", "extracted", "stuck") if o in said["counts"]["outcome"]]
    assert lines[1] == ["round", *outcomes, "episodes"]
    assert lines[-2] == ["all", *(str(said["counts"]["outcome"][o]) for o in outcomes), "4"]


def test_merge_then_drop_then_diff(halves: list[Path], selection: Made, tmp_path):
    merged = jenga(
        "dataset", "merge", *halves, "--name", "pulls", "--version", "0.1.0", "--out", tmp_path / "m", "--json"
    )
    said = merged.object()
    assert (said["dataset"], said["episodes"], said["copies"]) == ("pulls@0.1.0", 4, 2)
    assert said["files"] == {"taken": 1, "written": 1}
    assert said["out"] == str(tmp_path / "m")
    assert jenga("dataset", "verify", tmp_path / "m").code == 0

    compared = jenga("dataset", "diff", tmp_path / "m", selection.path, "--json")
    assert compared.code == 1
    assert compared.object()["episodes"] == {"removed": [], "added": [], "same": 4, "differ": {}}
    same = jenga("dataset", "diff", selection.path, selection.path, "--json")
    assert same.code == 0
    assert same.object()["equal"] is True

    log = min(selection.path.parent.glob("selection-logs/*.mcap")).stem
    dropped = jenga("dataset", "drop", tmp_path / "m", "--episodes", log, "--version", "0.2.0", "--out", tmp_path / "d")
    assert dropped.out.startswith(f"pulls@0.2.0 in {tmp_path / 'd'}\n  3 rows of 3 episodes of 3 towers\n")
    assert f"episodes only in pulls@0.1.0: 1\n  {log}\n" in jenga("dataset", "diff", tmp_path / "m", tmp_path / "d").out


def test_drop_by_a_condition(selection: Made, tmp_path):
    least = sorted(p.stem for p in selection.path.parent.glob("selection-logs/*.mcap"))[0]
    out = tmp_path / "d"
    args = ("dataset", "drop", selection.path, "--version", "0.2.0", "--out", out)
    assert jenga(*args, "--where", f"episode == {least}", "round >= 1", "--json").object()["episodes"] == LEAST
    assert "allowed: COLUMN OP VALUE" in jenga(*args[:-1], tmp_path / "e", "--where", "stuck").line()
    assert "either by --episodes KEY... or by --where" in jenga(*args[:-1], tmp_path / "e").line()
    assert not (tmp_path / "e").exists()


def test_convert_onto(halves: list[Path], selection_logs: Made, tmp_path):
    before = contents(halves[0])
    args = ("convert", selection_logs.path, "--onto", halves[0], "--name", "pulls")
    said = jenga(*args, "--version", "0.1.0", "--out", tmp_path / "new", "--json").object()
    assert (said["copies"], said["counts"]["episodes"], said["files"]) == (LEAST, 4, {"taken": 1, "written": 1})
    assert said["parents"] == ["pulls@0.0.1"]
    assert contents(halves[0]) == before
    assert "0.0.1 is not above 0.0.1" in jenga(*args, "--version", "0.0.1", "--out", tmp_path / "again").line()


def test_migrate(tmp_path):
    kept = Path(__file__).parents[1] / "dataset" / "format_1_0"
    old = kept / "dynamics"
    said = jenga("dataset", "migrate", old, "--out", tmp_path / "new", "--json").object()
    assert said["dataset"] == "old-dynamics@1.0.1"
    assert jenga("dataset", "verify", tmp_path / "new").code == 0
    assert "nothing to migrate" in jenga("dataset", "migrate", tmp_path / "new", "--out", tmp_path / "newer").line()
    drop = ("dataset", "drop", old, "--where", "round == 1", "--version", "2.0.0", "--out", tmp_path / "d")
    assert f"jenga dataset migrate {old} --out NEW" in jenga(*drop).line()
    line = jenga("dataset", "migrate", kept / "selection", "--out", tmp_path / "pulls").line()
    assert "holds pulls without `block_moved`, which only their logs can say: convert them again" in line
    assert not (tmp_path / "pulls").exists()


@pytest.mark.parametrize("verb", ["merge", "drop", "migrate"])
def test_an_output_that_exists_stays_as_it_is(verb, halves: list[Path], tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.txt").write_text("all of it")
    more = {"merge": [halves[1], "--name", "m"], "drop": ["--where", "round == 1"], "migrate": []}[verb]
    line = jenga("dataset", verb, halves[0], *more, "--version", "1.0.0", "--out", tmp_path / "out").line()
    assert "a dataset never changes" in line
    assert contents(tmp_path / "out") == {"thesis.txt": b"all of it"}


def test_a_full_disk_leaves_nothing(halves: list[Path], tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    shutil.copytree(halves[0], tmp_path / "before")
    with monkeypatch.context() as patch:
        patch.setattr("jenga_data.dataset.take.file_entry", full)
        args = ("dataset", "merge", *halves, "--name", "m", "--version", "0.1.0", "--out", tmp_path / "out")
        assert "No space left on device; nothing was kept" in jenga(*args).line()
    assert not list(tmp_path.glob("*out*"))
    assert contents(halves[0]) == contents(tmp_path / "before")
