"""Footprints, gaps and rotations of boxes, for any number of towers at once.

Every function takes poses with leading batch axes, so that the converter (one tower), the controller (100
sampled towers) and the checks (a whole episode) share it.
"""

import numpy as np
from jaxtyping import Bool, Float


def rotation_matrices(quat: Float[np.ndarray, "*batch 4"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Rotation matrices of wxyz quaternions; columns are the body's axes in the world."""
    w, x, y, z = np.moveaxis(quat, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def half_height(
    pose: Float[np.ndarray, "*batch 7"], size: Float[np.ndarray, "*#batch 3"]
) -> Float[np.ndarray, "*batch"]:
    """Half the vertical extent of each box as it lies in the world [m]."""
    return (np.abs(rotation_matrices(pose[..., 3:])[..., 2, :]) * size).sum(-1) / 2


def footprint_corners(
    pose: Float[np.ndarray, "*batch 7"], size: Float[np.ndarray, "*#batch 3"]
) -> Float[np.ndarray, "*batch 4 2"]:
    """Corners of the rectangle that a box covers on the table, in order around it.

    The rectangle lies along the horizontal direction of the box's longest horizontal axis and covers the
    projection of the whole box: exact for a box that lies flat, slightly large for a tilted one.
    """
    axes = np.swapaxes(rotation_matrices(pose[..., 3:]), -1, -2)[..., :2]  # (..., body axis, xy)
    reach = axes * size[..., None] / 2
    longest = np.argmax(np.linalg.norm(reach, axis=-1), axis=-1)
    along = np.take_along_axis(reach, longest[..., None, None], axis=-2)[..., 0, :]
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    half_along = np.abs((reach * along[..., None, :]).sum(-1)).sum(-1)[..., None] * along
    half_across = np.abs((reach * across[..., None, :]).sum(-1)).sum(-1)[..., None] * across
    centre = pose[..., :2]
    corners = [half_along + half_across, half_along - half_across]
    corners += [-corner for corner in corners]
    return np.stack([centre + corner for corner in corners], axis=-2)


def footprint_overlap(
    pose: Float[np.ndarray, "*batch block 7"], size: Float[np.ndarray, "*#batch block 3"]
) -> Float[np.ndarray, "*batch block block"]:
    """How deep the footprints of each two boxes overlap [m], negative where they are apart.

    The depth is the smallest overlap of the two rectangles' shadows over their four edge directions
    (separating axes), so it is symmetric and positive exactly where the rectangles intersect.
    """
    corners = footprint_corners(pose, size)  # (..., block, 4, 2)
    edges = np.stack([corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 1, :]], axis=-2)
    axes = edges / np.linalg.norm(edges, axis=-1, keepdims=True)  # (..., block, 2, 2)
    # Shadow of every box j on every axis of every box i: (..., i, axis, j, corner)
    shadow = np.einsum("...iad,...jcd->...iajc", axes, corners)
    low, high = shadow.min(-1), shadow.max(-1)  # (..., i, axis, j)
    own = np.arange(corners.shape[-3])
    own_low, own_high = low[..., own, :, own], high[..., own, :, own]  # numpy puts the index axis first
    own_low, own_high = np.moveaxis(own_low, 0, -2), np.moveaxis(own_high, 0, -2)  # (..., i, axis)
    overlap = np.minimum(own_high[..., None], high) - np.maximum(own_low[..., None], low)
    one_way = overlap.min(-2)  # over the two axes of i
    return np.minimum(one_way, np.swapaxes(one_way, -1, -2))


def vertical_gap(
    pose: Float[np.ndarray, "*batch block 7"], size: Float[np.ndarray, "*#batch block 3"]
) -> Float[np.ndarray, "*batch block block"]:
    """Bottom of box i minus top of box j [m] at their centres, negative where they sink into each other."""
    half = half_height(pose, size)
    return (pose[..., 2] - half)[..., :, None] - (pose[..., 2] + half)[..., None, :]


def clear_of_others(
    pose: Float[np.ndarray, "*batch block 7"], size: Float[np.ndarray, "block 3"], target: int
) -> Bool[np.ndarray, "*batch"]:
    """Whether no other block's footprint overlaps the target's: nothing can rest on it or carry it."""
    overlap = footprint_overlap(pose, size)[..., target, :]
    return np.asarray((np.delete(overlap, target, axis=-1) <= 0).all(-1))
