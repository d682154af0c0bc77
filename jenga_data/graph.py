"""The truth about graphs: which blocks carry which, and what their nodes hold.

The converter (a logged tower), the controller (a live or predicted tower) and a real tower's poses all go
through `support_edges`, so a model is used on the graphs it was trained on.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from jenga_data.geometry import footprint_overlap_of, vertical_gap
from jenga_data.graph_spec import GraphSpec

MAX_GAP = 1.0e-3
"""A block counts as right above another up to this gap [m]: block heights spread by 0.175 mm, so that a
loose block hangs over its neighbour by a few tenths of a millimetre, while a block's height is 15 mm."""
MAX_SINK = 5.0e-3
"""...and down to this overlap in height [m], a third of a block, so that a tilted pair stays a pair."""
MIN_OVERLAP = 1.0e-3
"""Footprints must overlap by so much [m]: side faces that touch carry nothing."""

_PAIRS_AT_ONCE = 2**17
"""Pairs of blocks that are looked at together: more do not fit into a processor's cache."""


def support_matrix(
    pose: Float[np.ndarray, "*batch block 7"], size: Float[np.ndarray, "*#batch block 3"]
) -> Bool[np.ndarray, "*batch block block"]:
    """`[..., u, l]` is true where block u lies right above block l, from poses and sizes alone."""
    gap = vertical_gap(pose, size)
    near = np.array((gap < MAX_GAP) & (gap > -MAX_SINK))
    # Of a tower's pairs one in twenty is near: only theirs are worth the price of an overlap.
    *batch, upper, lower = np.nonzero(near)
    near[near] = footprint_overlap_of(pose, size, (*batch, upper), (*batch, lower)) > MIN_OVERLAP
    return near


def support_edges(pose: Float[np.ndarray, "block 7"], size: Float[np.ndarray, "block 3"]) -> Int[np.ndarray, "2 edge"]:
    """Directed edges of one tower: row 0 the upper block, row 1 the block right below it (paper, section II-B).

    Sorted by upper, then lower block, so that the same tower always gives the same list.
    """
    return np.stack(np.nonzero(support_matrix(pose, size))).astype(np.int64)


def support_lists(
    pose: Float[np.ndarray, "frame block 7"], size: Float[np.ndarray, "frame block 3"]
) -> tuple[Int[np.ndarray, " frame_and_one"], Int[np.ndarray, " edge"], Int[np.ndarray, " edge"]]:
    """`support_edges` of many towers, or of moments of one: as offset, upper blocks and lower blocks.

    Number i has the edges `offset[i]` to `offset[i + 1]`.
    """
    frames, blocks, _ = pose.shape
    at_once = max(1, _PAIRS_AT_ONCE // max(blocks, 1) ** 2)
    parts = [slice(i, i + at_once) for i in range(0, frames, at_once)]
    found = [np.nonzero(support_matrix(pose[part], size[part])) for part in parts]
    count = [np.bincount(frame, minlength=min(at_once, frames - i * at_once)) for i, (frame, _, _) in enumerate(found)]
    none = np.zeros(0, np.int64)
    offset = np.concatenate([[0], np.cumsum(np.concatenate([none, *count]))])
    upper, lower = (np.concatenate([none, *(each[k] for each in found)]) for k in (1, 2))
    return offset, upper, lower


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
