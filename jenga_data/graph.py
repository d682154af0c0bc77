"""The truth about graphs: which blocks carry which, and what a node of the paper's graphs holds.

The converter (a logged tower), the controller (a live or predicted tower) and a real tower's poses all go
through `support_edges`, so a model is used on the graphs it was trained on.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from jenga_data.errors import JengaError
from jenga_data.geometry import footprint_overlap, vertical_gap

MAX_GAP = 1.0e-3
"""A block counts as right above another up to this gap [m]: block heights spread by 0.175 mm, so that a
loose block hangs over its neighbour by a few tenths of a millimetre, while a block's height is 15 mm."""
MAX_SINK = 5.0e-3
"""...and down to this overlap in height [m], a third of a block, so that a tilted pair stays a pair."""
MIN_OVERLAP = 1.0e-3
"""Footprints must overlap by so much [m]: side faces that touch carry nothing."""


def support_matrix(
    pose: Float[np.ndarray, "*batch block 7"], size: Float[np.ndarray, "block 3"]
) -> Bool[np.ndarray, "*batch block block"]:
    """`[..., u, l]` is true where block u lies right above block l, from poses and sizes alone."""
    gap = vertical_gap(pose, size)
    near = (gap < MAX_GAP) & (gap > -MAX_SINK)
    return near & (footprint_overlap(pose, size) > MIN_OVERLAP)


def support_edges(pose: Float[np.ndarray, "block 7"], size: Float[np.ndarray, "block 3"]) -> Int[np.ndarray, "2 edge"]:
    """Directed edges of one tower: row 0 the upper block, row 1 the block right below it (paper, section II-B).

    Sorted by upper, then lower block, so that the same tower always gives the same list.
    """
    return np.stack(np.nonzero(support_matrix(pose, size))).astype(np.int64)


@dataclass(frozen=True)
class GraphSpec:
    """Which columns of a dataset make a graph: per-node features in order, and whether the action is appended."""

    name: str
    node_features: tuple[str, ...]
    action: bool = False

    def __post_init__(self) -> None:
        unknown = [f for f in self.node_features if f not in FEATURE_WIDTH]
        if unknown:
            raise JengaError(f"unknown node features {unknown}; allowed: {', '.join(FEATURE_WIDTH)}")

    @property
    def node_width(self) -> int:
        """Numbers a node, the action not counted."""
        return sum(FEATURE_WIDTH[f] for f in self.node_features)


FEATURE_WIDTH: dict[str, int] = {
    "block_size": 3,
    "block_mass": 1,
    "target_flag": 1,
    "block_pose": 7,
    "level": 1,
    "slot": 3,
    "orientation": 1,
}
"""Node features by the name of their column and how many numbers each has; `slot` is one-hot."""

GRAPHS: dict[str, GraphSpec] = {
    spec.name: spec
    for spec in (
        GraphSpec("G_s", ("block_size", "block_mass", "target_flag")),
        GraphSpec("G_sp", ("block_size", "block_mass", "target_flag", "block_pose")),
        GraphSpec("G_s+layout", ("block_size", "block_mass", "target_flag", "level", "slot", "orientation")),
        GraphSpec("G_e", ("block_mass", "target_flag", "block_pose"), action=True),
    )
}
"""The graphs of the paper (section II-B, II-C), and G_s with the layout, which tells a middle block from a side one."""


def graph_spec(name: str) -> GraphSpec:
    """Look a graph up by name.

    Raises:
        JengaError: there is no graph of that name.
    """
    if name not in GRAPHS:
        raise JengaError(f"unknown graph {name!r}; allowed: {', '.join(GRAPHS)}")
    return GRAPHS[name]


def node_features(
    spec: GraphSpec,
    *,
    block_size: Float[np.ndarray, "*batch block 3"],
    block_mass: Float[np.ndarray, "*batch block"],
    block_pose: Float[np.ndarray, "*batch block 7"],
    level: Int[np.ndarray, "*batch block"],
    slot: Int[np.ndarray, "*batch block"],
    target: Int[np.ndarray, "*batch"],
) -> Float[np.ndarray, "*batch block feature"]:
    """Node features of any number of towers, raw (SI, not normalised), in the order of `spec.node_features`."""
    count = block_mass.shape[-1]
    columns: dict[str, np.ndarray] = {
        "block_size": block_size,
        "block_mass": block_mass[..., None],
        "block_pose": block_pose,
        "target_flag": (np.arange(count) == np.asarray(target)[..., None]).astype(float)[..., None],
        "level": level[..., None].astype(float),
        "slot": (slot[..., None] == np.arange(3)).astype(float),
        "orientation": (level % 2)[..., None].astype(float),
    }
    return np.concatenate([columns[name] for name in spec.node_features], axis=-1)
