"""Trained selectors as rows of the table: checkpoints that differ by their seed alone are one row."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from jenga_control.selection.pulls import Prediction, Pulls
from jenga_data.errors import JengaError
from jenga_models.checkpoint import Checkpoint, check_dataset
from jenga_models.columns import Rows
from jenga_models.metrics import predict_selection
from jenga_models.predict import opened

SIZES = ("training_towers", "training_rows")
"""Metrics that say how much a checkpoint was trained on, where a training wrote them."""


@dataclass(frozen=True, eq=False)
class Family:
    """Checkpoints of one configuration and one amount of training data, a seed each."""

    name: str
    members: list[Checkpoint]
    each: Float[np.ndarray, "member row"]
    """Probability of failure that each member gave each test row."""

    @property
    def prediction(self) -> Prediction:
        """What the members say together: the mean of their probabilities."""
        return Prediction(self.name, self.graph, self.each.mean(axis=0), {})

    @property
    def graph(self) -> str:
        return self.members[0].spec.name

    @property
    def size(self) -> dict[str, int]:
        """How much it was trained on, as far as its checkpoints say."""
        return {name: int(self.members[0].metrics[name]) for name in SIZES if name in self.members[0].metrics}

    @property
    def recipe(self) -> str:
        """What it has in common with families that were trained on more or less."""
        return _recipe(self.members[0], size=False)

    @property
    def recipe_without_graph(self) -> str:
        return repr({k: v for k, v in _settings(self.members[0]).items() if k != "graph"})

    def spread(self, test: Pulls) -> dict[str, Any]:
        """Accuracy over the seeds."""
        accuracy = ((self.each >= 0.5) == test.failure).mean(axis=1)
        return {
            "n": len(accuracy),
            "mean": float(accuracy.mean()),
            "std": float(accuracy.std(ddof=1)) if len(accuracy) > 1 else None,
            "accuracies": accuracy.tolist(),
        }


def families(paths: Sequence[Path], dataset: Rows, rows: Int[np.ndarray, " row"]) -> tuple[list[Family], list[str]]:
    """The checkpoints, grouped and asked about `rows`; notes say which were trained on other data than `dataset`.

    Raises:
        JengaError: a checkpoint cannot be read, is no selector, or was named twice.
    """
    models = [opened(path, "selection") for path in paths]
    if len({model.hash for model in models}) < len(models):
        raise JengaError(f"{_twice(models)} is named twice in --models; allowed: each checkpoint once")
    notes = [note for model in models if (note := check_dataset(model, dataset))]
    groups: dict[str, list[Checkpoint]] = {}
    for model in models:
        groups.setdefault(_recipe(model, size=True), []).append(model)
    found: list[Family] = []
    for members in groups.values():
        each = np.stack([predict_selection(member, dataset, rows) for member in members])
        found.append(Family(_new_name(members, [family.name for family in found]), members, each))
    return found, notes


def _twice(models: Sequence[Checkpoint]) -> Path:
    hashes = [model.hash for model in models]
    return next(model.path for i, model in enumerate(models) if model.hash in hashes[:i])


def _settings(model: Checkpoint) -> dict[str, Any]:
    return {k: v for k, v in asdict(model.config).items() if k not in ("seed", "accelerator", *SIZES)}


def _recipe(model: Checkpoint, *, size: bool) -> str:
    sizes = [(name, model.metrics.get(name)) for name in SIZES] if size else []
    return repr((_settings(model), model.dataset.hash, sizes))


def _new_name(members: Sequence[Checkpoint], taken: Sequence[str]) -> str:
    """What the members' folders are called in common, without a number at the end; told apart from others."""
    same = takewhile(lambda letters: len(set(letters)) == 1, zip(*(model.name for model in members), strict=False))
    shared = "".join(letters[0] for letters in same)
    if len(members) > 1:
        shared = shared.rstrip("-_.0123456789").removesuffix("seed").rstrip("-_.")
    graph = members[0].spec.name
    name = shared or f"{members[0].config.model}-{graph}"
    if name in taken:
        name = f"{name} ({graph})"
    number = 2
    while name in taken:
        name, number = f"{shared or graph} {number}", number + 1
    return name
