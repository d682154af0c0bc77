"""Rows of a dataset to training batches: gathered from stacked tensors, without an object a graph."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from lightning.pytorch import LightningDataModule
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, Sampler

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

    @classmethod
    def of(cls, spec: GraphSpec, towers: Towers, action: Float[np.ndarray, "row 3"] | None = None) -> "GraphStore":
        return cls(
            node=raw_nodes(spec, towers),
            target=torch.tensor(towers.target),
            offset=torch.tensor(towers.offset),
            upper=torch.tensor(towers.upper),
            lower=torch.tensor(towers.lower),
            action=None if action is None else torch.tensor(action, dtype=torch.float32),
        )

    def __len__(self) -> int:
        return len(self.target)

    @property
    def blocks(self) -> int:
        return self.node.shape[1]

    def edges_of(self, rows: Int[Tensor, " graph"]) -> tuple[Tensor, Tensor]:
        """Upper and lower ends of the edges of some rows, counted through the nodes of all of them."""
        start = self.offset[rows]
        count = self.offset[rows + 1] - start
        before = count.cumsum(0) - count
        graph = torch.repeat_interleave(torch.arange(len(rows)), count)
        edge = torch.arange(len(graph)) + (start - before)[graph]
        shift = graph * self.blocks
        return self.upper[edge] + shift, self.lower[edge] + shift

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
        )


@dataclass(frozen=True, eq=False)
class Batch:
    """Graphs and what the network should say of them."""

    graphs: Graphs
    wanted: Tensor

    def __len__(self) -> int:
        return len(self.graphs)

    def to(self, device: torch.device, non_blocking: bool = False) -> "Batch":
        return Batch(self.graphs.to(device, non_blocking), self.wanted.to(device, non_blocking=non_blocking))


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


class Batches(Dataset[Batch]):
    """A dataset whose items are whole batches, asked for by their rows."""

    def __init__(self, store: GraphStore, featurizer: Featurizer, wanted: Tensor) -> None:
        self.store, self.featurizer, self.wanted = store, featurizer, wanted

    def __getitem__(self, rows: Int[Tensor, " graph"]) -> Batch:
        wanted = self.wanted[rows]
        graphs = self.store.batch(self.featurizer, rows)
        return Batch(graphs, wanted.flatten(0, 1) if wanted.ndim == 3 else wanted)


def _as_it_is(batch: Any) -> Any:
    return batch


class GraphData(LightningDataModule):
    """Training and validation batches of one dataset. `wanted` holds a label a row, or an output a block."""

    def __init__(
        self,
        store: GraphStore,
        featurizer: Featurizer,
        wanted: Tensor,
        *,
        train: Int[np.ndarray, " train"],
        validation: Int[np.ndarray, " validation"],
        batch_size: int,
        seed: int,
    ) -> None:
        super().__init__()
        self._batches = Batches(store, featurizer, wanted)
        self._train = EpochOrder(train, batch_size, seed)
        self._validation = EpochOrder(validation, 4 * batch_size, None)

    def _loader(self, order: EpochOrder) -> DataLoader[Batch]:
        return DataLoader(self._batches, sampler=order, batch_size=None, collate_fn=_as_it_is)

    def train_dataloader(self) -> DataLoader[Batch]:
        return self._loader(self._train)

    def val_dataloader(self) -> DataLoader[Batch] | list[DataLoader[Batch]]:
        return self._loader(self._validation) if len(self._validation) else []
