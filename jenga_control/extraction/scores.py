"""What many rollouts of one way to pull came to: counted from the headers and outcomes of their logs."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from jenga_data.episode import EpisodeHeader, Result
from jenga_data.outcome import Outcome
from jenga_data.statistics import Proportion, paired_difference

ROUNDS = ((1, 5), (6, 10), (11, 15))
"""Groups of rounds, both ends included, for tables of few towers."""


@dataclass(frozen=True, eq=False)
class Ended:
    """One rollout as its log tells it without the frames."""

    path: Path
    header: EpisodeHeader
    result: Result


def succeeded(runs: Sequence[Ended]) -> Bool[np.ndarray, " run"]:
    """Whether the block is out and the tower stands."""
    return np.array([run.result.verdict.outcome is Outcome.EXTRACTED for run in runs], bool)


def clean(runs: Sequence[Ended]) -> Bool[np.ndarray, " run"]:
    """...and no other block was dragged."""
    return succeeded(runs) & ~np.array([run.result.verdict.dragged for run in runs], bool)


def scores(runs: Sequence[Ended]) -> dict[str, Any]:
    """Rates, causes and disturbance; every tower that was started is in the denominator."""
    verdicts = [run.result.verdict for run in runs]
    outcomes = Counter(verdict.outcome.value for verdict in verdicts)
    success = succeeded(runs)
    moved = [verdict.moved for verdict in verdicts if verdict.outcome is not Outcome.INVALID]
    causes = Counter(run.result.cause or run.result.verdict.outcome.value for run in runs if run.result.verdict.failure)
    return {
        "success": Proportion.of(success).as_dict(),
        "success_without_dragging": Proportion.of(clean(runs)).as_dict(),
        "outcomes": {outcome.value: outcomes[outcome.value] for outcome in Outcome},
        "causes": dict(sorted(causes.items())),
        "median_disturbance_mm": float(np.median(moved) * 1e3) if moved else None,
        "by_round": by_round(runs),
    }


def by_round(runs: Sequence[Ended]) -> dict[str, Any]:
    """Success in each group of rounds that has a tower."""
    success, rounds = succeeded(runs), np.array([run.header.round for run in runs])
    groups = {f"{low}-{high}": (low <= rounds) & (rounds <= high) for low, high in ROUNDS}
    return {name: Proportion.of(success[group]).as_dict() for name, group in groups.items() if group.any()}


def paired(first: Sequence[Ended], second: Sequence[Ended]) -> dict[str, Any]:
    """How much more often the first succeeds than the second on the same towers, with and without dragging."""
    tower = np.array([run.header.blocks.tower for run in first])
    return paired_difference(succeeded(first), succeeded(second), tower) | {
        "without_dragging": paired_difference(clean(first), clean(second), tower)
    }


def switch_words(settings: Mapping[str, Any]) -> str:
    """The switches that were on, as they stand behind the name of a way."""
    return "".join(f" +{word}" for word in ("select", "push_control", "touch") if word in settings)
