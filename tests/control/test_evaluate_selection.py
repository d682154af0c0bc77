import json

import numpy as np
import pytest
from made_up_dataset import dynamics_dataset, selection_dataset, untrained

from jenga_control import evaluate_selection as module
from jenga_control.evaluate_selection import Pulls, baseline_predictions, evaluate_selection, selection_report
from jenga_control.tables import selection_tables
from jenga_data.errors import JengaError
from jenga_data.report import to_json
from jenga_models.config import SelectionTraining


def pulls(dataset, split):
    return Pulls.of_dataset(dataset, dataset.rows(split))


@pytest.fixture
def train():
    return pulls(selection_dataset(), "train")


@pytest.fixture
def test():
    return pulls(selection_dataset(), "test")


def test_an_oracle_is_always_right(train, test):
    report = selection_report(test.failure.astype(float), test, train)
    assert report["accuracy"]["rate"] == report["auroc"] == 1
    assert report["brier"] == report["ece"] == 0
    assert report["confusion"]["failure_predicted_success"] == report["confusion"]["success_predicted_failure"] == 0
    assert report["n"] == len(test) == report["accuracy"]["n"]
    assert report["strict"]["accuracy"]["rate"] < 1


def test_a_predictor_that_is_always_wrong_fills_the_other_cells(train, test):
    report = selection_report((~test.failure).astype(float), test, train)
    assert report["accuracy"]["rate"] == report["auroc"] == 0
    assert report["confusion"]["failure_predicted_success"] == test.failure.sum()
    assert report["confusion"]["success_predicted_failure"] == (~test.failure).sum()


def test_baselines_are_fitted_to_the_training_rows_alone(train, test):
    said = baseline_predictions(train, test)
    assert said["majority"].all() == (train.failure.mean() >= 0.5)
    np.testing.assert_array_equal(said["rule"], test.slot != 1)

    upside_down = Pulls(**{**vars(train), "failure": ~train.failure})
    said = baseline_predictions(upside_down, test)
    assert said["majority"].all() == (upside_down.failure.mean() >= 0.5)
    np.testing.assert_array_equal(said["rule"], test.slot == 1)


def test_a_model_that_says_the_rule_does_not_differ_from_it(train, test):
    report = selection_report((test.slot != 1).astype(float), test, train)
    rule = report["baselines"]["rule"]
    assert rule["accuracy"] == report["accuracy"]
    assert rule["model_minus_baseline"]["difference"] == 0
    assert rule["model_minus_baseline"]["p_value"] == 1
    assert report["majority"] == report["baselines"]["majority"]["accuracy"]


def test_groups_add_up_to_the_whole(train, test):
    probability = np.random.default_rng(1).random(len(test))
    report = selection_report(probability, test, train)
    right = report["accuracy"]["rate"] * len(test)
    for key, names in (("by_round", "123"), ("by_slot", "012"), ("by_outcome", ("extracted", "stuck"))):
        groups = report[key]
        assert list(groups) == list(names)
        assert sum(g["accuracy"]["rate"] * g["accuracy"]["n"] for g in groups.values()) == pytest.approx(right)
    assert report["by_outcome"]["stuck"]["failures"]["rate"] == 1


def test_evaluation_touches_the_test_split_only(tmp_path, monkeypatch):
    dataset = selection_dataset()
    model = untrained(tmp_path / "gcn", SelectionTraining(), dataset)
    predicted = []

    def remember(checkpoint, dataset, rows):
        predicted.append(rows)
        return np.full(len(rows), 0.25)

    monkeypatch.setattr(module, "predict_selection", remember)
    report = evaluate_selection(model, dataset)
    (rows,) = predicted
    assert set(dataset.splits[rows]) == {"test"}
    assert report["n"] == len(rows) == (dataset.splits == "test").sum()
    assert "validation" not in dataset.asked

    # Labels of the training rows decide the baselines and nothing else.
    spoilt = selection_dataset()
    spoilt.columns["failure"] = spoilt.columns["failure"] ^ (spoilt.splits != "test")
    for key, value in evaluate_selection(model, spoilt).items():
        assert (value == report[key]) == (key not in ("majority", "baselines")), key


def test_an_untrained_checkpoint_is_scored_with_all_the_keys_that_scripts_rely_on(tmp_path):
    dataset = selection_dataset()
    report = evaluate_selection(untrained(tmp_path / "gcn", SelectionTraining(), dataset), dataset)
    assert report["model"] == "gcn"
    assert report["dataset"] == "made-up@1.0.0"
    assert report["note"] == ""
    for key in ("accuracy", "majority"):
        assert {"rate", "n", "ci95"} <= set(report[key])
    assert {"rate", "n", "ci95"} <= set(report["baselines"]["rule"]["accuracy"])
    for key in ("auroc", "brier"):
        low, high = report[f"{key}_ci95"]
        assert low <= report[key] <= high
    assert 0 <= report["ece"] <= 1
    assert report["ceiling"] is None
    assert "calibrate ceiling" in report["ceiling_reason"]
    assert json.loads(to_json(report)) == report
    text = selection_tables(report)
    assert "| **model** |" in text
    assert "| majority |" in text
    assert "| ceiling | – |" in text
    assert str(tmp_path) not in to_json(report)


def test_says_when_the_model_was_trained_on_other_data(tmp_path):
    dataset = selection_dataset()
    model = untrained(tmp_path / "gcn", SelectionTraining(), dataset)
    dataset.hash = "6" * 64
    assert "was trained on made-up@1.0.0" in evaluate_selection(model, dataset)["note"]


def test_refuses_a_dataset_of_transitions_and_one_without_test_rows(tmp_path):
    dataset = selection_dataset()
    model = untrained(tmp_path / "gcn", SelectionTraining(), dataset)
    with pytest.raises(JengaError, match="wanted: dynamics"):
        evaluate_selection(model, dynamics_dataset())
    dataset.splits = np.where(dataset.splits == "test", "train", dataset.splits)
    with pytest.raises(JengaError, match="60 train and 0 test rows"):
        evaluate_selection(model, dataset)
