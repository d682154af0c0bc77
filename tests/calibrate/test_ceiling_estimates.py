"""What repeated pulls say of the best accuracy, against counting and against pulls of known probabilities."""

from itertools import combinations, product
from math import comb

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jenga_data.calibrate.ceiling import accuracy_bounds, agreement, best_accuracy, mean_over_towers

PROBABILITIES = np.linspace(0.0, 1.0, 21)


def every(repeats: int) -> np.ndarray:
    """Every way in which a pull can be repeated."""
    return np.array(list(product([False, True], repeat=repeats)))


def expected(values: np.ndarray, repeats: int, probability: float) -> float:
    """The mean of what is estimated from each of `every(repeats)`, where each repeat fails with `probability`."""
    failed = every(repeats).sum(1)
    return float(values @ (probability**failed * (1 - probability) ** (repeats - failed)))


def leave_one_out(failure: np.ndarray) -> float:
    """How often most of the others are right, one repeat at a time."""
    right = []
    for i, own in enumerate(failure):
        others = np.delete(failure, i)
        yes, no = int(others.sum()), int((~others).sum())
        right.append(0.5 if yes == no else float((yes > no) == own))
    return float(np.mean(right))


@pytest.mark.parametrize("repeats", [2, 3, 5, 8])
def test_against_counting(repeats: int):
    failure = every(repeats)
    pairs = [[row[i] == row[j] for i, j in combinations(range(repeats), 2)] for row in failure]
    np.testing.assert_allclose(agreement(failure), np.mean(pairs, axis=1))
    low, high = best_accuracy(failure)
    np.testing.assert_allclose(low, [leave_one_out(row) for row in failure])
    np.testing.assert_allclose(high, [max(row.mean(), 1 - row.mean()) for row in failure])


@pytest.mark.parametrize("repeats", [2, 3, 10])
def test_agreement_is_unbiased(repeats: int):
    found = [expected(agreement(every(repeats)), repeats, p) for p in PROBABILITIES]
    np.testing.assert_allclose(found, PROBABILITIES**2 + (1 - PROBABILITIES) ** 2)


@pytest.mark.parametrize("repeats", [2, 3, 4, 10])
def test_in_expectation_the_two_estimates_bracket_the_best_accuracy(repeats: int):
    low, high = best_accuracy(every(repeats))
    best = np.maximum(PROBABILITIES, 1 - PROBABILITIES)
    lower = np.array([expected(low, repeats, p) for p in PROBABILITIES])
    upper = np.array([expected(high, repeats, p) for p in PROBABILITIES])
    assert (lower <= best + 1e-12).all()
    assert (upper >= best - 1e-12).all()
    np.testing.assert_allclose([lower[0], lower[-1], upper[0], upper[-1]], 1.0)


def test_more_repeats_narrow_the_bracket():
    widths = []
    for repeats in (3, 5, 9):
        low, high = best_accuracy(every(repeats))
        widths.append(np.mean([expected(high - low, repeats, p) for p in PROBABILITIES]))
    assert widths == sorted(widths, reverse=True)
    assert widths[-1] < 0.6 * widths[0]


def test_a_tower_full_of_pulls_whose_probabilities_are_known():
    """100,000 pulls with probabilities as a tower's are: most all but certain, some not."""
    rng = np.random.default_rng(0)
    probability = rng.beta(0.3, 0.4, 100_000)
    failure = rng.random((len(probability), 10)) < probability[:, None]
    best = np.maximum(probability, 1 - probability).mean()
    low, high = (values.mean() for values in best_accuracy(failure))
    assert low < best < high
    assert high - low < 0.06
    agree = agreement(failure).mean()
    assert agree == pytest.approx((probability**2 + (1 - probability) ** 2).mean(), abs=0.003)
    below, above = accuracy_bounds(float(agree))
    assert below < low
    assert above > high


@given(st.lists(st.floats(0, 1), min_size=1, max_size=30))
def test_the_bounds_hold_for_all_probabilities(probability: list[float]):
    p = np.array(probability)
    low, high = accuracy_bounds(float((p**2 + (1 - p) ** 2).mean()))
    assert low - 1e-12 <= np.maximum(p, 1 - p).mean() <= high + 1e-12


@pytest.mark.parametrize("p", [0.0, 0.2, 0.5, 0.9])
def test_where_the_bounds_are_reached(p: float):
    """The lower one where pulls are certain or a toss of a coin, the upper one where all are alike."""
    assert accuracy_bounds(p**2 + (1 - p) ** 2)[1] == pytest.approx(max(p, 1 - p))
    coins = 0.5 * p + 1.0 * (1 - p)  # a part p of the pulls tosses a coin, the rest is certain
    assert accuracy_bounds(coins)[0] == pytest.approx(coins)


def test_pulls_that_agree_less_than_by_chance_can_be_told_no_better_than_by_chance():
    assert accuracy_bounds(0.3)[1] == 0.5


def test_all_repeats_alike_leave_no_doubt():
    failure = np.repeat([[False], [True]], 7, axis=1)
    np.testing.assert_array_equal(agreement(failure), 1.0)
    np.testing.assert_array_equal(best_accuracy(failure), 1.0)


def test_a_mean_has_an_interval_over_towers_and_none_of_a_single_one():
    values, tower = np.arange(8) / 8, np.array(["a", "a", "b", "b", "c", "c", "d", "d"])
    mean, interval = mean_over_towers(values, tower)
    assert mean == pytest.approx(values.mean())
    assert interval is not None
    assert interval[0] < mean < interval[1]
    assert mean_over_towers(values, np.repeat("a", 8))[1] is None


def test_every_way_to_repeat_has_its_probability():
    """The enumeration that the tests above stand on."""
    for p in (0.1, 0.5):
        assert expected(np.ones(2**4), 4, p) == pytest.approx(1)
        ones = (every(4).sum(1) == 1).astype(float)
        assert expected(ones, 4, p) == pytest.approx(comb(4, 1) * p * (1 - p) ** 3)
