"""Rates with their intervals, scores of probabilities, and comparisons: every number that a table shows.

All functions are array to array; `failure` is the observed label f (paper, section II-B), `probability` the
predicted probability of f = 1. Rows of one tower share its blocks and are not independent, so intervals are drawn
by resampling whole towers (cluster bootstrap, percentile interval).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy import stats

RESAMPLES = 2000
"""Towers drawn anew so many times: the ends of a 95 % interval then repeat to about a twentieth of its width."""
BINS = 15
"""Bins of the calibration error."""

Interval = tuple[float, float]


@dataclass(frozen=True)
class Proportion:
    """A rate of `n` trials with its 95 % Wilson interval; `rate` is None where nothing was tried."""

    rate: float | None
    n: int
    ci95: Interval

    @classmethod
    def of(cls, hits: Bool[np.ndarray, " trial"]) -> "Proportion":
        """The share of true entries."""
        n = len(hits)
        if n == 0:
            return cls(None, 0, (0.0, 1.0))
        test = stats.binomtest(int(hits.sum()), n)
        low, high = test.proportion_ci(0.95, method="wilson")
        return cls(float(test.statistic), n, (float(low), float(high)))

    def as_dict(self) -> dict[str, Any]:
        """The form that every proportion has in JSON."""
        return {"rate": self.rate, "n": self.n, "ci95": list(self.ci95)}


def tower_bootstrap(
    statistic: Callable[[Int[np.ndarray, " row"]], float],
    tower: Shaped[np.ndarray, " row"],
    seed: int = 0,
    resamples: int = RESAMPLES,
) -> Interval | None:
    """95 % interval of any statistic, which is given the rows of the drawn towers, a row once for each draw.

    Draws for which the statistic is NaN (an AUROC of one class) are left out. None where there are fewer than two
    towers, or no draw counts.
    """
    _, group = np.unique(tower, return_inverse=True)
    rows = np.split(np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))[:-1])
    draws = _draws(len(rows), seed, resamples)
    return _percentiles(np.array([statistic(np.concatenate([rows[t] for t in drawn])) for drawn in draws]))


def ratio_bootstrap(
    numerator: Float[np.ndarray, " row"],
    denominator: Float[np.ndarray, " row"],
    tower: Shaped[np.ndarray, " row"],
    seed: int = 0,
    resamples: int = RESAMPLES,
) -> Interval | None:
    """95 % interval of sum(numerator) / sum(denominator), as `tower_bootstrap` but all draws at once.

    A mean has a denominator of ones; a skill is 1 minus a ratio of squared errors.
    """
    _, group = np.unique(tower, return_inverse=True)
    above = np.bincount(group, weights=numerator)
    below = np.bincount(group, weights=denominator)

    draws = _draws(len(above), seed, resamples)
    with np.errstate(divide="ignore", invalid="ignore"):
        return _percentiles(above[draws].sum(1) / below[draws].sum(1))


def _draws(towers: int, seed: int, resamples: int) -> Int[np.ndarray, "resample tower"]:
    """As many towers as there are, drawn with replacement; no draws of fewer than two, which cannot vary."""
    return np.random.default_rng(seed).integers(0, max(towers, 1), (resamples if towers > 1 else 0, towers))


def _percentiles(values: Float[np.ndarray, " resample"]) -> Interval | None:
    # scipy.stats.bootstrap would draw the same, but refuses statistics that are undefined in some draws.
    values = values[np.isfinite(values)]
    if len(values) == 0:
        return None
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)


def proportion_over_towers(hits: Bool[np.ndarray, " row"], tower: Shaped[np.ndarray, " row"]) -> dict[str, Any]:
    """A proportion in its JSON form, with the interval over towers and their number beside the Wilson interval."""
    interval = ratio_bootstrap(hits.astype(float), np.ones(len(hits)), tower)
    return {
        **Proportion.of(hits).as_dict(),
        "ci95_towers": None if interval is None else list(interval),
        "towers": len(np.unique(tower)),
    }


def paired_difference(
    first: Bool[np.ndarray, " row"], second: Bool[np.ndarray, " row"], tower: Shaped[np.ndarray, " row"]
) -> dict[str, Any]:
    """How much more often `first` is true than `second` on the same rows.

    `p_value` is McNemar's exact test, a two-sided binomial test of the rows on which the two differ; it takes rows
    as independent, while `ci95` resamples towers.
    """
    only_first, only_second = int((first & ~second).sum()), int((second & ~first).sum())
    differing = only_first + only_second
    difference = first.astype(float) - second.astype(float)
    interval = ratio_bootstrap(difference, np.ones(len(first)), tower)
    return {
        "difference": float(difference.mean()) if len(first) else None,
        "n": len(first),
        "ci95": None if interval is None else list(interval),
        "p_value": float(stats.binomtest(only_first, differing).pvalue) if differing else 1.0,
        "only_first": only_first,
        "only_second": only_second,
    }


def auroc(probability: Float[np.ndarray, " row"], failure: Bool[np.ndarray, " row"]) -> float:
    """Probability that a failure gets a higher score than a success, ties counted half; NaN with one class only.

    It is the Mann-Whitney statistic over the number of pairs, from ranks.
    """
    positives = int(failure.sum())
    pairs = positives * (len(failure) - positives)
    if pairs == 0:
        return float("nan")
    ranks = np.asarray(stats.rankdata(probability))
    return float((ranks[failure].sum() - positives * (positives + 1) / 2) / pairs)


def brier(probability: Float[np.ndarray, " row"], failure: Bool[np.ndarray, " row"]) -> float:
    """Mean squared difference between probability and label; 0.25 for a predictor that always says 0.5."""
    return float(np.mean((probability - failure) ** 2)) if len(failure) else float("nan")


def expected_calibration_error(
    probability: Float[np.ndarray, " row"], failure: Bool[np.ndarray, " row"], bins: int = BINS
) -> float:
    """Mean over rows of |mean probability - share of failures| of the row's bin; bins of equal width on [0, 1].

    Binned by the probability of failure rather than by the confidence in the likelier class, so that errors on the
    two sides of 0.5 cannot cancel.
    """
    if len(failure) == 0:
        return float("nan")
    at = np.minimum((probability * bins).astype(int), bins - 1)
    excess = np.bincount(at, weights=probability - failure, minlength=bins)
    return float(np.abs(excess).sum() / len(failure))


def spearman(first: Float[np.ndarray, " row"], second: Float[np.ndarray, " row"]) -> float:
    """Rank correlation; NaN where one side is constant or there are fewer than two rows."""
    if len(first) < 2 or np.ptp(first) == 0 or np.ptp(second) == 0:
        return float("nan")
    return float(np.corrcoef(stats.rankdata(first), stats.rankdata(second))[0, 1])
