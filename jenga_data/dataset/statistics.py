"""Mean, standard deviation and range of every numeric column, streamed: memory does not grow with the rows."""

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float, Shaped

from jenga_data.dataset.manifest import Statistic
from jenga_data.dataset.rows import Ragged, Rows
from jenga_data.dataset.schema import BLOCK, EDGE, Column


class Moments:
    """Moments of `width` numbers that vary together, merged batch by batch.

    Chan, Golub and LeVeque, "Updating formulae and a pairwise algorithm for computing sample variances" (1979).
    """

    def __init__(self, width: int) -> None:
        self.count = 0
        self.mean = np.zeros(width)
        self.squares = np.zeros(width)
        self.low = np.full(width, np.inf)
        self.high = np.full(width, -np.inf)

    def add(self, values: Float[np.ndarray, "sample width"]) -> None:
        if len(values) == 0:
            return
        batch = Moments(len(self.mean))
        batch.count = len(values)
        batch.mean = values.mean(axis=0)
        batch.squares = ((values - batch.mean) ** 2).sum(axis=0)
        batch.low, batch.high = values.min(axis=0), values.max(axis=0)
        self.merge(batch)

    def merge(self, other: "Moments") -> None:
        """Count in what another one has seen."""
        if other.count == 0:
            return
        shift, count = other.mean - self.mean, self.count + other.count
        self.squares += other.squares + shift**2 * (self.count * other.count / count)
        self.mean += shift * (other.count / count)
        self.low, self.high = np.minimum(self.low, other.low), np.maximum(self.high, other.high)
        self.count = count

    def statistic(self) -> Statistic:
        """Population moments to nine digits: a float32 is kept exactly, a platform's last bits are not."""
        std = np.sqrt(self.squares / max(self.count, 1))
        return Statistic(self.count, *(_rounded(v) for v in (self.mean, std, self.low, self.high)))


def _rounded(values: Shaped[np.ndarray, " width"]) -> list[float]:
    return [float(f"{v:.9g}") if np.isfinite(v) else 0.0 for v in values]


class ColumnStatistics:
    """Statistics of a dataset's numeric columns. A column's last axis is kept, rows, blocks and edges are pooled:
    `block_pose` has 7 means, `block_mass` one."""

    def __init__(self, columns: Iterable[Column]) -> None:
        self.rows = 0
        self._moments = {c.name: Moments(_width(c)) for c in columns if c.numeric}

    def add(self, rows: Rows) -> None:
        """Count rows in, as they are stored: floats rounded to 32 bit."""
        self.rows += len(rows["episode"])
        for name, moments in self._moments.items():
            column = rows[name]
            values = column.values if isinstance(column, Ragged) else column
            moments.add(np.asarray(values).astype(np.float32).astype(float).reshape(-1, len(moments.mean)))

    def merge(self, other: "ColumnStatistics") -> None:
        """Count in what another one has seen of the same columns."""
        self.rows += other.rows
        for name, moments in self._moments.items():
            moments.merge(other._moments[name])

    def summary(self) -> dict[str, Statistic]:
        return {name: moments.statistic() for name, moments in self._moments.items()}


def _width(column: Column) -> int:
    last = column.shape[-1] if column.shape else 1
    return 1 if last in (BLOCK, EDGE) else int(last)
