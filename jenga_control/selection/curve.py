"""Accuracy against the number of training towers: baselines fitted again to fewer, and models trained on fewer."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Int, Shaped

from jenga_control.selection.baselines.learners import fit
from jenga_control.selection.baselines.suite import Baseline, Side
from jenga_control.selection.models import Family
from jenga_control.selection.pulls import THRESHOLD

SIZES = (50, 100, 200, 400, 800, 1600, 3200, 6400, 12800)
DRAWS = 3
"""Subsets of towers of each size, so that the curve shows more than the luck of one."""


def subsets(
    tower: Shaped[np.ndarray, " row"], sizes: Sequence[int] = SIZES, draws: int = DRAWS
) -> list[tuple[int, Int[np.ndarray, " drawn"]]]:
    """Rows of so many towers, drawn without replacement, for each size below the number of towers, and all once."""
    towers = np.unique(tower)
    found = []
    for size in (s for s in sizes if s < len(towers)):
        for draw in range(draws):
            drawn = np.random.default_rng((draw, size)).choice(towers, size, replace=False)
            found.append((size, np.flatnonzero(np.isin(tower, drawn))))
    return [*found, (len(towers), np.arange(len(tower)))]


def baseline_curve(
    baseline: Baseline, settings: dict[str, Any], train: Side, test: Side, sizes: Sequence[int] = SIZES
) -> list[dict[str, Any]]:
    """Accuracy on all test rows after fitting to fewer towers, with the settings that were chosen on all of them."""
    feature, unseen = train.features.matrix(baseline.features), test.features.matrix(baseline.features)
    points = []
    for towers, rows in subsets(train.pulls.tower, sizes):
        fitted = fit(
            baseline.learner, feature[rows], train.pulls.failure[rows], train.pulls.tower[rows], settings=settings
        )
        said = fitted.probability(unseen) >= THRESHOLD
        points.append({"towers": towers, "rows": len(rows), "accuracy": float((said == test.pulls.failure).mean())})
    return _by_size(points)


def model_curve(members: Sequence[Family], test: Side, all_towers: int) -> list[dict[str, Any]]:
    """Accuracy of families of one recipe; one that does not say on how many towers it was trained had them all."""
    points = []
    for family in members:
        size = family.size
        towers = size.get("training_towers", size.get("training_rows", all_towers))
        rows = size.get("training_rows", towers)
        points += [{"towers": towers, "rows": rows, "accuracy": a} for a in family.spread(test.pulls)["accuracies"]]
    return _by_size(points)


def _by_size(points: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Mean and spread over the draws or seeds of each size."""
    found = []
    for towers in sorted({p["towers"] for p in points}):
        own = [p for p in points if p["towers"] == towers]
        accuracy = np.array([p["accuracy"] for p in own])
        found.append(
            {
                "towers": towers,
                "rows": round(float(np.mean([p["rows"] for p in own]))),
                "accuracy": float(accuracy.mean()),
                "std": float(accuracy.std(ddof=1)) if len(own) > 1 else None,
                "n": len(own),
            }
        )
    return found
