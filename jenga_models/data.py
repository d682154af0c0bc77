"""What Lightning asks for batches: graphs of a dataset's rows, with what the network should say of them."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Int
from lightning.pytorch import LightningDataModule
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from jenga_models.batch import Batch
from jenga_models.features import Featurizer
from jenga_models.ready import ReadyStore
from jenga_models.store import EpochOrder, GraphStore


class Batches(Dataset[Batch]):
    """A dataset whose items are whole batches, asked for by their rows."""

    def __init__(self, store: GraphStore, featurizer: Featurizer, wanted: Tensor) -> None:
        self.ready, self.wanted = ReadyStore.of(store, featurizer), wanted

    def __getitem__(self, rows: Int[Tensor, " graph"]) -> Batch:
        wanted = self.wanted.index_select(0, rows)
        graphs = self.ready.batch(rows)
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
        batches: Dataset[Batch] | None = None,
    ) -> None:
        """Args:
        batches: what gives a batch for some rows, where it is not `Batches` of the first three.
        """
        super().__init__()
        self._batches = Batches(store, featurizer, wanted) if batches is None else batches
        self._train = EpochOrder(train, batch_size, seed)
        self._validation = EpochOrder(validation, 4 * batch_size, None)

    def _loader(self, order: EpochOrder) -> DataLoader[Batch]:
        return DataLoader(self._batches, sampler=order, batch_size=None, collate_fn=_as_it_is)

    def train_dataloader(self) -> DataLoader[Batch]:
        return self._loader(self._train)

    def val_dataloader(self) -> DataLoader[Batch] | list[DataLoader[Batch]]:
        return self._loader(self._validation) if len(self._validation) else []

    def validation_batches(self) -> Iterator[Batch]:
        """The validation rows in their order, for what is done with them after training."""
        return (self._batches[rows] for rows in self._validation)
