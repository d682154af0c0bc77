"""How well a selector predicts failures on held-out towers: the paper's table I, with intervals and baselines."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from jenga_data.errors import JengaError
from jenga_data.statistics import (
    auroc,
    brier,
    expected_calibration_error,
    paired_difference,
    proportion_over_towers,
    tower_bootstrap,
)
from jenga_data.tower import CENTRE
from jenga_models.checkpoint import Checkpoint, check_dataset
from jenga_models.columns import Rows, dataset_name
from jenga_models.metrics import predict_selection
from jenga_models.predict import opened

THRESHOLD = 0.5
"""Predicted to fail from this probability on."""


@dataclass(frozen=True, eq=False)
class Pulls:
    """What became of some pulls, one row each; `slot` is the target's."""

    failure: Bool[np.ndarray, " row"]
    strict_failure: Bool[np.ndarray, " row"]
    outcome: Shaped[np.ndarray, " row"]
    round: Int[np.ndarray, " row"]
    slot: Int[np.ndarray, " row"]
    tower: Shaped[np.ndarray, " row"]

    def __len__(self) -> int:
        return len(self.failure)

    @classmethod
    def of_dataset(cls, dataset: Rows, rows: Int[np.ndarray, " row"]) -> "Pulls":
        """The given rows of a selection dataset, and no others."""
        target = dataset.column("target")[rows]
        return cls(
            slot=np.take_along_axis(dataset.column("slot")[rows], target[:, None].astype(int), axis=1)[:, 0],
            **{name: dataset.column(name)[rows] for name in ("failure", "strict_failure", "outcome", "round", "tower")},
        )


def baseline_predictions(train: Pulls, test: Pulls) -> dict[str, Bool[np.ndarray, " row"]]:
    """What the trivial predictors say of `test`, each fitted to the labels of `train` alone.

    `majority` says the more frequent label. `rule` is middle first: a pull fails unless its target is the centre
    block, or the other way round, whichever is right more often on `train`.
    """
    centre = train.slot == CENTRE
    fails_in_the_centre = (centre == train.failure).mean() > 0.5
    return {
        "majority": np.full(len(test), train.failure.mean() >= 0.5),
        "rule": (test.slot == CENTRE) == fails_in_the_centre,
    }


def selection_report(probability: Float[np.ndarray, " row"], test: Pulls, train: Pulls) -> dict[str, Any]:
    """Score `probability`, the predicted probability that a pull fails, on `test`; `train` fits the baselines.

    Everything but the rates of `strict` is about the paper's label. Intervals named `ci95_towers` and those of
    auroc and brier resample towers; ece has none, as drawing rows twice inflates it.
    """
    said = probability >= THRESHOLD
    right = said == test.failure
    baselines = {name: said == test.failure for name, said in baseline_predictions(train, test).items()}

    def score(metric: Any) -> tuple[float | None, list[float] | None]:
        value = metric(probability, test.failure)
        interval = tower_bootstrap(lambda r: metric(probability[r], test.failure[r]), test.tower)
        return (float(value) if np.isfinite(value) else None), (None if interval is None else list(interval))

    def groups(label: np.ndarray) -> dict[str, Any]:
        return {
            str(value): {
                "accuracy": proportion_over_towers(right[label == value], test.tower[label == value]),
                "failures": proportion_over_towers(test.failure[label == value], test.tower[label == value]),
            }
            for value in np.unique(label)
        }

    scores = {"auroc": score(auroc), "brier": score(brier)}
    return {
        "n": len(test),
        "accuracy": proportion_over_towers(right, test.tower),
        **{name: value for name, (value, _) in scores.items()},
        **{f"{name}_ci95": interval for name, (_, interval) in scores.items()},
        "ece": expected_calibration_error(probability, test.failure),
        "majority": proportion_over_towers(baselines["majority"], test.tower),
        "ceiling": None,
        "ceiling_reason": "not measured: the agreement of repeated pulls comes from `jenga calibrate ceiling`",
        "baselines": {
            name: {
                "accuracy": proportion_over_towers(hits, test.tower),
                "model_minus_baseline": paired_difference(right, hits, test.tower),
            }
            for name, hits in baselines.items()
        },
        "failures": proportion_over_towers(test.failure, test.tower),
        "strict": {
            "accuracy": proportion_over_towers(said == test.strict_failure, test.tower),
            "failures": proportion_over_towers(test.strict_failure, test.tower),
        },
        "confusion": {
            "failure_predicted_failure": int((test.failure & said).sum()),
            "failure_predicted_success": int((test.failure & ~said).sum()),
            "success_predicted_failure": int((~test.failure & said).sum()),
            "success_predicted_success": int((~test.failure & ~said).sum()),
        },
        "by_round": groups(test.round),
        "by_slot": groups(test.slot),
        "by_outcome": groups(test.outcome),
    }


def evaluate_selection(checkpoint: Checkpoint | Path | str, dataset: Rows) -> dict[str, Any]:
    """Score a selector on the test split of a dataset of pulls; the train split only fits the baselines.

    Raises:
        JengaError: a split has no rows, or the checkpoint or the dataset is of another kind.
    """
    model = opened(checkpoint, "selection")
    note = check_dataset(model, dataset)
    train, test = dataset.rows("train"), dataset.rows("test")
    if not (len(train) and len(test)):
        raise JengaError(
            f"{dataset_name(dataset)} has {len(train)} train and {len(test)} test rows; it needs both: "
            "collect more towers and convert them together"
        )
    probability = predict_selection(model, dataset, test)
    return {
        "model": model.name,
        "model_hash": model.hash,
        "dataset": dataset_name(dataset),
        "dataset_hash": dataset.hash,
        "note": note,
        **selection_report(probability, Pulls.of_dataset(dataset, test), Pulls.of_dataset(dataset, train)),
    }
