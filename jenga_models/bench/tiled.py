"""A small dataset as large as one to train on: its rows again and again, in memory of their own."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from jenga_data.dataset.read import Edges
from jenga_models.columns import Rows


@dataclass(frozen=True, eq=False)
class Tiled:
    """A dataset's rows `times` times over. Its splits are those of the first time."""

    dataset: Rows
    times: int

    @property
    def manifest(self) -> Any:
        return self.dataset.manifest

    @property
    def hash(self) -> str:
        return self.dataset.hash

    def __len__(self) -> int:
        return self.times * len(self.dataset)

    def rows(self, split: Any) -> np.ndarray:
        return self.dataset.rows(split)

    def column(self, name: str) -> np.ndarray:
        values = self.dataset.column(name)
        return np.tile(values, (self.times, *[1] * (values.ndim - 1)))

    def edges(self) -> Edges:
        edges: Any = self.dataset.edges()
        count = np.tile(np.diff(edges.offset), self.times)
        ragged = (np.tile(values, self.times) for values in (edges.upper, edges.lower, edges.force))
        return Edges(np.concatenate([[0], np.cumsum(count)]), *ragged)
