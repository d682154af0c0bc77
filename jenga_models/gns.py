"""Graph network simulator: encoder, processing layers, decoder; and a classifier on the same trunk."""

from collections.abc import Mapping
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor, nn

from jenga_models.graphs import Graphs
from jenga_models.layers import LightInteraction, MemoryInteraction, SplitLinear, mlp

POSE_WIDTH = 7
CLASSES = 2
ACTION_WIDTH = 3


@dataclass(frozen=True)
class Widths:
    """Numbers a node, an edge and a graph (its action) bring in; what a model is built for. `at` says where in a
    node's row each feature stands (`jenga_models.features.feature_slices`)."""

    node: int
    edge: int
    action: int
    at: Mapping[str, slice]


class Trunk(nn.Module):
    """Encoder and processing layers: a state for every node.

    The action is a global of the graph, appended to each node (paper, section II-C); its part of the first layer
    is computed once a graph.
    """

    def __init__(
        self, widths: Widths, width: int, layers: int, hidden_layers: int, edge_memory: bool, shared: bool = False
    ) -> None:
        super().__init__()
        self.layers = layers
        self.action_width = widths.action
        self.encode_first = SplitLinear([widths.node, widths.action], width)
        self.encode_node = nn.Sequential(nn.ReLU(), mlp(width, width, width, hidden_layers - 1, norm=True))
        self.encode_edge = mlp(widths.edge, width, width, hidden_layers, norm=True) if edge_memory else nn.Identity()
        self.steps = nn.ModuleList(
            MemoryInteraction(width, hidden_layers)
            if edge_memory
            else LightInteraction(width, widths.edge, hidden_layers)
            for _ in range(1 if shared else layers)
        )

    def forward(self, graphs: Graphs) -> Float[Tensor, "*sample node width"]:
        first = self.encode_first.part(0, graphs.node)
        if self.action_width:
            assert graphs.action is not None, "this model needs actions"
            first = first + graphs.spread(self.encode_first.part(1, graphs.action))
        node, edge = self.encode_node(first), self.encode_edge(graphs.edge)
        for step in range(self.layers):
            node, edge = self.steps[step % len(self.steps)](node, edge, graphs)
        return node


class GNS(nn.Module):
    """The simulator's network: graphs with an action -> displacement of every node, in units of its scale."""

    def __init__(self, widths: Widths, *, width: int, layers: int, hidden_layers: int, edge_memory: bool) -> None:
        super().__init__()
        self.trunk = Trunk(widths, width, layers, hidden_layers, edge_memory)
        self.decode = mlp(width, width, POSE_WIDTH, hidden_layers, norm=False)

    def forward(self, graphs: Graphs) -> Float[Tensor, "*sample node 7"]:
        return self.decode(self.trunk(graphs))


class InteractionClassifier(nn.Module):
    """A selector: message passing with typed edges in both directions, and a readout -> logits of (holds, fails)."""

    def __init__(
        self, widths: Widths, *, width: int, layers: int, shared: bool, at_target: bool, hidden_layers: int = 1
    ) -> None:
        super().__init__()
        self.at_target = at_target
        self.trunk = Trunk(widths, width, layers, hidden_layers, edge_memory=False, shared=shared)
        self.readout = mlp(width, width, CLASSES, hidden_layers, norm=False)

    def forward(self, graphs: Graphs) -> Float[Tensor, "graph 2"]:
        node = self.trunk(graphs)
        return self.readout(graphs.at_target(node) if self.at_target else graphs.mean(node))
