"""Features of many pulls at once, each kind computed when it is first asked for and kept."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from jenga_control.selection.baselines.graph_features import graph_features
from jenga_control.selection.baselines.layout_features import layout_features
from jenga_control.selection.baselines.mechanics import MechanicalCase, mechanical_features
from jenga_control.selection.baselines.structure import Structure, structures
from jenga_data.contact_law import ContactLaw
from jenga_data.pool import run_every
from jenga_data.progress import progress
from jenga_data.sim.physics import PhysicsConfig
from jenga_models.columns import Rows

Table = list[dict[str, float]]
Part = tuple[Rows, Int[np.ndarray, " _"]]
"""Some rows of one dataset."""


class FeatureTable:
    """Hand-made features of some rows of some datasets, row by row.

    Kinds: "graph" (of G_s), "layout" (of G_s+layout), "mechanics" (of G_s+layout), "mechanics+layout" (both), and
    "mechanics+poses" (of G_sp).
    """

    def __init__(self, parts: Sequence[Part], workers: int = 1) -> None:
        self.parts, self.workers = parts, workers
        self._made: dict[str, Table] = {}
        self._structures: list[Structure] | None = None

    def __len__(self) -> int:
        return sum(len(rows) for _, rows in self.parts)

    def matrix(self, kind: str) -> Float[np.ndarray, "row feature"]:
        """The features of that kind."""
        return np.array([list(row.values()) for row in self._of(kind)], float).reshape(len(self), -1)

    def column(self, kind: str, name: str) -> Float[np.ndarray, " row"]:
        """One feature by name."""
        return np.array([row[name] for row in self._of(kind)], float)

    def _of(self, kind: str) -> Table:
        if kind not in self._made:
            self._made[kind] = self._compute(kind)
        return self._made[kind]

    def _compute(self, kind: str) -> Table:
        plain: dict[str, Callable[[Structure], dict[str, float]]] = {"graph": graph_features, "layout": layout_features}
        if kind in plain:
            return [plain[kind](tower) for tower in self._towers]
        if kind == "mechanics+layout":
            pairs = zip(self._of("layout"), self._of("mechanics"), strict=True)
            return [layout | mechanics for layout, mechanics in pairs]
        return self._mechanics(posed=kind == "mechanics+poses")

    @property
    def _towers(self) -> list[Structure]:
        if self._structures is None:
            self._structures = [tower for dataset, rows in self.parts for tower in structures(dataset, rows)]
        return self._structures

    def _mechanics(self, *, posed: bool) -> Table:
        laws = [law for dataset, rows in self.parts for law in contact_laws(dataset, rows)]
        cases = [
            (number, MechanicalCase(tower, law, posed))
            for number, (tower, law) in enumerate(zip(self._towers, laws, strict=True))
        ]
        found: list[dict[str, float]] = [{}] * len(cases)
        with progress("equilibria", len(cases)) as bar:
            for (number, _), features in run_every(_features_of, cases, self.workers):
                found[number] = features
                bar.advance()
        return found


def _features_of(case: tuple[int, MechanicalCase]) -> dict[str, float]:
    return mechanical_features(case[1])


def contact_laws(dataset: Any, rows: Int[np.ndarray, " row"]) -> list[ContactLaw]:
    """The law of the contacts in each row's simulation; today's where the dataset does not say."""
    configs = getattr(getattr(dataset.manifest, "provenance", None), "configs", {})
    laws = {name: PhysicsConfig(**config["physics"]).contact_law for name, config in configs.items()}
    if len(set(laws.values())) < 2:
        return [next(iter(laws.values()), PhysicsConfig().contact_law)] * len(rows)
    episodes = dataset.episodes()
    config = dict(zip(episodes["episode"], episodes["config"], strict=True))
    return [laws[config[episode]] for episode in dataset.column("episode")[rows]]
