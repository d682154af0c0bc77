"""A store's graphs as one featurizer sees them: computed once, so that a batch is gathered and not computed."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from jenga_models.features import Featurizer
from jenga_models.graphs import Graphs
from jenga_models.store import GraphStore

_ROWS_AT_ONCE = 1024


@lru_cache(maxsize=8)
def _counted(graphs: int, blocks: int) -> tuple[Int[Tensor, " node"], Int[Tensor, " graph"]]:
    """To which graph each node of a batch belongs, and the first node of each graph: the same in every full batch, so
    that all of them share these tensors. Nobody may write into them."""
    return torch.arange(graphs).repeat_interleave(blocks), torch.arange(graphs) * blocks


@dataclass(frozen=True, eq=False)
class ReadyStore:
    """All graphs of a dataset, normalised: what training takes its batches from, epoch after epoch.

    Attributes of edges cost more than everything else of a batch when they are computed for each anew; kept, they
    take 5 kB a row of 150 edges. `batch` gives what `GraphStore.batch` does. Its edges are gathered in numpy, straight
    into the arrays of the batch: on one thread that is several times faster than torch.
    """

    store: GraphStore
    featurizer: Featurizer
    node: Float[Tensor, "row block feature"]
    edge: Float[np.ndarray, "edge attribute"]
    """What the network sees of the edges of all rows, in the order of the store and in the first of the flow's ways."""
    action: Float[Tensor, "row 3"] | None

    @classmethod
    def of(cls, store: GraphStore, featurizer: Featurizer) -> "ReadyStore":
        n = featurizer.normalisation
        known = [np.zeros((0, featurizer.edge_width), np.float32)]
        for rows in torch.arange(len(store)).split(_ROWS_AT_ONCE):
            upper, lower = store.edges_of(rows)
            messages = featurizer.messages(featurizer.attributes_of(store.node[rows].flatten(0, 1), upper, lower))
            known.append(messages[: len(upper)].numpy())
        action = store.action if featurizer.spec.action else None
        return cls(
            store=store,
            featurizer=featurizer,
            node=(store.node - n.node_mean) / n.node_scale,
            edge=np.concatenate(known),
            action=None if action is None else (action - n.action_mean) / n.action_scale,
        )

    def batch(self, rows: Int[Tensor, " graph"]) -> Graphs:
        """The graphs of some rows, normalised, as one flat batch in the order of `rows`."""
        graph, first = _counted(len(rows), self.store.blocks)
        edge_index, edge = self._edges(rows)
        return Graphs(
            node=self.node.index_select(0, rows).flatten(0, 1),
            edge_index=torch.from_numpy(edge_index),
            edge=torch.from_numpy(edge),
            target=self.store.target.index_select(0, rows) + first,
            action=None if self.action is None else self.action.index_select(0, rows),
            graph=graph,
        )

    def _edges(
        self, rows: Int[Tensor, " graph"]
    ) -> tuple[Int[np.ndarray, "2 message"], Float[np.ndarray, "message attribute"]]:
        """Ends and attributes of the messages, in the order of `features.directed` and `Featurizer.messages`."""
        number, shift = self.store.edge_numbers(rows)
        count, flow = len(number), self.featurizer.flow
        ways = 2 if flow == "both" else 1
        index = np.empty((2, ways * count), np.int64)
        for end, row in zip((self.store.upper, self.store.lower), (1, 0) if flow == "up" else (0, 1), strict=True):
            there = index[row, :count]
            np.take(end.numpy(), number, out=there, mode="clip")  # "raise" would copy; the numbers are right
            there += shift
        edge = np.empty((ways * count, self.edge.shape[1]), np.float32)
        if self.edge.shape[1] == 1:
            edge[:count] = -1.0 if flow == "up" else 1.0
        else:
            np.take(self.edge, number, axis=0, out=edge[:count], mode="clip")
        if ways == 2:
            index[0, count:], index[1, count:] = index[1, :count], index[0, :count]
            edge[count:] = edge[:count]
            edge[count:, 0] = -1.0
        return index, edge
