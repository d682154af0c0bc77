"""What an evaluation of the closed loop counts: every tower that was started, once, and the same for every way."""

import warnings

import numpy as np
import pytest
from closed_loops import CHEAP, MODEL, MadeUpPulls, copied, evaluated, result
from made_up_dataset import dynamics_dataset, untrained

from jenga_control.extraction.evaluate import evaluate_extraction
from jenga_data.collect.config import SEED_LIMIT
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.outcome import Outcome
from jenga_models.checkpoint import load
from jenga_models.overlay import overlay

KEYS = {"success", "causes", "control_hz", "objective", "dynamics", "switches", "outcomes", "median_disturbance_mm"}
NAIVE = [
    result(Outcome.EXTRACTED, moved=0.001),
    result(Outcome.STUCK, "grasp_missed", moved=0.002),
    result(Outcome.COLLAPSED, moved=0.3),
    result(Outcome.INVALID),
    result(Outcome.EXTRACTED, "slipped", moved=0.02, dragged=True),
]
STRAIGHT = [result(Outcome.EXTRACTED), *[result(Outcome.STUCK, "slipped") for _ in range(4)]]


@pytest.fixture
def pulls(monkeypatch):
    made_up = MadeUpPulls({"naive": NAIVE, "straight": STRAIGHT, "full": STRAIGHT})
    monkeypatch.setattr("jenga_control.extraction.evaluate.Trunk", made_up)
    return made_up


def evaluate(out, *controllers, towers=5, model=None, seed=SEED_LIMIT):
    return evaluate_extraction(model, out, controllers, towers, seed, workers=1, config=CHEAP)


def test_every_tower_that_was_started_is_in_the_denominator(pulls, tmp_path):
    report = evaluate(tmp_path, "naive")
    assert report["outcomes"] == {"invalid": 1, "collapsed": 1, "extracted": 2, "stuck": 1}
    assert report["success"]["n"] == 5
    assert report["success"]["rate"] == 2 / 5
    assert report["success"]["ci95"][0] < 2 / 5 < report["success"]["ci95"][1]
    assert report["success_without_dragging"]["rate"] == 1 / 5


def test_a_failure_has_one_cause(pulls, tmp_path):
    """That of the robot's side if there is one, else the outcome; a success has none."""
    assert evaluate(tmp_path, "naive")["causes"] == {"collapsed": 1, "grasp_missed": 1}


def test_broken_physics_disturb_no_median(pulls, tmp_path):
    assert evaluate(tmp_path, "naive")["median_disturbance_mm"] == pytest.approx(np.median([1, 2, 300, 20]))


def test_broken_physics_alone_have_no_median(monkeypatch, tmp_path):
    pulls = MadeUpPulls({"naive": [result(Outcome.INVALID)]})
    monkeypatch.setattr("jenga_control.extraction.evaluate.Trunk", pulls)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        report = evaluate(tmp_path, "naive", towers=1)
    assert report["median_disturbance_mm"] is None
    assert report["success"]["rate"] == 0


def test_ways_to_pull_are_compared_on_the_same_towers(pulls, tmp_path):
    report = evaluate(tmp_path, "naive", "straight")
    assert pulls.ran == [(name, number) for number in range(5) for name in ("naive", "straight")]
    assert report["objective"] == "naive"
    assert report["baselines"].keys() == {"straight"}
    straight = report["baselines"]["straight"]
    assert straight["success"]["rate"] == 1 / 5
    assert straight["paired"]["n"] == 5
    assert straight["paired"]["difference"] == pytest.approx(2 / 5 - 1 / 5)
    assert (straight["paired"]["only_first"], straight["paired"]["only_second"]) == (1, 0)


def test_what_was_pulled_is_not_pulled_again(pulls, tmp_path):
    first = evaluate(tmp_path, "naive", towers=2)
    pulls.ran.clear()
    evaluate(tmp_path, "naive", towers=3)
    assert pulls.ran == [("naive", 2)]
    again = evaluate(tmp_path, "naive", towers=2)
    assert again["success"] == first["success"]
    assert again["outcomes"] == first["outcomes"]


def test_files_beside_its_rollouts_count_for_nothing(pulls, tmp_path):
    """Predictions that replay left, and logs that somebody copied there."""
    model = untrained(tmp_path / "model", MODEL, dynamics_dataset())
    logs = tmp_path / "logs"
    before = evaluate(logs, "naive", "full", model=model)
    foreign = next((logs / "full").glob("*.mcap"))
    for log in (logs / "naive").glob("*.mcap"):
        overlay(load(model), log)
    copied_log = logs / "naive" / foreign.name
    copied_log.write_bytes(foreign.read_bytes())
    after = evaluate(logs, "naive", "full", model=model)
    for name in ("success", "outcomes", "causes", "median_disturbance_mm"):
        assert after[name] == before[name]


def test_the_report_says_what_was_asked_of_what(pulls, tmp_path):
    model = untrained(tmp_path / "model", MODEL, dynamics_dataset())
    report = evaluate(tmp_path / "logs", "full", "naive", "straight", model=model)
    naive, straight = report["baselines"]["naive"], report["baselines"]["straight"]
    assert all(each.keys() >= KEYS for each in (report, naive, straight))
    assert [each["dynamics"] for each in (report, naive, straight)] == ["learned", "none", "none"]
    assert [each["objective"] for each in (report, naive)] == ["full", "naive"]
    assert straight["objective"].startswith("straight pull")
    assert [each["model"] for each in (report, naive, straight)] == [load(model).hash, "", ""]
    assert report["control_hz"] > 0
    assert "paired" not in report


def test_a_real_evaluation(tmp_path_factory):
    folder, report = evaluated(tmp_path_factory.getbasetemp())
    for each in (report, *report["baselines"].values()):
        assert each.keys() >= KEYS
        assert each["success"]["n"] == sum(each["outcomes"].values()) == 1
        assert each["success"]["rate"] == each["outcomes"]["extracted"]
    assert {path.name for path in (folder / "logs").iterdir()} == {"full", "naive", "straight"}


def test_a_real_evaluation_is_read_from_its_logs(tmp_path_factory, tmp_path):
    """Run again on a copy it simulates nothing and says the same."""
    folder, report = evaluated(tmp_path_factory.getbasetemp())
    logs = copied(folder / "logs", tmp_path / "logs")
    before = {path: path.stat().st_mtime_ns for path in logs.rglob("*.mcap")}
    again = evaluate_extraction(folder / "model", logs, towers=1, workers=1, config=CHEAP)
    assert {path: path.stat().st_mtime_ns for path in logs.rglob("*.mcap")} == before
    for key in ("success", "outcomes", "causes", "median_disturbance_mm"):
        assert again[key] == report[key]


def test_training_seeds_are_refused(tmp_path):
    with pytest.raises(JengaError, match="evaluation uses seeds from 900000 up"):
        evaluate(tmp_path, "naive", seed=SEED_LIMIT - 1)


@pytest.mark.parametrize("controllers", [(), ("naive", "naive")])
def test_every_way_is_evaluated_once(controllers, tmp_path):
    with pytest.raises(JengaError, match="allowed: one or more of full, naive, straight-SPEED and hindsight"):
        evaluate(tmp_path, *controllers)


def test_a_missing_model_is_told_before_anything_is_pulled(pulls, tmp_path, monkeypatch):
    monkeypatch.setattr("jenga_models.pretrained.FOLDER", tmp_path)
    with pytest.raises(JengaError, match="no trained dynamics model; name one: --model"):
        evaluate(tmp_path / "logs", "naive", "full")
    assert pulls.ran == []
    assert not (tmp_path / "logs").exists()


def test_logs_of_another_model_are_not_mixed_in(pulls, tmp_path):
    from dataclasses import replace

    models = [untrained(tmp_path / f"model{i}", replace(MODEL, seed=i), dynamics_dataset()) for i in (0, 1)]
    evaluate(tmp_path / "logs", "full", model=models[0])
    with pytest.raises(JengaError, match="another configuration or seed"):
        evaluate(tmp_path / "logs", "full", model=models[1])


def test_a_missing_pull_is_made_up_for_alone(pulls, tmp_path):
    first = evaluate(tmp_path, "naive", "straight", towers=3)
    pulls.ran.clear()
    sorted((tmp_path / "straight").glob("*.mcap"))[0].unlink()
    again = evaluate(tmp_path, "naive", "straight", towers=3)
    assert [name for name, _ in pulls.ran] == ["straight"]
    assert again["success"] == first["success"]
    assert again["baselines"]["straight"]["outcomes"] == first["baselines"]["straight"]["outcomes"]


def test_a_bug_in_one_way_costs_the_others_nothing(pulls, tmp_path):
    pulls.results["straight"] = []
    with pytest.raises(CheckFailed, match="set aside"):
        evaluate(tmp_path, "naive", "straight", towers=2)
    assert len(list((tmp_path / "naive").glob("*.mcap"))) == 2
    assert len(list((tmp_path / "straight" / "set_aside").glob("*.json"))) == 2
    pulls.results["straight"] = STRAIGHT
    assert evaluate(tmp_path, "naive", "straight", towers=2)["success"]["n"] == 2
    assert not (tmp_path / "straight" / "set_aside").exists()


def test_the_cost_is_told_to_people_before_anything_is_pulled(pulls, tmp_path, capsys, monkeypatch):
    evaluate(tmp_path / "unseen", "naive", "straight", towers=2)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    evaluate(tmp_path, "naive", "straight", towers=2)
    told = capsys.readouterr().err
    assert "2 towers, 4 rollouts to do: about " in told
    evaluate(tmp_path, "naive", "straight", towers=2)
    assert "rollouts to do" not in capsys.readouterr().err
