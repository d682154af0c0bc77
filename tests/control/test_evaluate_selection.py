import json
from types import SimpleNamespace

import numpy as np
import pytest
from made_up_dataset import dynamics_dataset, selection_dataset, untrained

from jenga_control.selection import evaluate as module
from jenga_control.selection.evaluate import evaluate_selection, read_ceiling, selection_report, sides
from jenga_control.selection.pulls import Prediction, Pulls
from jenga_control.tables import selection_tables
from jenga_data.errors import JengaError
from jenga_data.report import to_json
from jenga_models.config import SelectionTraining


def pulls(dataset, split):
    return Pulls.of_dataset(dataset, dataset.rows(split))


@pytest.fixture
def test():
    return pulls(selection_dataset(), "test")


@pytest.fixture
def rule(test):
    """What people say, and what the majority says."""
    return [
        Prediction("majority", "none", np.full(len(test), 0.6), {}),
        Prediction("middle_first", "G_s+layout", (test.slot != 1).astype(float), {}),
    ]


def test_an_oracle_is_always_right(test, rule):
    report = selection_report(test.failure.astype(float), test, rule)
    assert report["accuracy"]["rate"] == report["auroc"] == 1
    assert report["brier"] == report["ece"] == 0
    assert report["confusion"]["failure_predicted_success"] == report["confusion"]["success_predicted_failure"] == 0
    assert report["n"] == len(test) == report["accuracy"]["n"]
    assert report["strict"]["accuracy"]["rate"] < 1


def test_a_predictor_that_is_always_wrong_fills_the_other_cells(test, rule):
    report = selection_report((~test.failure).astype(float), test, rule)
    assert report["accuracy"]["rate"] == report["auroc"] == 0
    assert report["confusion"]["failure_predicted_success"] == test.failure.sum()
    assert report["confusion"]["success_predicted_failure"] == (~test.failure).sum()


def test_a_model_that_says_the_rule_does_not_differ_from_it(test, rule):
    report = selection_report((test.slot != 1).astype(float), test, rule)
    entry = report["baselines"]["middle_first"]
    assert entry["accuracy"] == report["accuracy"]
    assert entry["model_minus_baseline"]["difference"] == 0
    assert entry["model_minus_baseline"]["p_value"] == 1
    assert report["majority"] == report["baselines"]["majority"]["accuracy"]


def test_groups_add_up_to_the_whole(test, rule):
    probability = np.random.default_rng(1).random(len(test))
    report = selection_report(probability, test, rule)
    right = report["accuracy"]["rate"] * len(test)
    for key, names in (("by_round", "123"), ("by_slot", "012"), ("by_outcome", ("extracted", "stuck"))):
        groups = report[key]
        assert list(groups) == list(names)
        assert sum(g["accuracy"]["rate"] * g["accuracy"]["n"] for g in groups.values()) == pytest.approx(right)
    assert report["by_outcome"]["stuck"]["failures"]["rate"] == 1


def test_the_model_is_asked_about_test_rows_only(tmp_path, monkeypatch):
    dataset = selection_dataset()
    model = untrained(tmp_path / "gcn", SelectionTraining(), dataset)
    predicted = []

    def remember(checkpoint, dataset, rows):
        predicted.append(rows)
        return np.full(len(rows), 0.25)

    monkeypatch.setattr(module, "predict_selection", remember)
    report = evaluate_selection(model, dataset, baselines="none")
    (rows,) = predicted
    assert set(dataset.splits[rows]) == {"test"}
    assert report["n"] == len(rows) == (dataset.splits == "test").sum()

    # Labels of the other rows decide the baselines and nothing else.
    spoilt = selection_dataset()
    spoilt.columns["failure"] = spoilt.columns["failure"] ^ (spoilt.splits != "test")
    for key, value in evaluate_selection(model, spoilt, baselines="none").items():
        assert (value == report[key]) == (key not in ("majority", "baselines")), key


def test_learned_baselines_stand_beside_the_rules(tmp_path, monkeypatch):
    from jenga_control.selection.baselines import suite

    monkeypatch.setattr(suite, "LEARNED", [b for b in suite.LEARNED if b.learner == "logistic"])
    dataset = selection_dataset(18)
    model = untrained(tmp_path / "gcn", SelectionTraining(), dataset)
    quick, everything = (evaluate_selection(model, dataset, baselines=which) for which in ("quick", "all"))
    assert list(quick["baselines"]) == [
        "majority",
        "loosest_first",
        "middle_first",
        "logistic_graph",
        "logistic_layout",
    ]
    more = set(everything["baselines"]) - set(quick["baselines"])
    assert more == {"mechanics_logistic", "mechanics_poses_logistic"}
    assert quick["baselines"]["logistic_layout"]["settings"].keys() == {"logisticregression__C"}


def test_refuses_a_tower_on_both_sides():
    dataset, other = selection_dataset(), selection_dataset()
    other.splits = np.full(len(other), "train")
    with pytest.raises(JengaError, match=r"30 training rows of made-up@1\.0\.0 are of test towers"):
        sides(dataset, [other], 1)
    other.columns["tower"] = np.array([f"other {t}" for t in other.columns["tower"]], dtype=object)
    train, test = sides(dataset, [other], 1)
    assert (len(train.pulls), len(test.pulls)) == (60 + 90, 30)


def test_the_ceiling_comes_from_its_report(tmp_path):
    ceiling = tmp_path / "ceiling.json"
    agreement = {"rate": 0.9, "n": 50, "ci95": [0.8, 0.95]}
    ceiling.write_text(json.dumps({"agreement": agreement, "accuracy_bounds": [0.9, 0.95], "seed": 3}))
    assert read_ceiling(ceiling) == {**agreement, "accuracy_bounds": [0.9, 0.95]}
    dataset = selection_dataset()
    model = untrained(tmp_path / "gcn", SelectionTraining(), dataset)
    report = evaluate_selection(model, dataset, baselines="none", ceiling=ceiling)
    assert report["ceiling"]["rate"] == 0.9
    assert "| ceiling: two pulls agree | – | 0.90" in selection_tables(report)
    ceiling.write_text('{"agreement": 1}')
    with pytest.raises(JengaError, match="no report of `jenga calibrate ceiling`"):
        read_ceiling(ceiling)
    with pytest.raises(JengaError, match="cannot read"):
        read_ceiling(tmp_path / "none.json")


def test_the_paper_s_pulls_are_told_apart_from_later_ones_of_their_towers(tmp_path):
    dataset = selection_dataset()
    model = untrained(tmp_path / "gcn", SelectionTraining(), dataset)
    assert "one_pull_a_tower" not in evaluate_selection(model, dataset, baselines="none")
    configs = {"first": {"pull": 0, "physics": {}}, "later": {"pull": 1, "physics": {}}}
    dataset.manifest.provenance = SimpleNamespace(configs=configs)
    which = np.where(np.arange(len(dataset)) % 3, "later", "first")
    dataset.episodes = lambda: {"episode": dataset.column("episode"), "config": which}
    report = evaluate_selection(model, dataset, baselines="none")
    assert report["one_pull_a_tower"]["accuracy"]["n"] == 10
    assert "Of one pull a tower" in selection_tables(report)


def test_an_untrained_checkpoint_is_scored_with_all_the_keys_that_scripts_rely_on(tmp_path):
    dataset = selection_dataset()
    model = untrained(tmp_path / "gcn", SelectionTraining(), dataset)
    report = evaluate_selection(model, dataset, baselines="none")
    assert report["model"] == "gcn"
    assert report["dataset"] == "made-up@1.0.0"
    assert report["note"] == ""
    for key in ("accuracy", "majority"):
        assert {"rate", "n", "ci95"} <= set(report[key])
    assert {"rate", "n", "ci95"} <= set(report["baselines"]["middle_first"]["accuracy"])
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
    assert "| ceiling: two pulls agree | – | – |" in text
    assert str(tmp_path) not in to_json(report)


def test_says_when_the_model_was_trained_on_other_data(tmp_path):
    dataset = selection_dataset()
    model = untrained(tmp_path / "gcn", SelectionTraining(), dataset)
    dataset.hash = "6" * 64
    assert "was trained on made-up@1.0.0" in evaluate_selection(model, dataset, baselines="none")["note"]


def test_refuses_a_dataset_of_transitions_and_one_without_test_rows(tmp_path):
    dataset = selection_dataset()
    model = untrained(tmp_path / "gcn", SelectionTraining(), dataset)
    with pytest.raises(JengaError, match="wanted: dynamics"):
        evaluate_selection(model, dynamics_dataset())
    dataset.splits = np.where(dataset.splits == "test", "train", dataset.splits)
    with pytest.raises(JengaError, match="90 train and validation rows and 0 test rows"):
        evaluate_selection(model, dataset)
