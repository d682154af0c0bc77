"""Pulls and what somebody said of them: the arrays that every table about selection is made of."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from jenga_models.columns import Rows

THRESHOLD = 0.5
"""Predicted to fail from this probability on."""
INFORMATION = ("none", "G_s", "G_s+layout", "G_sp")
"""What a predictor may be told, from the least to the most: poses tell where in the tower a block lies."""


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

    def of(self, which: np.ndarray) -> "Pulls":
        """Some of them, by a mask or by numbers."""
        return Pulls(**{field.name: getattr(self, field.name)[which] for field in fields(self)})

    @staticmethod
    def joined(parts: "list[Pulls]") -> "Pulls":
        return Pulls(**{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Pulls)})


@dataclass(frozen=True, eq=False)
class Prediction:
    """The probability of failure that one predictor gave each pull."""

    name: str
    information: str
    """What it was told: "none", or the name of a graph (`jenga_data.graph_spec`)."""
    probability: Float[np.ndarray, " row"]
    settings: dict[str, Any]
    """What was chosen on the rows that it was fitted to."""

    @property
    def said(self) -> Bool[np.ndarray, " row"]:
        return self.probability >= THRESHOLD


def first_pulls(dataset: Any, rows: Int[np.ndarray, " row"]) -> Bool[np.ndarray, " row"]:
    """Which rows are their tower's one (J, b, f) of the paper: their collection's config has `pull` 0.

    A dataset that does not say so, as no table of its episodes comes with it, has none but such pulls.
    """
    configs = getattr(getattr(dataset.manifest, "provenance", None), "configs", {})
    later = [name for name, config in configs.items() if config.get("pull", 0)]
    if not later:
        return np.ones(len(rows), bool)
    episodes = dataset.episodes()
    others = episodes["episode"][np.isin(episodes["config"], later)]
    return ~np.isin(dataset.column("episode")[rows], others)


def by_information(rows: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """Rows of the table, those that are told less first, baselines before models."""
    return sorted(rows.items(), key=lambda item: (INFORMATION.index(item[1]["information"]), item[1]["kind"]))
