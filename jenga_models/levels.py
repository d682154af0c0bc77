"""A batch of towers as levels: dense arrays, so that a network can go through a tower level by level."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from jenga_models.graphs import Graphs


@dataclass(frozen=True, eq=False)
class Levels:
    """Where the nodes of a batch lie, told by the support edges alone: a block is one level above the highest block
    that it rests on, and blocks on nothing are level 0. Edges that skip a level, as in a fallen tower, are left out.

    The leading axis is the graph's, 1 where all samples share one topology.
    """

    cell: Int[Tensor, " node"]
    """Each node's place in the flattened [graph level place]."""
    held: Float[Tensor, "graph level place"]
    """1 where a block lies."""
    on: Float[Tensor, "graph level place place"]
    """1 where the block at [level, i] rests on the one at [level - 1, j]; level 0 rests on nothing."""
    mates: Float[Tensor, "graph level place place"]
    """1 where both lie on this level and are not the same."""

    @property
    def level(self) -> Int[Tensor, " node"]:
        """Each node's level, from 0 at the bottom."""
        _, tall, wide = self.held.shape
        return self.cell // wide % tall

    @classmethod
    def of(cls, graphs: Graphs) -> "Levels":
        """Edges must go from the upper block to the lower one, each once."""
        nodes, device = graphs.node.shape[-2], graphs.node.device
        count = len(graphs) if graphs.graph is not None else 1
        graph = graphs.graph if graphs.graph is not None else torch.zeros(nodes, dtype=torch.long, device=device)
        upper, lower = graphs.edge_index
        level = _levels(upper, lower, nodes)
        tall = int(level.max()) + 1
        key = graph * tall + level
        order = torch.argsort(key, stable=True)
        size = torch.bincount(key, minlength=count * tall)
        place = torch.empty_like(key)
        place[order] = torch.arange(nodes, device=device) - (size.cumsum(0) - size)[key[order]]
        wide = int(size.max())
        held = torch.zeros(count * tall * wide, device=device)
        cell = key * wide + place
        held[cell] = 1.0
        held = held.view(count, tall, wide)
        direct = level[upper] == level[lower] + 1
        upper, lower = upper[direct], lower[direct]
        on = torch.zeros(count, tall, wide, wide, device=device)
        on[graph[upper], level[upper], place[upper], place[lower]] = 1.0
        others = 1.0 - torch.eye(wide, device=device)
        return cls(cell, held, on, held[..., :, None] * held[..., None, :] * others)

    def spread(self, node: Float[Tensor, "*sample node value"]) -> Float[Tensor, "graph level place value"]:
        """Values of nodes at their places, 0 where no block lies."""
        graphs, tall, wide = self.held.shape
        samples = node.shape[0] if node.ndim == 3 else 1
        room = node.new_zeros(samples, graphs * tall * wide, node.shape[-1])
        filled = room.index_copy(1, self.cell, node.view(samples, -1, node.shape[-1]))
        return filled.view(samples * graphs, tall, wide, -1)

    def gathered(
        self, placed: Float[Tensor, "graph level place value"], node: Tensor
    ) -> Float[Tensor, "*sample node value"]:
        """The inverse of `spread`, in the form of `node`."""
        samples = node.shape[0] if node.ndim == 3 else 1
        flat = placed.reshape(samples, -1, placed.shape[-1]).index_select(1, self.cell)
        return flat if node.ndim == 3 else flat[0]


def _levels(upper: Int[Tensor, " edge"], lower: Int[Tensor, " edge"], nodes: int) -> Int[Tensor, " node"]:
    """The length of the longest way down from each node."""
    level = torch.zeros(nodes, dtype=torch.long, device=upper.device)
    for _ in range(nodes):
        higher = level.scatter_reduce(0, upper, level[lower] + 1, "amax")
        if torch.equal(higher, level):
            break
        level = higher
    return level
