"""The same graphs as objects of torch_geometric: what the loader is compared with."""

import warnings
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import torch

from jenga_data.dataset.read import Dataset
from jenga_data.graph import node_features
from jenga_data.graph_spec import GraphSpec
from jenga_models.batch import Batch

with (
    warnings.catch_warnings()
):  # torch_geometric 2.8 still decorates with torch.jit.script, which torch 2.13 deprecates
    warnings.simplefilter("ignore", DeprecationWarning)
    from torch_geometric.data import Batch as Union
    from torch_geometric.data import Data


def data_object(batch: Batch) -> Data:
    """A batch of one graph as an object. `target_index` is shifted by the node count when objects are united."""
    graphs = batch.graphs
    parts: dict[str, Any] = {"x": graphs.node, "edge_index": graphs.edge_index, "edge_attr": graphs.edge}
    parts |= {"y": batch.wanted, "target_index": graphs.target}
    return Data(**parts) if graphs.action is None else Data(**parts, action=graphs.action)


def union(objects: list[Any]) -> Any:
    return Union.from_data_list(objects)


def same(ours: Batch, theirs: Any) -> bool:
    """Whether every tensor of a batch is that of theirs; the order of edges within a batch may differ.

    Ours lists all downward messages and then all upward ones where theirs goes graph by graph.
    """
    graphs = ours.graphs
    pairs: list[tuple[Any, Any]] = [
        (graphs.node, theirs.x),
        (graphs.target, theirs.target_index),
        (ours.wanted, theirs.y),
    ]
    pairs.append((graphs.graph, theirs.batch))
    if graphs.action is not None:
        pairs.append((graphs.action, theirs.action))
    edges = [_sorted(graphs.edge_index, graphs.edge), _sorted(theirs.edge_index, theirs.edge_attr)]
    pairs += zip(*edges, strict=True)
    return all(torch.equal(a, b) for a, b in pairs)


def _sorted(edge_index: torch.Tensor, edge: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    order = np.lexsort((*edge.T.numpy(), *edge_index.numpy()))
    return edge_index[:, order], edge[order]


def read_data_objects(dataset: Dataset, spec: GraphSpec, limit: int) -> list[Data]:
    """The first rows of a dataset as objects, read as people do: row by row from a table, not normalised."""
    found: list[Data] = []
    for entry in dataset.manifest.data_files:
        for row in pq.read_table(dataset.folder / entry.path).to_pylist():
            if len(found) == limit:
                return found
            names = ("block_size", "block_mass", "block_pose", "level", "slot", "target")
            node = node_features(spec, **{name: np.array(row[name]) for name in names})
            edges = torch.tensor([row["edge_upper"], row["edge_lower"]])
            found.append(Data(x=torch.tensor(node, dtype=torch.float32), edge_index=edges, row=len(found)))
    return found
