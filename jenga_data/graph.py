"""The truth about graphs: which blocks carry which, and what their nodes hold.

The converter (a logged tower), the controller (a live or predicted tower) and a real tower's poses all go
through `support_edges`, so a model is used on the graphs it was trained on.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from jenga_data.geometry import footprint_overlap, vertical_gap
from jenga_data.graph_spec import GraphSpec

MAX_GAP = 1.0e-3
"""A block counts as right above another up to this gap [m]: block heights spread by 0.175 mm, so that a
loose block hangs over its neighbour by a few tenths of a millimetre, while a block's height is 15 mm."""
MAX_SINK = 5.0e-3
"""...and down to this overlap in height [m], a third of a block, so that a tilted pair stays a pair."""
MIN_OVERLAP = 1.0e-3
"""Footprints must overlap by so much [m]: side faces that touch carry nothing."""


def support_matrix(
    pose: Float[np.ndarray, "*batch block 7"], size: Float[np.ndarray, "*#batch block 3"]
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


def node_features(
    spec: GraphSpec,
    *,
    block_size: Float[np.ndarray, "*batch block 3"],
    block_mass: Float[np.ndarray, "*batch block"],
    block_pose: Float[np.ndarray, "*batch block 7"],
    level: Int[np.ndarray, "*batch block"],
    slot: Int[np.ndarray, "*batch block"],
    target: Int[np.ndarray, "*batch"],
    block_twist: Float[np.ndarray, "*batch block 6"] | None = None,
) -> Float[np.ndarray, "*batch block feature"]:
    """Node features of any number of towers, raw (SI, not normalised), in the order of `spec.node_features`.

    Without `block_twist` the tower is at rest.
    """
    count = block_mass.shape[-1]
    columns: dict[str, np.ndarray] = {
        "block_size": block_size,
        "block_mass": block_mass[..., None],
        "block_pose": block_pose,
        "block_twist": np.zeros((*block_mass.shape, 6)) if block_twist is None else block_twist,
        "target_flag": (np.arange(count) == np.asarray(target)[..., None]).astype(float)[..., None],
        "level": level[..., None].astype(float),
        "slot": (slot[..., None] == np.arange(3)).astype(float),
        "orientation": (level % 2)[..., None].astype(float),
    }
    return np.concatenate([columns[name] for name in spec.node_features], axis=-1)
