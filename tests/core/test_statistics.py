import json

import numpy as np
import pytest

from jenga_data.statistics import (
    Proportion,
    auroc,
    brier,
    expected_calibration_error,
    paired_difference,
    proportion_over_towers,
    ratio_bootstrap,
    spearman,
    tower_bootstrap,
)


def test_wilson_interval_as_published():
    # Newcombe 1998, Statistics in Medicine 17, 857-872, table I: 15 of 148, score method without correction.
    hits = np.arange(148) < 15
    proportion = Proportion.of(hits)
    np.testing.assert_allclose(proportion.ci95, (0.0624, 0.1605), atol=5e-5)
    assert proportion.rate == 15 / 148
    assert json.loads(json.dumps(proportion.as_dict())) == {
        "rate": proportion.rate,
        "n": 148,
        "ci95": list(proportion.ci95),
    }


def test_a_rate_of_nothing_is_unknown():
    assert Proportion.of(np.zeros(0, bool)).as_dict() == {"rate": None, "n": 0, "ci95": [0.0, 1.0]}


def test_intervals_over_towers_cover_the_truth_where_rows_of_a_tower_agree():
    rng = np.random.default_rng(0)
    towers, rows = 60, 5
    tower = np.repeat(np.arange(towers), rows)
    covered, covered_as_if_independent = 0, 0
    for trial in range(100):
        hits = np.repeat(rng.random(towers) < 0.6, rows)
        interval = ratio_bootstrap(hits.astype(float), np.ones(len(hits)), tower, seed=trial, resamples=400)
        assert interval is not None
        covered += interval[0] <= 0.6 <= interval[1]
        low, high = Proportion.of(hits).ci95
        covered_as_if_independent += low <= 0.6 <= high
    assert 88 <= covered <= 99
    assert covered_as_if_independent < 80


def test_both_bootstraps_agree_on_a_mean_whatever_the_order_of_rows():
    rng = np.random.default_rng(1)
    tower = np.array([f"tower {i}" for i in rng.integers(0, 40, 200)])
    value = rng.normal(3, 1, 200)
    general = tower_bootstrap(lambda rows: float(value[rows].mean()), tower, seed=2, resamples=500)
    assert general == pytest.approx(ratio_bootstrap(value, np.ones(200), tower, seed=2, resamples=500))


def test_same_seed_same_interval():
    value, tower = np.random.default_rng(2).normal(size=50), np.arange(50) // 2
    first, again, other = (ratio_bootstrap(value, np.ones(50), tower, seed=s) for s in (1, 1, 2))
    assert first == again != other


def test_one_tower_has_no_interval():
    assert ratio_bootstrap(np.ones(3), np.ones(3), np.zeros(3)) is None
    assert tower_bootstrap(lambda rows: 1.0, np.zeros(3)) is None
    assert proportion_over_towers(np.ones(3, bool), np.zeros(3))["ci95_towers"] is None


def test_draws_without_a_value_are_left_out():
    failure = np.array([True, False, False])
    probability = np.array([0.9, 0.2, 0.1])
    interval = tower_bootstrap(lambda rows: auroc(probability[rows], failure[rows]), np.arange(3))
    assert interval == (1.0, 1.0)
    assert tower_bootstrap(lambda rows: float("nan"), np.arange(3)) is None


def test_paired_difference_is_mcnemars_exact_test():
    # 10 rows right only with the first, 2 only with the second: p = 2 * P(X <= 2), X ~ B(12, 1/2).
    first = np.array([True] * 10 + [False] * 2 + [True] * 8)
    second = np.array([False] * 10 + [True] * 2 + [True] * 8)
    found = paired_difference(first, second, np.arange(20))
    assert found["difference"] == pytest.approx(8 / 20)
    assert found["p_value"] == pytest.approx(2 * (1 + 12 + 66) / 2**12)
    low, high = found["ci95"]
    assert 0 < low < 0.4 < high


def test_paired_difference_of_a_model_and_itself():
    same = np.array([True, False, True, True])
    found = paired_difference(same, same, np.arange(4))
    assert (found["difference"], found["p_value"], found["ci95"]) == (0.0, 1.0, [0.0, 0.0])


def test_auroc_counts_pairs():
    rng = np.random.default_rng(3)
    probability, failure = rng.integers(0, 6, 80) / 5, rng.random(80) < 0.4
    pairs = probability[failure][:, None] - probability[~failure]
    assert auroc(probability, failure) == pytest.approx(np.mean((pairs > 0) + 0.5 * (pairs == 0)))
    assert auroc(probability**3, failure) == pytest.approx(auroc(probability, failure))
    assert auroc(-probability, failure) == pytest.approx(1 - auroc(probability, failure))
    assert np.isnan(auroc(probability, np.ones(80, bool)))


def test_brier_score_of_known_predictors():
    failure = np.array([True, False, True, False])
    assert brier(failure.astype(float), failure) == 0
    assert brier(np.full(4, 0.5), failure) == 0.25


def test_calibration_error_of_a_calibrated_and_an_overconfident_predictor():
    rng = np.random.default_rng(4)
    truth = rng.random(50_000)
    failure = rng.random(50_000) < truth
    assert expected_calibration_error(truth, failure) < 0.01
    # Says 0.95 or 0.05 and is right in 80 % of cases.
    failure = rng.random(50_000) < 0.5
    right = rng.random(50_000) < 0.8
    says = np.where(failure == right, 0.95, 0.05)
    assert expected_calibration_error(says, failure) == pytest.approx(0.15, abs=0.01)


def test_certainty_belongs_to_the_last_bin():
    assert expected_calibration_error(np.array([1.0, 0.0]), np.array([True, False])) == 0
    assert expected_calibration_error(np.array([1.0, 0.96]), np.array([False, True])) == pytest.approx(0.96 / 2)


def test_spearman_sees_order_only():
    values = np.random.default_rng(5).random(30)
    assert spearman(values, np.exp(values)) == pytest.approx(1)
    assert spearman(values, -values) == pytest.approx(-1)
    assert np.isnan(spearman(values, np.ones(30)))
