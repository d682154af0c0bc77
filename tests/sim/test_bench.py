"""`jenga bench sim` on towers of four levels: what it measures is the episode that `collect` makes."""

import json
import os
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from short_tower import SELECTION, run_short, short_towers

from jenga_data.bench.crowd import run_crowd
from jenga_data.bench.lockstep import lockstep
from jenga_data.bench.sim import bench_sim
from jenga_data.bench.speed import Speed, speed_table
from jenga_data.bench.trace import EpisodeTrace, trace_episode
from jenga_data.collect.workers import run_and_log
from jenga_data.errors import JengaError
from jenga_data.progress import progress

FIGURES = {
    "awake_step",
    "logging",
    "workers",
    "workers_cpu",
    "selection_episodes",
    "selection_episodes_cpu",
    "step_at_rest",
    "step_while_pulling",
    "realtime",
    "spawn",
}


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bench")


@pytest.fixture(scope="module")
def report(out: Path) -> dict[str, Any]:
    with short_towers():
        return bench_sim(SELECTION, 2, 0, 2, out, partial(run_short, SELECTION))


@pytest.fixture(scope="module")
def trace(tmp_path_factory: pytest.TempPathFactory) -> EpisodeTrace:
    with short_towers():
        return trace_episode(SELECTION, 0, 0, tmp_path_factory.mktemp("log"))


# --- the report ----------------------------------------------------------------------------------------------------


def test_each_figure_stands_beside_its_reference(report):
    assert {name for name, value in report.items() if isinstance(value, dict) and "ratio" in value} == FIGURES
    for name in FIGURES:
        speed = report[name]
        assert speed["value"] > 0
        assert speed["ratio"] == pytest.approx(speed["value"] / speed["reference"])
        assert speed["n"] == report["towers"] == 2
        for interval, of in ((speed["ci95"], "value"), (speed["ratio_ci95"], "ratio")):
            assert interval is None or interval[0] - 1e-9 <= speed[of] <= interval[1] + 1e-9 or name == "awake_step"


def test_the_parts_of_an_episode_add_up(report):
    assert sum(report["shares"].values()) == pytest.approx(1.0)
    assert all(0 < share < 1 for share in report["shares"].values())
    assert report["logging"]["ratio"] == pytest.approx(report["shares"]["logging"])
    assert report["spawn"]["ratio"] == pytest.approx(report["shares"]["spawn"])


def test_times_of_a_dataset_are_those_of_its_episodes(report):
    for name in ("selection_episodes", "selection_episodes_cpu"):
        speed = report[name]
        assert speed["value"] == pytest.approx(speed["seconds_an_episode"] * 2000 / 2 / 60)
        assert speed["reference"] == 100


def test_the_report_is_written_as_json_tables_and_plot(report, out):
    written = json.loads((out / "bench-sim.json").read_text())
    assert written == json.loads(json.dumps({name: value for name, value in report.items() if name != "text"}))
    tables = (out / "bench-sim.md").read_text()
    assert tables == report["text"]
    assert all(f"| {name}: " in tables for name in FIGURES)
    assert (out / "bench-sim.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(p.name for p in out.iterdir()) == ["bench-sim.json", "bench-sim.md", "bench-sim.png"]


# --- what is measured ----------------------------------------------------------------------------------------------


def test_a_watched_episode_is_the_one_that_is_collected(tmp_path):
    for name in ("watched", "collected"):
        (tmp_path / name).mkdir()
    with short_towers():
        trace = trace_episode(SELECTION, 3, 1, tmp_path / "watched")
    run_and_log(partial(run_short, SELECTION), 3, tmp_path / "collected", 1)
    (watched,), (collected,) = ([*(tmp_path / name).iterdir()] for name in ("watched", "collected"))
    assert watched.name == collected.name
    assert watched.read_bytes() == collected.read_bytes()
    assert trace.logging + trace.spawn + trace.steps.seconds.sum() < trace.whole


def test_phases_divide_the_steps(trace):
    parts = [trace.steps_of(name) for name in trace.phase]
    assert list(trace.phase) == ["pull", "observe"]
    assert [(part.start, part.stop) for part in parts] == [
        (0, trace.phase["observe"]),
        (trace.phase["observe"], len(trace.steps.seconds)),
    ]
    target = np.abs(trace.steps.force[parts[0], trace.stage.target]).max(1)
    assert (target > 0).all()
    assert np.delete(trace.steps.force, trace.stage.target, axis=1).max() == 0


def test_both_of_a_lockstep_go_through_the_same_states(trace):
    pair = lockstep(SELECTION, 0, 0, trace)
    assert pair.same
    assert len(pair.own) == len(pair.bare) > 50
    assert min(pair.own.min(), pair.bare.min()) > 0


def test_a_lockstep_that_falls_apart_is_noticed(trace):
    other = replace(trace, steps=replace(trace.steps, force=trace.steps.force * 1.01))
    assert not lockstep(SELECTION, 0, 0, other).same


def _die(seed: int, number: int, open_log: object) -> NoReturn:
    os._exit(1)


def test_a_worker_that_dies_is_named(tmp_path):
    with progress("", 1) as bar, pytest.raises(JengaError, match="a worker process died"):
        run_crowd(_die, 0, [0], 1, tmp_path, bar)


# --- a figure ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "at_least", "met"), [(1.0, False, True), (1.2, False, False), (1.0, True, False), (1.2, True, True)]
)
def test_a_limit_is_kept_from_its_own_side(value, at_least, met):
    speed = Speed("a step", 2 * value, "ms", 2.0, n=1, limit=1.1, at_least=at_least)
    assert speed.met is met
    assert ("(missed)" in speed_table({"x": speed})) is not met


@pytest.mark.parametrize(("change", "says"), [({"towers": 0}, "towers is 0"), ({"workers": 0}, "workers is 0")])
def test_counts_are_at_least_one(change, says, tmp_path):
    counts = {"towers": 1, "workers": 1} | change
    with pytest.raises(JengaError, match=says):
        bench_sim(SELECTION, counts["towers"], 0, counts["workers"], tmp_path / "out")
    assert not (tmp_path / "out").exists()
