"""The paper's classifier: a graph convolutional network (section II-B)."""

from itertools import pairwise

from jaxtyping import Float
from torch import Tensor, nn
from torch_geometric.nn import GCNConv

from jenga_models.gns import CLASSES, Widths
from jenga_models.graphs import Graphs


class GCN(nn.Module):
    """Graph convolutions (Kipf and Welling 2017, arXiv 1609.02907) with ReLU, a readout and one linear layer.

    Convolutions know neither attributes nor directions of edges; edges of a static batch are shared by all samples.

    Returns logits of (holds, fails) a graph.
    """

    def __init__(self, widths: Widths, *, width: int, layers: int, residual: bool, at_target: bool) -> None:
        super().__init__()
        self.residual, self.at_target = residual, at_target
        sizes = [widths.node, *[width] * layers]
        self.convolutions = nn.ModuleList(GCNConv(a, b) for a, b in pairwise(sizes))
        self.readout = nn.Linear(width, CLASSES)

    def forward(self, graphs: Graphs) -> Float[Tensor, "graph 2"]:
        node = graphs.node
        for convolution in self.convolutions:
            after = convolution(node, graphs.edge_index).relu()
            node = node + after if self.residual and after.shape == node.shape else after
        return self.readout(graphs.at_target(node) if self.at_target else graphs.mean(node))
