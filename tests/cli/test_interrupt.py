"""Ctrl-C in the middle of a verb: exit code 130, one line, no process left behind, no half file under a final name;
and the same command goes on to what it would have made undisturbed."""

import os
import shutil
from pathlib import Path

from jenga_runs import CHEAP_CLOSED_LOOP, COLLECT, Made, Ran, cheap_closed_loop, contents, interrupted_when, jenga

LINE = "jenga: interrupted; what was finished is kept"

SLOW_CONVERSION = """
import time
import jenga_data.dataset.spool as module
fast = module.rows_of_all
module.rows_of_all = lambda *args: time.sleep(0.5) or fast(*args)
"""
SLOW_TRAINING = """
import time
from jenga_models.callbacks import MetricLog
fast = MetricLog.on_train_epoch_end
MetricLog.on_train_epoch_end = lambda *args: time.sleep(0.3) or fast(*args)
"""
SLOW_WORKERS = """
import pathlib, sys, time
if "--multiprocessing-fork" in sys.orig_argv:
    pathlib.Path(__file__).with_name("begun").touch()
    time.sleep(1)
"""
"""As sitecustomize.py: Python runs it before anything else."""


def was_interrupted(ran: Ran) -> None:
    assert ran.line(130) == LINE


def identity(folder: Path) -> dict[str, tuple[int, int]]:
    """Which file lies under each name, and when it was written."""
    return {p.name: (p.stat().st_ino, p.stat().st_mtime_ns) for p in folder.glob("*.mcap")}


def test_collect(selection_logs: Made, tmp_path):
    out = tmp_path / "logs"
    args = (*COLLECT["selection"], "--episodes", 4, "--workers", 2, "--out", out)
    was_interrupted(interrupted_when(lambda: len(list(out.glob("*.mcap"))) >= 1, *args))
    finished, whole = identity(out), contents(selection_logs.path, "*.mcap")
    assert 1 <= len(finished) < 4
    assert contents(out, "*.mcap").items() <= whole.items()
    others = contents(out).keys() - finished.keys() - {"collection.json", ".lock"}
    assert all(name.endswith(".mcap.partial") for name in others)

    again = jenga(*args, "--json").object()
    assert (again["episodes"], again["resumed"]) == (4, len(finished))
    assert identity(out).items() >= finished.items()
    assert contents(out, "*.mcap") == whole
    assert not list(out.glob("*.partial"))


def test_collect_while_its_workers_start(tmp_path):
    """Before they could say that Ctrl-C is not for them."""
    (tmp_path / "sitecustomize.py").write_text(SLOW_WORKERS)
    out = tmp_path / "logs"
    args = (*COLLECT["selection"], "--episodes", 2, "--workers", 2, "--out", out)
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    begun = (tmp_path / "begun").exists
    was_interrupted(interrupted_when(begun, *args, env={**os.environ, "PYTHONPATH": path}))
    assert contents(out).keys() == {"collection.json", ".lock"}


def test_collect_with_one_worker(selection_logs: Made, tmp_path):
    out = tmp_path / "logs"
    args = (*COLLECT["selection"], "--episodes", 1, "--workers", 1, "--out", out)
    was_interrupted(interrupted_when(lambda: bool(list(out.glob("*.partial"))), *args))
    assert not list(out.glob("*.mcap"))
    assert jenga(*args).code == 0
    assert contents(out, "*.mcap").items() <= contents(selection_logs.path).items()


def test_an_interrupted_collection_makes_no_dataset_before_it_is_finished(selection_logs: Made, tmp_path):
    logs = shutil.copytree(selection_logs.path, tmp_path / "logs")
    last = max(logs.glob("*.mcap"))
    last.rename(last.with_name(last.name + ".partial"))
    args = ("convert", logs, "--name", "pulls", "--version", "0.1.0", "--out", tmp_path / "dataset")
    assert "never finished: run the same `jenga collect` again" in jenga(*args).line()


def test_convert(dynamics: Made, extraction_logs: Made, tmp_path):
    out = tmp_path / "dataset"
    args = ("convert", extraction_logs.path, "--name", "steps", "--version", "0.1.0", "--out", out)
    staged = lambda: bool(list(tmp_path.glob(".dataset.*.partial/.spool/*.arrow")))  # noqa: E731  (a condition in one line)
    was_interrupted(interrupted_when(staged, *args, before=SLOW_CONVERSION))
    assert list(tmp_path.iterdir()) == []
    assert jenga(*args).code == 0
    assert contents(out) == contents(dynamics.path)


def test_train(selection: Made, tmp_path):
    out, undisturbed = tmp_path / "model", tmp_path / "undisturbed"
    args = ("train", "selection", "--dataset", selection.path, "--preset", "fast", "--epochs", 5)
    metrics = out / "metrics.csv"
    second_epoch = lambda: metrics.exists() and metrics.read_text().count("\n") == 3  # noqa: E731  (a condition in one line)
    was_interrupted(interrupted_when(second_epoch, *args, "--out", out, before=SLOW_TRAINING))
    assert not (out / "checkpoint.json").exists()
    assert not (out / "model.safetensors").exists()
    assert "add --resume to finish" in jenga(*args, "--out", out).line()
    reached = metrics.read_text()

    assert jenga(*args, "--out", out, "--resume").code == 0
    assert metrics.read_text().startswith(reached)
    assert jenga(*args, "--out", undisturbed).code == 0
    assert contents(out) == contents(undisturbed)


def test_eval_extraction(closed_loop: Made, tmp_path):
    """In the middle of a tower at which one way has pulled already."""
    out = tmp_path / "closed-loop"
    shutil.copytree(closed_loop.path / "naive", out / "naive")
    naive, straight = contents(out), out / "straight"
    args = ("eval", "extraction", "--objective", "naive", "straight", "--towers", 1, "--out", out)
    begun = (straight / "collection.json").exists
    ran = interrupted_when(begun, *args, before=CHEAP_CLOSED_LOOP)
    assert ran.code == 130
    assert ran.err.splitlines()[-1] == LINE
    assert ran.err.count("\n") <= 2  # what it will cost stands above
    assert not list(straight.glob("*.mcap"))
    assert contents(out).items() >= naive.items()

    with cheap_closed_loop():
        assert jenga(*args, "--workers", 1, "--json").object()["success"]["n"] == 1
    assert contents(straight, "*.mcap") == contents(closed_loop.path / "straight", "*.mcap")
    assert contents(out).items() >= naive.items()
