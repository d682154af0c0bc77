"""Many graphs at once, as networks take them: tensors only, no object a graph."""

from dataclasses import dataclass, fields, replace
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Graphs:
    """Normalised graphs in one of two forms.

    Flat (`graph` is set): the nodes of all graphs in one list, `graph` says to which graph each belongs, and
    `edge_index` counts through the whole list, like a batch of torch_geometric.
    Static (`graph` is None): a sample axis in front, and one `edge_index` that all samples share. Node axes
    are always the last but one, so layers index that axis and serve both.
    """

    node: Float[Tensor, "*sample node feature"]
    edge_index: Int[Tensor, "2 edge"]
    """Row 0 the node that a message leaves, row 1 the one it reaches."""
    edge: Float[Tensor, "*#sample edge attribute"]
    target: Int[Tensor, " graph"]
    """Row on the node axis of each graph's target."""
    action: Float[Tensor, "graph *horizon 3"] | None = None
    """One action a graph, or a plan of several."""
    lag: Float[Tensor, "graph 3"] | None = None
    """How far the hand's set point is ahead of the hand [m], where a model asks for it: how hard it pulls."""
    graph: Int[Tensor, " node"] | None = None
    edge_mask: Float[Tensor, "*#sample edge"] | None = None
    """Messages are multiplied by it: 0 takes an edge out of a shared topology, for some samples or all."""

    def __len__(self) -> int:
        return len(self.target)

    def to(self, device: Any, non_blocking: bool = False) -> "Graphs":
        tensors = {f.name: getattr(self, f.name) for f in fields(self)}
        moved = {k: v.to(device, non_blocking=non_blocking) for k, v in tensors.items() if v is not None}
        return replace(self, **moved)

    def spread(self, values: Float[Tensor, "graph value"]) -> Float[Tensor, "*#sample #node value"]:
        """One value a graph, given to each of its nodes (broadcast over the nodes of a static batch)."""
        return values[:, None, :] if self.graph is None else values[self.graph]

    def at_target(self, values: Float[Tensor, "*sample node value"]) -> Float[Tensor, "graph value"]:
        """What the targets hold; one sample may serve many targets."""
        if self.graph is not None:
            return values[self.target]
        sample = torch.arange(len(self), device=values.device) if len(values) > 1 else 0
        return values[sample, self.target]

    def mean(self, values: Float[Tensor, "*sample node value"]) -> Float[Tensor, "graph value"]:
        """The mean over the nodes of each graph."""
        if self.graph is None:
            return values.mean(-2)
        total = values.new_zeros(len(self), values.shape[-1]).index_add(0, self.graph, values)
        count = torch.bincount(self.graph, minlength=len(self))
        return total / count[:, None]

    def is_target(self) -> Float[Tensor, "*sample node"]:
        """1 at each graph's target, 0 elsewhere."""
        flag = self.node.new_zeros(self.node.shape[:-1])
        if self.graph is not None:
            return flag.index_fill(0, self.target, 1.0)
        return flag.scatter(1, self.target[:, None], 1.0)
