"""How well a selector predicts failures on held-out towers: the paper's table I, with intervals and baselines."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float

from jenga_control.selection.baselines.features import Part
from jenga_control.selection.baselines.suite import Side, Which, predict_baselines
from jenga_control.selection.pulls import THRESHOLD, Prediction, Pulls, first_pulls
from jenga_control.selection.scores import grouped_scores, more_often_right, scores
from jenga_data.errors import JengaError
from jenga_data.statistics import proportion_over_towers
from jenga_models.checkpoint import Checkpoint, check_dataset
from jenga_models.columns import Rows, dataset_name
from jenga_models.metrics import predict_selection
from jenga_models.predict import opened

KNOWN = "train+validation"
"""Splits whose labels may be looked at."""
NO_CEILING = "not measured: the agreement of repeated pulls comes from `jenga calibrate ceiling`, named with --ceiling"


def selection_report(
    probability: Float[np.ndarray, " row"],
    test: Pulls,
    baselines: Sequence[Prediction],
    ceiling: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Score `probability`, the predicted probability that a pull fails, on `test`, next to `baselines`.

    Everything but the rates of `strict` is about the paper's label; intervals are those of `selection_scores.scores`.
    """
    said = probability >= THRESHOLD
    entries = {
        p.name: {
            "information": p.information,
            **scores(p.probability, test),
            "model_minus_baseline": more_often_right(said, p.said, test),
            "settings": p.settings,
        }
        for p in baselines
    }
    return {
        "n": len(test),
        **scores(probability, test),
        "majority": entries["majority"]["accuracy"],
        "ceiling": ceiling,
        **({} if ceiling else {"ceiling_reason": NO_CEILING}),
        "baselines": entries,
        "failures": proportion_over_towers(test.failure, test.tower),
        "strict": {
            "accuracy": proportion_over_towers(said == test.strict_failure, test.tower),
            "failures": proportion_over_towers(test.strict_failure, test.tower),
        },
        **grouped_scores(probability, test),
    }


def evaluate_selection(
    checkpoint: Checkpoint | Path | str,
    dataset: Rows,
    baselines: Which = "quick",
    workers: int = 1,
    ceiling: Path | None = None,
) -> dict[str, Any]:
    """Score a selector on the test split of a dataset of pulls; train and validation split only fit the baselines.

    Args:
        baselines: the rules alone ("none"), with hand-made features ("quick"), or with mechanics as well ("all").
        workers: processes that compute mechanics.
        ceiling: the report that `jenga calibrate ceiling` wrote.

    Raises:
        JengaError: a split has no rows, the checkpoint or the dataset is of another kind, or `ceiling` is no report.
    """
    model = opened(checkpoint, "selection")
    note = check_dataset(model, dataset)
    train, test = sides(dataset, [], workers)
    rows = dataset.rows("test")
    probability = predict_selection(model, dataset, rows)
    measured = read_ceiling(ceiling) if ceiling else None
    said = predict_baselines(train, test, baselines)
    first = first_pulls(dataset, rows)
    return {
        "model": model.name,
        "model_hash": model.hash,
        "dataset": dataset_name(dataset),
        "dataset_hash": dataset.hash,
        "note": note,
        **selection_report(probability, test.pulls, said, measured),
        **({} if first.all() else {"one_pull_a_tower": scores(probability[first], test.pulls.of(first))}),
    }


def sides(dataset: Rows, more: Sequence[Rows], workers: int) -> tuple[Side, Side]:
    """The rows that fit baselines (train and validation towers, of `more` datasets too) and the test rows.

    Raises:
        JengaError: one side has no rows, or a tower is on both.
    """
    test: list[Part] = [(dataset, dataset.rows("test"))]
    known: list[Part] = [(part, part.rows(KNOWN)) for part in (dataset, *more)]
    counts = [sum(len(rows) for _, rows in parts) for parts in (known, test)]
    if not all(counts):
        raise JengaError(
            f"{dataset_name(dataset)} has {counts[0]} train and validation rows and {counts[1]} test rows; "
            "it needs both: collect more towers and convert them together"
        )
    held_out = np.unique(dataset.column("tower")[test[0][1]])
    for part, rows in known:
        if (leaked := np.isin(part.column("tower")[rows], held_out)).any():
            raise JengaError(
                f"{leaked.sum()} training rows of {dataset_name(part)} are of test towers of {dataset_name(dataset)}; "
                "allowed: other towers, collected with another --seed"
            )
    return Side.of(known, workers), Side.of(test, workers)


def read_ceiling(path: Path) -> dict[str, Any]:
    """How often two pulls agree, a proportion, with the bounds that this sets to anyone's accuracy.

    Raises:
        JengaError: the file is not what `jenga calibrate ceiling` writes.
    """
    try:
        report = msgspec.json.decode(path.read_bytes())
        low, high = map(float, report["accuracy_bounds"])
        ceiling = {**report["agreement"], "accuracy_bounds": [low, high]}
        float(ceiling["rate"])
        return ceiling | ({"repeated": report["repeated"]} if "repeated" in report else {})
    except OSError as error:
        raise JengaError(f"cannot read {path}: {error.strerror}; `jenga calibrate ceiling` writes it") from error
    except (msgspec.DecodeError, KeyError, TypeError, ValueError):
        raise JengaError(f"{path} is no report of `jenga calibrate ceiling`: name its ceiling.json") from None
