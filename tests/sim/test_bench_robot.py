"""`jenga bench robot`: one real case on a short tower, and the report of made-up ones."""

import json
import sys
from typing import Any

import numpy as np
import pytest
from robot_stage import CONFIG, LOOSE
from short_tower import short_towers

import cli
from jenga_data.bench.robot import bench_robot, is_loose, robot_case
from jenga_data.calibrate.run import Run
from jenga_data.collect.causes import CAUSES
from jenga_data.collect.config import ExtractionConfig
from jenga_data.collect.stage import set_stage

KEYS = {
    "tower", "round", "level", "slot", "loose", "outcome", "cause", "dragged", "pushed_mm", "others_mm", "grasped",
    "across_mm", "along_mm", "angle", "speed", "torque", "simulated", "cpu", "actions",
}  # fmt: skip
TOWERS = 10


def some_case(config: ExtractionConfig, seed: int, number: int) -> dict[str, Any]:
    """Even targets are loose. Of the loose ones number 0 is pushed too far and number 2 grasped with another; of the
    tight ones 1 was never pushed, 3 is stuck, and 5 bumped."""
    cause = {1: "unsettled", 2: "grasp_two_blocks", 3: "push_stuck", 5: "bumped"}.get(number, "")
    pushed = {0: 23.5, 1: None, 3: 2.0}.get(number, 20.0 + 0.1 * number)
    return {
        "tower": f"tower {number}", "round": 1 + number, "level": 3, "slot": number % 3, "loose": number % 2 == 0,
        "outcome": "stuck" if cause else "extracted", "cause": cause, "dragged": False, "pushed_mm": pushed,
        "others_mm": None if pushed is None else 0.5,
        "grasped": None if number in (1, 5) else cause or "target", "across_mm": 0.1 * (1 + number) / 4,
        "along_mm": None if number == 1 else 1.0, "angle": 40.0 + number, "speed": 0.5, "torque": 0.4,
        "simulated": 30.0, "cpu": 10.0 + number, "actions": 20 + number,
    }  # fmt: skip


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jenga_data.bench.robot.robot_case", some_case)


# --- a real case ---------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("unchecked_shapes")  # which takes a quarter of the time
def test_a_case_says_all_of_one_episode():
    with short_towers():
        stage, found = set_stage(LOOSE, 0, 90), robot_case(LOOSE, 0, 90)
    assert set(found) == KEYS
    json.dumps(found)
    place = stage.layout.place(stage.target)
    assert (found["tower"], found["round"]) == (stage.blocks.tower, stage.layout.round)
    assert (found["level"], found["slot"]) == (place.level, place.slot)
    assert found["loose"] is is_loose(stage, LOOSE)
    assert (found["outcome"], found["cause"], found["grasped"]) == ("extracted", "", "target")
    assert found["pushed_mm"] == pytest.approx(20, abs=3)
    assert 0 <= found["others_mm"] < 5
    assert 0 < found["across_mm"] < 0.5
    assert 0 < found["along_mm"] < 5
    assert found["angle"] > 20
    assert 0.1 < found["speed"] < 1
    assert 0.1 < found["torque"] <= 1
    assert 10 < found["simulated"] < 40
    assert found["cpu"] > 0
    assert 4 < found["actions"] < 51


# --- the report ----------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("made_up")
def test_proportions_are_those_of_the_cases(tmp_path):
    report = bench_robot(Run(TOWERS, 0, 1, tmp_path), CONFIG)

    def share(name: str) -> tuple[Any, int]:
        return pytest.approx(report[name]["rate"]), report[name]["n"]

    assert share("loose") == (0.5, 10)
    assert share("push_of_loose") == (0.8, 5)
    assert share("grasp_of_loose") == (0.8, 5)
    assert share("push_of_tight") == (0.75, 4)  # of 3, 5, 7, 9
    assert share("grasp_of_tight") == (pytest.approx(2 / 3), 3)  # of 3, 7, 9
    assert share("extracted_of_loose") == (0.8, 5)
    assert share("toppled_by_turn_or_approach") == (0.2, 10)
    assert share("self_collision") == (0, 10)
    assert report["outcomes"] == {"extracted": 6, "stuck": 4}
    assert report["causes"] == {"none": 6, "bumped": 1, "grasp_two_blocks": 1, "push_stuck": 1, "unsettled": 1}
    assert report["joint_margin_deg"] == 40.0
    assert report["across_mm"]["largest"] == pytest.approx(0.25)
    assert report["along_mm"]["median"] == 1.0
    assert report["actions_in_tower"] == pytest.approx(24.5)
    assert (report["episodes"], report["seed"]) == (TOWERS, 0)
    assert report["episode"]["value"] == pytest.approx(14.5)
    assert report["dynamics_data"]["value"] == pytest.approx(12_000 / 24.5 * 14.5 / 60)  # one worker


@pytest.mark.usefixtures("made_up")
def test_the_text_says_what_was_asked_for_and_what_each_cause_means(tmp_path):
    report = bench_robot(Run(TOWERS, 0, 1, tmp_path), CONFIG)
    text = (tmp_path / "bench-robot.md").read_text()
    assert "10 episodes, random legal targets of rounds 1 to 2." in text
    assert report["text"].startswith("10 episodes")
    rows = {line.split("|")[1].strip(): line for line in text.splitlines() if line.startswith("|")}
    assert "at least 0.95" in rows["push of a loose target within 20 +- 3 mm"]
    assert "at least 0.98" in rows["grasp of a loose target alone"]
    for cause in ("bumped", "grasp_two_blocks", "push_stuck", "unsettled"):
        assert CAUSES[cause] in rows[cause]
    assert "nothing went wrong" in rows["none"]
    assert json.loads((tmp_path / "bench-robot.json").read_text())["episodes"] == TOWERS
    assert (tmp_path / "bench-robot.png").stat().st_size > 10_000


@pytest.mark.usefixtures("made_up")
def test_a_bench_in_which_nothing_is_loose_has_a_report(tmp_path, monkeypatch):

    def tight(config: ExtractionConfig, seed: int, number: int) -> dict[str, Any]:
        return some_case(config, seed, number) | {"loose": False}

    monkeypatch.setattr("jenga_data.bench.robot.robot_case", tight)
    report = bench_robot(Run(3, 0, 1, tmp_path), CONFIG)
    assert report["push_of_loose"]["n"] == 0
    assert not np.isfinite(report["push_of_loose"]["rate"] or np.nan)


@pytest.mark.usefixtures("made_up")
def test_json_has_the_keys_that_scripts_rely_on(tmp_path, monkeypatch, capsys):
    line = ["jenga", "bench", "robot", "--towers", "10", "--workers", "1", "--out", str(tmp_path / "out"), "--json"]
    monkeypatch.setattr(sys, "argv", line)
    with pytest.raises(SystemExit) as stop:
        cli.main()
    out, err = capsys.readouterr()
    assert (stop.value.code or 0, err) == (0, "")
    assert set(json.loads(out)) == {
        "episode", "simulated", "episodes", "seed", "outcomes", "causes", "loose", "push_of_loose", "grasp_of_loose",
        "push_of_tight", "grasp_of_tight", "extracted_of_loose", "toppled_by_turn_or_approach", "self_collision",
        "joint_margin_deg", "joint_speed_share", "joint_torque_share", "across_mm", "along_mm", "actions_in_tower",
        "dynamics_data", "written",
    }  # fmt: skip
