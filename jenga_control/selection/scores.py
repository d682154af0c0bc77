"""How right one predictor of failures is, and how it compares with another on the same pulls."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Shaped

from jenga_control.selection.pulls import THRESHOLD, Pulls
from jenga_data.statistics import (
    auroc,
    brier,
    expected_calibration_error,
    paired_difference,
    proportion_over_towers,
    ratio_bootstrap,
    tower_bootstrap,
)


def scores(probability: Float[np.ndarray, " row"], test: Pulls) -> dict[str, Any]:
    """The scores of predicted probabilities of failure, with the paper's label.

    Intervals named `ci95_towers` and those of auroc and brier resample towers; ece has none, as drawing rows twice
    inflates it. What is undefined, such as an AUROC of one class, is None.
    """
    right = (probability >= THRESHOLD) == test.failure
    squares = (probability - test.failure) ** 2
    intervals = {
        "auroc": tower_bootstrap(lambda r: auroc(probability[r], test.failure[r]), test.tower),
        "brier": ratio_bootstrap(squares, np.ones(len(test)), test.tower),
    }
    values = {"auroc": auroc(probability, test.failure), "brier": brier(probability, test.failure)}
    return {
        "accuracy": proportion_over_towers(right, test.tower),
        **{name: value if np.isfinite(value) else None for name, value in values.items()},
        **{f"{name}_ci95": None if ci is None else list(ci) for name, ci in intervals.items()},
        "ece": expected_calibration_error(probability, test.failure),
    }


def grouped_scores(probability: Float[np.ndarray, " row"], test: Pulls) -> dict[str, Any]:
    """Accuracy by round, slot and outcome, and which mistakes were made."""
    said = probability >= THRESHOLD
    right, failure = said == test.failure, test.failure

    def groups(label: Shaped[np.ndarray, " row"]) -> dict[str, Any]:
        return {
            str(value): {
                "accuracy": proportion_over_towers(right[label == value], test.tower[label == value]),
                "failures": proportion_over_towers(failure[label == value], test.tower[label == value]),
            }
            for value in np.unique(label)
        }

    return {
        "confusion": {
            "failure_predicted_failure": int((failure & said).sum()),
            "failure_predicted_success": int((failure & ~said).sum()),
            "success_predicted_failure": int((~failure & said).sum()),
            "success_predicted_success": int((~failure & ~said).sum()),
        },
        "by_round": groups(test.round),
        "by_slot": groups(test.slot),
        "by_outcome": groups(test.outcome),
    }


def more_often_right(first: Bool[np.ndarray, " row"], second: Bool[np.ndarray, " row"], test: Pulls) -> dict[str, Any]:
    """By how much the first of two predictors that said so is right more often (`statistics.paired_difference`)."""
    return paired_difference(first == test.failure, second == test.failure, test.tower)
