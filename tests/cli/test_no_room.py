"""A full disk ends in one line and exit code 2, never in a traceback; what was finished stays, what was not has no
final name, and the same command completes once there is room."""

import errno
import os
import resource
from pathlib import Path

import pytest
from jenga_runs import COLLECT, Made, contents, jenga, run_apart


def limit(size: int):
    """For a new process: no file may grow beyond `size` bytes. Python gets EFBIG where a full disk gives ENOSPC."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def full(*_: object, **__: object):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def convert(logs: Path, out: Path) -> tuple[object, ...]:
    return "convert", logs, "--name", "pulls", "--version", "0.1.0", "--out", out


def train(dataset: Path, out: Path) -> tuple[object, ...]:
    return "train", "selection", "--dataset", dataset, "--preset", "fast", "--epochs", 2, "--out", out


def test_collect(selection_logs: Made, tmp_path):
    """A worker process finds the disk full; the same command completes what is missing."""
    out = tmp_path / "logs"
    whole = contents(selection_logs.path, "*.mcap")
    args = (*COLLECT["selection"], "--episodes", 1, "--workers", 2, "--out", out)
    line = run_apart(*args, preexec_fn=limit(200_000)).line()
    assert "File too large; make room or choose another folder" in line
    left = contents(out)
    assert not any(name.endswith(".mcap") for name in left)
    assert any(name.endswith(".mcap.partial") for name in left)
    assert jenga(*args).code == 0
    assert contents(out, "*.mcap").items() <= whole.items()
    assert len(contents(out, "*.mcap")) == 1
    assert not contents(out, "*.partial")


def test_collect_where_the_writer_meets_a_full_disk(selection_logs: Made, tmp_path, monkeypatch):
    out = tmp_path / "logs"
    monkeypatch.setattr("mcap.writer.Writer.add_message", full)
    line = jenga(*COLLECT["selection"], "--episodes", 1, "--workers", 1, "--out", out).line()
    assert "No space left on device; make room or choose another folder" in line
    assert not contents(out, "*.mcap")


@pytest.mark.parametrize("where", ["jenga_data.dataset.write.table_writer", "jenga_data.dataset.write.file_entry"])
def test_convert(where, selection_logs: Made, selection: Made, tmp_path, monkeypatch):
    args = convert(selection_logs.path, tmp_path / "dataset")
    with monkeypatch.context() as patch:
        patch.setattr(where, full)
        assert "No space left on device; nothing was kept" in jenga(*args).line()
    assert list(tmp_path.iterdir()) == []
    assert jenga(*args).code == 0
    assert contents(tmp_path / "dataset") == contents(selection.path)


def test_convert_under_a_limit(selection_logs: Made, tmp_path):
    ran = run_apart(*convert(selection_logs.path, tmp_path / "dataset"), preexec_fn=limit(4_000))
    assert "File too large; nothing was kept" in ran.line()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("where", ["jenga_models.checkpoint._write", "pathlib.Path.write_text"])
def test_train(where, selection: Made, tmp_path, monkeypatch):
    out = tmp_path / "model"
    with monkeypatch.context() as patch:
        patch.setattr(where, full)
        line = jenga(*train(selection.path, out)).line()
    assert "No space left on device; make room, then add --resume" in line
    assert not (out / "checkpoint.json").exists()


def test_a_training_that_met_a_full_disk_resumes(selection: Made, tmp_path, monkeypatch):
    out, undisturbed = tmp_path / "model", tmp_path / "undisturbed"
    with monkeypatch.context() as patch:
        patch.setattr("jenga_models.checkpoint._write", full)
        jenga(*train(selection.path, out)).line()
    assert jenga(*train(selection.path, out), "--resume").code == 0
    assert jenga(*train(selection.path, undisturbed)).code == 0
    assert contents(out) == contents(undisturbed)


def test_train_under_a_limit(selection: Made, tmp_path):
    ran = run_apart(*train(selection.path, tmp_path / "model"), preexec_fn=limit(4_000))
    assert "File too large; make room, then add --resume" in ran.line()
    assert jenga(*train(selection.path, tmp_path / "model"), "--resume").code == 0


def test_replay(extraction_logs: Made, simulator: Made, tmp_path, monkeypatch):
    """The prediction that lies beside the episode, then the recording."""
    log = min(extraction_logs.path.glob("*.mcap"))
    own = tmp_path / log.name
    own.write_bytes(log.read_bytes())
    rrd = tmp_path / "shown.rrd"
    with monkeypatch.context() as patch:
        patch.setattr("mcap.writer.Writer.finish", full)
        assert "No space left" in jenga("replay", own, "--model", simulator.path, "--save", rrd).line()
    assert not list(tmp_path.glob("*.prediction.mcap"))
    assert not rrd.exists()
    assert own.read_bytes() == log.read_bytes()


def test_recover(extraction_logs: Made, tmp_path, monkeypatch):
    log = min(extraction_logs.path.glob("*.mcap"))
    with monkeypatch.context() as patch:
        patch.setattr("mcap.writer.Writer.finish", full)
        assert "No space left" in jenga("log", "recover", log, "--out", tmp_path / "saved.mcap").line()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
@pytest.mark.parametrize("args", [("--help",), ("dataset", "list", "--json"), ("demo", "--help")])
def test_the_terminal_itself(args):
    with Path("/dev/full").open("w") as out:
        ran = run_apart(*args, stdout=out)
    assert ran.code == 2
    assert ran.err == "jenga: No space left on device; make room, or choose another folder\n"


def test_a_disk_that_is_full_anywhere_else(tmp_path, monkeypatch):
    """Whatever nobody thought of is caught by the command line: here the listing of datasets."""

    def denied():
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(tmp_path))

    monkeypatch.setattr("jenga_data.dataset.locate.search_folders", denied)
    assert jenga("dataset", "list").line() == (
        f"jenga: Permission denied ({tmp_path}); make room, or choose another folder"
    )


def test_a_bug_still_ends_in_a_traceback(monkeypatch):
    def broken():
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    monkeypatch.setattr("jenga_data.dataset.locate.search_folders", broken)
    with pytest.raises(OSError, match="Invalid argument"):
        jenga("dataset", "list")
