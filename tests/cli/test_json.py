"""--json prints one object and nothing else, with the keys that scripts rely on (the design's table)."""

import json
import subprocess
from pathlib import Path

from jenga_runs import CHEAP, COLLECT, Made, jenga, run_apart, started

from jenga_data.dataset.locate import known_datasets
from jenga_data.dataset.verify import CHECKS

OUTCOMES = {"invalid", "collapsed", "extracted", "stuck"}


def is_proportion(value: object, n: int | None = None) -> bool:
    """{"rate", "n", "ci95": [lo, hi]}, and the rate lies in its interval."""
    assert isinstance(value, dict)
    assert value.keys() >= {"rate", "n", "ci95"}
    low, high = value["ci95"]
    assert 0 <= low <= value["rate"] <= high <= 1
    return value["n"] == n if n is not None else value["n"] > 0


def test_collect(selection_logs: Made, extraction_logs: Made):
    for made, episodes in ((selection_logs, 4), (extraction_logs, 3)):
        said = made.ran.object()
        assert said.keys() >= {"episodes", "outcomes", "causes", "seconds", "out"}
        assert said["episodes"] == episodes == len(list(made.path.glob("*.mcap")))
        assert said["outcomes"].keys() == OUTCOMES
        assert sum(said["outcomes"].values()) == episodes
        assert sum(said["causes"].values()) <= episodes
        assert said["seconds"] > 0
        assert said["out"] == str(made.path)


def test_collect_counts_the_episodes_that_were_there(extraction_logs: Made):
    again = jenga(*COLLECT["extraction"], "--episodes", 3, "--out", extraction_logs.path, "--json").object()
    first = extraction_logs.ran.object()
    assert again["resumed"] == 3
    assert {key: again[key] for key in ("episodes", "outcomes", "causes")} == {
        key: first[key] for key in ("episodes", "outcomes", "causes")
    }


def test_convert(selection: Made, dynamics: Made):
    for made, name, rows in ((selection, "pulls@0.1.0", 4), (dynamics, "steps@0.1.0", None)):
        said = made.ran.object()
        assert said["dataset"] == name
        assert said["out"] == str(made.path)
        assert said["hash"] == json.loads((made.path / "manifest.json").read_text())["hash"]
        assert said["counts"]["rows"] == rows or rows is None
        assert set(said["counts"]["outcome"]) <= OUTCOMES - {"invalid"}


def test_train(selector: Made, simulator: Made):
    for made in (selector, simulator):
        said = made.ran.object()
        assert said["checkpoint"] == str(made.path)
        assert said["metrics"]["epochs"] == 1
        assert said["seconds"] > 0
        assert len(said["hash"]) == 64


def test_eval_selection(selector: Made, selection: Made):
    said = jenga("eval", "selection", "--model", selector.path, "--dataset", selection.path, "--json").object()
    keys = {"accuracy", "auroc", "brier", "ece", "majority", "ceiling", "baselines", "model", "dataset"}
    assert said.keys() >= keys
    n = said["accuracy"]["n"]
    assert is_proportion(said["accuracy"])
    assert is_proportion(said["majority"], n)
    assert said["baselines"]
    assert all(is_proportion(baseline["accuracy"], n) for baseline in said["baselines"].values())
    assert said["dataset"] == "pulls@0.1.0"
    assert said["model"] == "selector"


def test_report_selection(selector: Made, selection: Made, tmp_path):
    args = ("--models", selector.path, "--dataset", selection.path, "--baselines", "none", "--out", tmp_path / "report")
    said = jenga("report", "selection", *args, "--json").object()
    assert said["rows"]["selector"]["kind"] == "model"
    assert is_proportion(said["rows"]["selector"]["accuracy"])
    assert said["best"] == "selector"
    assert all(Path(path).is_file() for path in said["written"])


def test_eval_dynamics(simulator: Made, dynamics: Made):
    said = jenga("eval", "dynamics", "--model", simulator.path, "--dataset", dynamics.path, "--json").object()
    assert said.keys() >= {"one_step", "rollout_5", "rollout_51", "rank_correlation"}
    for horizon in ("one_step", "rollout_5", "rollout_51"):
        assert said[horizon].keys() >= {"skill_others", "skill_target", "rmse_mm_others", "rmse_mm_target"}
    assert said["one_step"]["rmse_mm_target"] > 0


def test_eval_extraction(closed_loop: Made):
    said = closed_loop.ran.object()
    keys = {"success", "causes", "control_hz", "objective", "dynamics", "switches"}
    assert said["objective"] == "full"
    assert said["baselines"].keys() == {"naive", "straight"}
    for report in (said, *said["baselines"].values()):
        assert report.keys() >= keys
        assert is_proportion(report["success"], 1)
        assert report["outcomes"].keys() == OUTCOMES
    assert said["control_hz"] > 0
    assert [r["dynamics"] for r in (said, *said["baselines"].values())] == ["learned", "none", "none"]


def test_dataset_verify(selection: Made, dynamics: Made):
    for made in (selection, dynamics):
        said = run_apart("dataset", "verify", made.path, "--json").object()
        assert said["ok"] is True
        assert tuple(said["checks"]) == CHECKS
        assert all(check["ok"] is True and check["detail"] for check in said["checks"].values())


def test_dataset_info_and_list(selection: Made, monkeypatch):
    assert jenga("dataset", "info", selection.path, "--json").object()["kind"] == "selection"
    monkeypatch.setenv("JENGA_DATASETS", str(selection.path.parent))
    assert jenga("dataset", "list", "--json").object()["pulls@0.1.0"] == str(selection.path)


def test_log_info_and_doctor(extraction_logs: Made):
    log = min(extraction_logs.path.glob("*.mcap"))
    for verb in ("info", "doctor"):
        said = jenga("log", verb, log, "--json").object()
        assert said["complete"] is True
        assert said["problems"] == []
        assert said["outcome"] in OUTCOMES


def test_replay(extraction_logs: Made, simulator: Made, tmp_path):
    log, rrd = min(extraction_logs.path.glob("*.mcap")), tmp_path / "shown.rrd"
    said = jenga("replay", log, "--save", rrd, "--json").object()
    assert said == {"episode": str(log), "episodes": [str(log)], "written": [str(rrd)]}
    assert rrd.stat().st_size > 0


def test_report_page_takes_what_other_verbs_wrote(selection: Made, selection_logs: Made, tmp_path):
    results = ("--results", selection.path, "--selection", selection_logs.path)
    said = jenga("report", "page", *results, "--out", tmp_path / "page", "--json").object()
    assert said["results"] == 1 + len(known_datasets())  # manifests: that of --results, and of those at hand
    assert set(said["findings"].values()) == {"not measured"}
    assert "pulls@0.1.0" in Path(said["page"]).read_text()
    drawn = jenga("report", "figures", "--selection", selection.path, "--out", tmp_path / "figures", "--json").object()
    assert {figure["name"]: bool(figure["path"]) for figure in drawn["figures"]} == {
        "rounds": True, "key-frames": False, "pushes": False, "prediction": False, "touch": False, "tables": True,
    }  # fmt: skip


def test_bench_replay():
    said = jenga("bench", "replay", "--seconds", 0.1, "--repeats", 1, "--json").object()
    for name in ("write", "read_and_write", "with_model", "with_sidecar"):
        assert said[name].keys() >= {"value", "unit", "reference", "ratio"}


def test_bench_sim(tmp_path):
    said = jenga(
        *("bench", "sim", *CHEAP, "--speed", 0.3, "--pull-seconds", 0.1),
        *("--towers", 1, "--workers", 1, "--out", tmp_path / "out", "--json"),
    ).object()
    figures = ("awake_step", "logging", "workers", "selection_episodes", "step_at_rest", "step_while_pulling")
    for name in figures:
        assert said[name].keys() >= {"value", "unit", "reference", "ratio"}
    assert said["out"] == str(tmp_path / "out")
    assert json.loads((tmp_path / "out" / "bench-sim.json").read_text()) == said


def test_no_bar_where_stderr_is_no_terminal(extraction_logs: Made):
    """People see bars; a pipe gets the text alone."""
    log = min(extraction_logs.path.glob("*.mcap"))
    with_text, with_json = run_apart("log", "info", log), run_apart("log", "info", log, "--json")
    assert with_text.err == with_json.err == ""
    assert with_text.out.startswith(f"path: {log}\n")


def test_a_reader_that_has_seen_enough_is_no_error(selection: Made):
    with started("dataset", "info", selection.path, stdin=subprocess.DEVNULL) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.wait(60) == 0
        assert process.stderr is not None
        assert process.stderr.read() == ""
