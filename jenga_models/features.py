"""From raw columns to normalised graphs: one code path for training rows, logs, live towers and predictions."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from jenga_data.graph import node_features
from jenga_data.graph_spec import FEATURE_WIDTH, GraphSpec
from jenga_models.columns import Towers
from jenga_models.config import Flow
from jenga_models.graphs import Graphs
from jenga_models.normalisation import Normalisation

MEASURED = ("block_size", "block_mass", "block_pose", "level")
"""Node features that are standardised. The others are flags, and stay 0 and 1."""


def feature_slices(spec: GraphSpec) -> dict[str, slice]:
    """Where each feature stands in a node's row."""
    ends = np.cumsum([FEATURE_WIDTH[name] for name in spec.node_features]).tolist()
    return {name: slice(end - FEATURE_WIDTH[name], end) for name, end in zip(spec.node_features, ends, strict=True)}


def raw_nodes(spec: GraphSpec, towers: Towers) -> Float[Tensor, "row block feature"]:
    """Node features in SI units, by `jenga_data.graph.node_features`."""
    features = node_features(
        spec,
        block_size=towers.block_size,
        block_mass=towers.block_mass,
        block_pose=towers.block_pose,
        level=towers.level,
        slot=towers.slot,
        target=towers.target,
        block_twist=towers.block_twist,
    )
    return torch.from_numpy(np.ascontiguousarray(features, np.float32))


def attribute_width(spec: GraphSpec) -> int:
    """Numbers that `edge_attributes` gives an edge of this graph."""
    if "block_pose" not in spec.node_features:
        return 0
    return 7 + ("block_size" in spec.node_features)


def edge_attributes(
    spec: GraphSpec,
    node: Float[Tensor, "*sample node feature"],
    upper: Int[Tensor, " edge"],
    lower: Int[Tensor, " edge"],
) -> Float[Tensor, "*sample edge attribute"]:
    """What the raw features of an edge's two blocks say of their relation, seen from the lower block.

    With poses: the way from the lower to the upper block in the world [m] (every pull is along the world's -x)
    and the rotation between them as a wxyz quaternion with w >= 0. With sizes as well: the gap between the
    two, as if both lay flat [m]; a loose block shows in it by hundredths of a millimetre.
    """
    at = feature_slices(spec)
    columns: list[Tensor] = []
    if "block_pose" in at:
        above, below = (node[..., at["block_pose"]].index_select(-2, end) for end in (upper, lower))
        offset = above[..., :3] - below[..., :3]
        columns += [offset, relative_rotation(below[..., 3:], above[..., 3:])]
        if "block_size" in at:
            height = node[..., at["block_size"]][..., 2]
            reach = (height.index_select(-1, upper) + height.index_select(-1, lower)) / 2
            columns.append((offset[..., 2] - reach)[..., None])
    return torch.cat(columns, dim=-1) if columns else node.new_zeros(*node.shape[:-2], len(upper), 0)


def relative_rotation(first: Float[Tensor, "*batch 4"], second: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 4"]:
    """conj(first) * second, as a wxyz quaternion with w >= 0."""
    w, v = first[..., :1], -first[..., 1:]
    u, q = second[..., :1], second[..., 1:]
    real = w * u - (v * q).sum(-1, keepdim=True)
    imaginary = w * q + u * v + torch.linalg.cross(v, q)
    product = torch.cat([real, imaginary], dim=-1)
    return torch.where(real < 0, -product, product)


@dataclass(frozen=True, eq=False)
class Featurizer:
    """How a checkpoint sees towers: which graph, which way its messages go, and how its numbers are scaled."""

    spec: GraphSpec
    flow: Flow
    attributes: bool
    normalisation: Normalisation

    def to(self, device: str | torch.device) -> "Featurizer":
        return replace(self, normalisation=self.normalisation.to(device))

    @property
    def attribute_width(self) -> int:
        return attribute_width(self.spec) if self.attributes else 0

    @property
    def edge_width(self) -> int:
        """Numbers an edge: its direction, and the attributes."""
        return 1 + self.attribute_width

    def graphs(
        self,
        node: Float[Tensor, "*sample node feature"],
        upper: Int[Tensor, " edge"],
        lower: Int[Tensor, " edge"],
        target: Int[Tensor, " graph"],
        action: Float[Tensor, "graph 3"] | None = None,
        graph: Int[Tensor, " node"] | None = None,
        lag: Float[Tensor, "graph 3"] | None = None,
    ) -> Graphs:
        """Normalise raw node features (SI) and actions [m], and derive edges; see `Graphs` for the two forms."""
        n = self.normalisation
        edge_index = directed(self.flow, upper, lower)
        return Graphs(
            node=(node - n.node_mean) / n.node_scale,
            edge_index=edge_index,
            edge=self.messages(self.attributes_of(node, upper, lower)),
            target=target,
            action=None if action is None or not self.spec.action else (action - n.action_mean) / n.action_scale,
            graph=graph,
            lag=lag,
        )

    def attributes_of(
        self,
        node: Float[Tensor, "*sample node feature"],
        upper: Int[Tensor, " edge"],
        lower: Int[Tensor, " edge"],
    ) -> Float[Tensor, "*#sample edge attribute"]:
        """Normalised attributes of edges, from raw node features; none wide where the graph has none."""
        if self.attribute_width == 0:
            return node.new_zeros(len(upper), 0)
        n = self.normalisation
        return (edge_attributes(self.spec, node, upper, lower) - n.edge_mean) / n.edge_scale

    def messages(self, known: Float[Tensor, "*sample edge attribute"]) -> Float[Tensor, "*sample message _"]:
        """Attributes behind the direction of each message (1 down, -1 up), in the order of `directed`."""
        signs = {"down": (1.0,), "up": (-1.0,), "both": (1.0, -1.0)}[self.flow]
        *sample, edges, width = known.shape
        out = known.new_empty(*sample, len(signs) * edges, 1 + width)
        for way, sign in enumerate(signs):
            part = out[..., way * edges : (way + 1) * edges, :]
            part[..., 0], part[..., 1:] = sign, known
        return out


def directed(flow: Flow, upper: Int[Tensor, " edge"], lower: Int[Tensor, " edge"]) -> Int[Tensor, "2 message"]:
    """The ways that messages go: all downward ones, all upward ones, or the first and then the second."""
    down = torch.stack([upper, lower])
    up = down.flip(0)
    return {"down": down, "up": up, "both": torch.cat([down, up], dim=1)}[flow]
