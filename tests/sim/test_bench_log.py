"""`jenga bench log` on a tower of four levels: both ways write and read the same."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from short_tower import SELECTION, short_towers

from jenga_data.bench.log import bench_log, figures, frames_of, measure
from jenga_data.bench.naive_log import read_naively, write_naively
from jenga_data.bench.trace import EpisodeTrace, trace_episode
from jenga_data.log.reader import read_episode
from jenga_data.log.writer import EpisodeWriter

FIGURES = {"write_frames", "write_messages", "read_frames", "read_messages", "share"}
TOPICS = ("/tower/state", "/tower/contacts", "/sim/state", "/tf")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("log")


@pytest.fixture(scope="module")
def trace(folder: Path) -> EpisodeTrace:
    with short_towers():
        return trace_episode(SELECTION, 0, 0, folder)


@pytest.fixture(scope="module")
def log(trace: EpisodeTrace, folder: Path) -> Path:
    """What the traced episode wrote."""
    return next(folder.glob("*.mcap"))


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("bench")
    with short_towers():
        return bench_log(SELECTION, 1, 0, out)


def messages(path: Path) -> list[tuple[str, int, bytes]]:
    with path.open("rb") as stream:
        return [(c.topic, m.log_time, m.data) for _, c, m in make_reader(stream).iter_messages(topics=TOPICS)]


def test_each_figure_stands_beside_its_reference(report):
    assert {name for name, value in report.items() if isinstance(value, dict) and "ratio" in value} == FIGURES
    for name in FIGURES:
        speed = report[name]
        assert speed["ratio"] == pytest.approx(speed["value"] / speed["reference"])
        assert speed["n"] == report["towers"] == 1
    for way in ("write", "read"):
        assert report[f"{way}_frames"]["ratio"] == pytest.approx(report[f"{way}_messages"]["ratio"])
        assert report[f"{way}_frames"]["value"] > 0
    # No lower bound for a ratio: under pytest jaxtyping checks every array that our writer and reader get.
    assert 0 < report["share"]["ratio"] < 1


def test_the_report_is_written(report):
    out = Path(report["out"])
    assert sorted(p.name for p in out.iterdir()) == ["bench-log.json", "bench-log.md"]
    kept = {name: value for name, value in report.items() if name != "text"}
    assert json.loads((out / "bench-log.json").read_text()) == json.loads(json.dumps(kept))
    assert all(f"| {name}: " in report["text"] for name in FIGURES)


def test_both_writers_write_the_same_frames(log, tmp_path):
    episode = read_episode(log)
    assert episode.result is not None
    frames = frames_of(episode)
    assert write_naively(tmp_path / "naive.mcap", frames) == 4 * len(episode.pose)
    with EpisodeWriter(tmp_path / "own.mcap", episode.header, "") as writer:
        for frame in frames:
            writer.frame(frame)
        writer.finish(episode.result)
    assert messages(tmp_path / "naive.mcap") == messages(tmp_path / "own.mcap") == messages(log)


def test_both_readers_read_the_same_poses(log):
    episode = read_episode(log)
    count, arrays = read_naively(log)
    states = arrays["/tower/state"]
    assert np.array_equal(np.stack(states[::2]).reshape(episode.pose.shape), episode.pose)  # a pose, then a twist
    assert np.array_equal(np.stack(arrays["/sim/state"]), episode.sim_state)
    assert count > 3 * len(episode.pose)


def test_rates_are_what_was_counted_by_the_time_it_took(trace, log, tmp_path):
    times = measure(log, tmp_path)
    episode = read_episode(log)
    assert times.frames == len(episode.pose)
    speeds = figures([trace], [times])
    assert speeds["write_frames"].value == pytest.approx(times.frames / times.write)
    assert speeds["read_messages"].reference == pytest.approx(times.read_messages / times.naive_read)
    assert speeds["share"].ratio == pytest.approx(trace.logging / trace.whole)
