"""`jenga report selection`: seeds share a row, tests are fair, and what is drawn and listed is what was predicted."""

import json

import numpy as np
import pytest
from made_up_dataset import selection_dataset, untrained

from jenga_control.selection.baselines import suite
from jenga_control.selection.baselines.suite import Side
from jenga_control.selection.curve import baseline_curve, subsets
from jenga_control.selection.mistakes import worst_mistakes
from jenga_control.selection.models import families
from jenga_control.selection.pulls import Prediction
from jenga_control.selection.report import (
    best_of,
    information_of,
    largest,
    poses,
    report_selection,
    told_no_more,
    verdict,
)
from jenga_control.selection.scores import more_often_right
from jenga_control.selection.towers import shown_towers, state_of
from jenga_data.errors import JengaError
from jenga_models import checkpoint as checkpoints
from jenga_models.config import SelectionTraining


@pytest.fixture
def dataset(tmp_path):
    made = selection_dataset(18)
    made.folder = tmp_path / "data"
    return made


@pytest.fixture
def test(dataset):
    return Side.of([(dataset, dataset.rows("test"))])


def said(name, information, probability):
    return Prediction(name, information, np.asarray(probability, float), {})


def seeds(tmp_path, dataset, **changes):
    return [
        untrained(tmp_path / f"{changes.get('graph', 'G_s')}-{seed}", SelectionTraining(seed=seed, **changes), dataset)
        for seed in (0, 1)
    ]


def test_seeds_of_one_configuration_are_one_row_and_their_ensemble_the_mean(tmp_path, dataset, test):
    paths = [*seeds(tmp_path, dataset), *seeds(tmp_path, dataset, graph="G_sp")]
    rows = dataset.rows("test")
    found, notes = families(paths, dataset, rows)
    assert notes == []
    assert [(family.name, len(family.members)) for family in found] == [("G_s", 2), ("G_sp", 2)]
    np.testing.assert_allclose(found[0].prediction.probability, (found[0].each[0] + found[0].each[1]) / 2)
    assert not np.allclose(found[0].each[0], found[0].each[1])
    accuracy = ((found[0].each >= 0.5) == test.pulls.failure).mean(axis=1)
    spread = found[0].spread(test.pulls)
    assert spread["accuracies"] == accuracy.tolist()
    assert spread["std"] == pytest.approx(np.abs(accuracy[0] - accuracy[1]) / np.sqrt(2))
    with pytest.raises(JengaError, match="named twice"):
        families([paths[0], paths[0]], dataset, rows)


def test_families_that_saw_fewer_rows_are_points_of_one_curve(tmp_path, dataset, monkeypatch):
    real = checkpoints.load

    def load(path):
        model = real(path)
        model.metrics["training_rows"] = {"G_s-0": 40.0, "G_s-1": 20.0}[model.name]
        return model

    monkeypatch.setattr("jenga_models.predict.load", load)
    found, _ = families(seeds(tmp_path, dataset), dataset, dataset.rows("test"))
    assert [family.size for family in found] == [{"training_rows": 40}, {"training_rows": 20}]
    assert len({family.recipe for family in found}) == 1
    assert [family.name for family in largest(found)] == ["G_s-0"]
    assert [family.name for family in largest(found[::-1])] == ["G_s-0"]


def test_paired_tests_are_symmetric(test):
    one = test.pulls.failure.copy()
    one[0] = ~one[0]
    two = np.random.default_rng(0).random(len(one)) > 0.5
    there, back = more_often_right(one, two, test.pulls), more_often_right(two, one, test.pulls)
    assert there["difference"] == -back["difference"] != 0
    assert there["p_value"] == back["p_value"]
    assert there["ci95"] == pytest.approx([-back["ci95"][1], -back["ci95"][0]])


def test_a_model_is_compared_with_the_best_that_was_told_no_more(test):
    n, right = len(test.pulls), test.pulls.failure.astype(float)
    close = right.copy()
    close[0] = 1 - close[0]
    found = [said("majority", "none", np.ones(n)), said("a", "G_s", close), said("b", "G_sp", right)]
    assert best_of(found, "G_s", test).name == "a"
    assert best_of(found, "G_s+layout", test).name == "a"
    assert best_of(found, "G_sp", test).name == "b"
    assert told_no_more("G_s") == ("none", "G_s")
    assert information_of("G_e") == "G_sp"


def test_the_sentence_about_poses_says_what_the_numbers_say(test):
    right = test.pulls.failure.astype(float)
    known = [said("with", "G_sp", right), said("without", "G_s", 1 - right)]
    (entry,) = poses(known, [("with", "without")], test)
    assert entry["difference"] == 1
    assert entry["sentence"].startswith("Poses help: with against without +100.0 [+100.0, +100.0] points")
    (entry,) = poses(known[::-1], [("without", "with")], test)
    assert entry["sentence"].startswith("Poses hurt")
    nothing = {"difference": 0.01, "p_value": 0.4, "ci95": [-0.01, 0.03], "n": 400}
    assert verdict("a", "b", nothing) == (
        "Poses make no difference that these pulls can show: a against b +1.0 [-1.0, +3.0] points, p = 0.40, n = 400."
    )


def test_subsets_are_whole_towers():
    tower = np.repeat([f"t{i}" for i in range(20)], 3)
    found = subsets(tower, sizes=(5, 10, 40), draws=2)
    assert [size for size, _ in found] == [5, 5, 10, 10, 20]
    for size, rows in found:
        assert len(np.unique(tower[rows])) == size
        assert len(rows) == 3 * size
    assert set(found[0][1]) != set(found[1][1])


def test_a_curve_ends_where_all_towers_are_known(dataset, test):
    train = Side.of([(dataset, dataset.rows("train+validation"))])
    baseline = next(b for b in suite.LEARNED if b.name == "logistic_layout")
    points = baseline_curve(baseline, {"logisticregression__C": 1.0}, train, test, sizes=(6,))
    assert [(p["towers"], p["rows"], p["n"]) for p in points] == [(6, 18, 3), (12, 36, 1)]
    assert all(0 <= p["accuracy"] <= 1 for p in points)


def test_mistakes_are_wrong_and_the_most_confident_first(tmp_path, dataset, test):
    rows = dataset.rows("test")
    (family,), _ = families(seeds(tmp_path, dataset), dataset, rows)
    found = worst_mistakes(dataset, rows, family, test, count=5)
    failure = dataset.column("failure")
    for entry in found:
        assert (entry["probability"] >= 0.5) != failure[entry["row"]]
        assert entry["replay"].startswith(f"jenga replay LOGS/{dataset.column('episode')[entry['row']]}.mcap --model ")
        assert entry["trace"].endswith(f" {entry['row']}")
    wrong_by = [abs(entry["probability"] - failure[entry["row"]]) for entry in found]
    assert wrong_by == sorted(wrong_by, reverse=True)
    assert len(found) == min(5, ((family.prediction.said) != test.pulls.failure).sum())


def test_shown_towers_are_test_towers_that_stand_as_in_their_rows(dataset):
    rows = dataset.rows("test")
    shown = shown_towers(dataset, rows)
    assert len(set(shown)) == 4
    assert set(shown) <= set(dataset.column("tower")[rows])
    state = state_of(dataset, int(rows[0]))
    np.testing.assert_array_equal(state.layout.slot, dataset.column("slot")[rows[0]])
    assert state.layout.round == dataset.column("round")[rows[0]]


def test_the_whole_report(tmp_path, dataset, monkeypatch):
    few = [b for b in suite.LEARNED if b.name in ("logistic_layout", "mechanics_logistic", "mechanics_poses_logistic")]
    monkeypatch.setattr(suite, "LEARNED", few)
    monkeypatch.setattr("jenga_control.selection.report.LEARNED", few)
    ceiling = tmp_path / "ceiling.json"
    agreement = {"rate": 0.9, "n": 50, "ci95": [0.8, 0.95]}
    ceiling.write_text(json.dumps({"agreement": agreement, "accuracy_bounds": [0.9, 0.95]}))
    models = [*seeds(tmp_path, dataset), untrained(tmp_path / "poses", SelectionTraining(graph="G_sp"), dataset)]
    found = report_selection(models, dataset, tmp_path / "out", ceiling=ceiling)
    written = json.loads((tmp_path / "out" / "selection.json").read_text())
    assert written == {key: value for key, value in found.items() if key not in ("written", "text")}
    assert [row["information"] for row in written["rows"].values()].count("G_sp") == 2
    assert written["rows"]["G_s"]["seeds"]["n"] == 2
    assert written["rows"]["G_s"]["best_baseline"] in ("majority", "loosest_first")
    assert {entry["with"] for entry in written["poses"]} == {"poses", "mechanics_poses_logistic"}
    assert len(written["pairs"]) == 1
    curves = set(written["learning_curve"])
    assert curves - {"logistic_layout", "mechanics_logistic"} == {"mechanics_poses_logistic", "G_s", "poses"}
    assert len(curves) == 4  # of the two baselines that were told as much, the better one
    text = (tmp_path / "out" / "selection.md").read_text()
    for name in written["rows"]:
        assert f"| {name} |" in text or f"| **{name}** |" in text
    assert "between 0.900 and 0.950" in text
    for name in ("table", "reliability", "rounds", "curve", "towers"):
        assert (tmp_path / "out" / f"selection-{name}.png").read_bytes().startswith(b"\x89PNG")
        assert f"(selection-{name}.png)" in text


def test_a_report_of_baselines_alone(tmp_path, dataset):
    found = report_selection([], dataset, tmp_path, baselines="none")
    assert list(found["rows"]) == ["majority", "loosest_first", "middle_first"]
    assert found["best"] is None
    assert found["mistakes"] == found["pairs"] == found["poses"] == []
    assert "not measured" in found["text"]
    assert not (tmp_path / "selection-towers.png").exists()
