"""How well anyone can predict the outcome of a pull: the same pull is made again with other noise.

If pull i fails with probability p_i, nobody who knows the tower alone is right more often than in
c = mean(max(p_i, 1 - p_i)) of the cases. Two pulls agree with probability a = mean(p_i^2 + (1 - p_i)^2), and
a <= c <= (1 + sqrt(2 a - 1)) / 2; the left bound is reached where every p_i is 0, 1/2 or 1, the right one where they
are all alike (Jensen).
"""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from jenga_data.calibrate.trial import described, judged_pull, tower_and_targets
from jenga_data.collect.config import SelectionConfig
from jenga_data.statistics import Interval, ratio_bootstrap


def repeated_pulls(config: SelectionConfig, seed: int, number: int, targets: int, repeats: int) -> dict[str, Any]:
    """Pull `targets` random legal targets of one tower, each `repeats` times from the same state with other noise."""
    _, stages = tower_and_targets(config, seed, number, targets)
    return {
        "pulls": [
            described(stage) | {"repeats": [judged_pull(config, stage, seed, repeat) for repeat in range(repeats)]}
            for stage in stages
        ]
    }


def accuracy_bounds(agreement: float) -> tuple[float, float]:
    """Between what the accuracy of the best predictor lies, given how often two pulls agree."""
    return agreement, (1 + float(np.sqrt(max(0.0, 2 * agreement - 1)))) / 2


def agreement(failure: Bool[np.ndarray, "pull repeat"]) -> Float[np.ndarray, " pull"]:
    """For each pull the share of all pairs of repeats that agree: unbiased for p^2 + (1 - p)^2."""
    repeats = failure.shape[1]
    failed = failure.sum(1)
    pairs = failed * (failed - 1) + (repeats - failed) * (repeats - failed - 1)
    return pairs / (repeats * (repeats - 1))


def best_accuracy(failure: Bool[np.ndarray, "pull repeat"]) -> tuple[Float[np.ndarray, " pull"], ...]:
    """For each pull two estimates of max(p, 1 - p) that bracket it in expectation.

    The lower one says of each repeat what most of the others say (a tie is worth a half): a predictor that has seen
    that many pulls. The upper one is max(p', 1 - p') with p' the share that failed, which fits its own noise.
    """
    repeats = failure.shape[1]
    failed = failure.sum(1, keepdims=True)
    others = failed - failure
    vote = np.sign(2 * others - (repeats - 1))
    right = np.where(vote == 0, 0.5, (vote > 0) == failure)
    share = failed[:, 0] / repeats
    return right.mean(1), np.maximum(share, 1 - share)


def mean_over_towers(values: Float[np.ndarray, " pull"], tower: np.ndarray) -> tuple[float, Interval | None]:
    """A mean with its 95 % interval over towers."""
    return float(values.mean()), ratio_bootstrap(values, np.ones(len(values)), tower)
