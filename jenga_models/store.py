"""Towers in stacked tensors, and batches of graphs gathered from them without an object a graph."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.utils.data import Sampler

from jenga_data.graph import GraphSpec
from jenga_models.columns import Towers
from jenga_models.features import Featurizer, raw_nodes
from jenga_models.graphs import Graphs


@dataclass(frozen=True, eq=False)
class GraphStore:
    """All towers of a dataset as raw tensors: `batch` gathers any of them into one flat batch of graphs."""

    node: Float[Tensor, "row block feature"]
    target: Int[Tensor, " row"]
    offset: Int[Tensor, " row+1"]
    upper: Int[Tensor, " edge"]
    lower: Int[Tensor, " edge"]
    action: Float[Tensor, "row 3"] | None = None
    lag: Float[Tensor, "row 3"] | None = None

    @classmethod
    def of(
        cls,
        spec: GraphSpec,
        towers: Towers,
        action: Float[np.ndarray, "row 3"] | None = None,
        lag: Float[np.ndarray, "row 3"] | None = None,
    ) -> "GraphStore":
        return cls(
            node=raw_nodes(spec, towers),
            target=torch.tensor(towers.target),
            offset=torch.tensor(towers.offset),
            upper=torch.tensor(towers.upper),
            lower=torch.tensor(towers.lower),
            action=None if action is None else torch.tensor(action, dtype=torch.float32),
            lag=None if lag is None else torch.tensor(lag, dtype=torch.float32),
        )

    def __len__(self) -> int:
        return len(self.target)

    @property
    def blocks(self) -> int:
        return self.node.shape[1]

    def edges_of(self, rows: Int[Tensor, " graph"]) -> tuple[Tensor, Tensor]:
        """Upper and lower ends of the edges of some rows, counted through the nodes of all of them."""
        edge, shift = self.edge_numbers(rows)
        upper, lower = (np.take(end.numpy(), edge) + shift for end in (self.upper, self.lower))
        return torch.from_numpy(upper), torch.from_numpy(lower)

    def edge_numbers(self, rows: Int[Tensor, " graph"]) -> tuple[Int[np.ndarray, " edge"], Int[np.ndarray, " edge"]]:
        """Where the edges of some rows stand in the store, and the first node of each one's graph in the batch.

        In numpy: on one thread it repeats and gathers integers four times faster than torch.
        """
        offset, chosen = self.offset.numpy(), rows.numpy()
        start = offset[chosen]
        count = offset[chosen + 1] - start
        edge = np.repeat(start - (np.cumsum(count) - count), count)
        edge += np.arange(len(edge))
        return edge, np.repeat(np.arange(len(chosen)) * self.blocks, count)

    def batch(self, featurizer: Featurizer, rows: Int[Tensor, " graph"]) -> Graphs:
        """The graphs of some rows, normalised, as one flat batch in the order of `rows`."""
        upper, lower = self.edges_of(rows)
        graph = torch.arange(len(rows))
        return featurizer.graphs(
            self.node[rows].flatten(0, 1),
            upper,
            lower,
            target=self.target[rows] + graph * self.blocks,
            action=None if self.action is None else self.action[rows],
            graph=graph.repeat_interleave(self.blocks),
            lag=None if self.lag is None else self.lag[rows],
        )


class EpochOrder(Sampler[Tensor]):
    """Which rows come when: a function of (seed, epoch, position) and of nothing else.

    A resumed run continues where it was by asking for the same epoch and position again.
    """

    def __init__(self, rows: Int[np.ndarray, " row"], batch_size: int, seed: int | None) -> None:
        """`seed` None keeps the rows in their order."""
        self.rows, self.batch_size, self.seed = rows, batch_size, seed
        self.epoch = 0

    def __iter__(self) -> Iterator[Int[Tensor, " graph"]]:
        # A generator, so that the epoch is read with the first batch: a resuming Lightning calls iter() before
        # set_epoch().
        yield from self.batches(self.epoch)

    def set_epoch(self, epoch: int) -> None:
        """Lightning calls this before each epoch."""
        self.epoch = epoch

    def __len__(self) -> int:
        return -(-len(self.rows) // self.batch_size)

    def batches(self, epoch: int, position: int = 0) -> Iterator[Int[Tensor, " graph"]]:
        """Rows of the batches of one epoch, from batch number `position` on; the last one may be smaller."""
        rows = self.rows
        if self.seed is not None:
            rows = np.random.default_rng((self.seed, epoch)).permutation(rows)
        for start in range(position * self.batch_size, len(rows), self.batch_size):
            yield torch.from_numpy(rows[start : start + self.batch_size])
