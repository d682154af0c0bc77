"""Footprints, gaps and rotations of boxes, for any number of towers at once.

Every function takes poses with leading batch axes, so that the converter (one tower), the controller (100
sampled towers) and the checks (a whole episode) share it.
"""

import numpy as np
from jaxtyping import Bool, Float

_NO_SHADOW = 1e-9
"""An edge that is shorter seen from above [m] stands upright and has no direction."""


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


def footprint_overlap(
    pose: Float[np.ndarray, "*batch block 7"], size: Float[np.ndarray, "*#batch block 3"]
) -> Float[np.ndarray, "*batch block block"]:
    """How deep the footprints of each two boxes overlap [m], negative where they are apart.

    A footprint is the box's shadow on the table: the sum of the shadows of its three edges, so that it reaches
    sum_k |edge_k . n| / 2 from its centre in direction n. The depth is the least overlap over the directions across
    an edge of either (separating axes): symmetric, and positive exactly where the footprints intersect.
    """
    reach = np.swapaxes(rotation_matrices(pose[..., 3:]), -1, -2)[..., :2] * size[..., None] / 2  # (..., i, edge, xy)
    length = np.linalg.norm(reach, axis=-1)
    across = np.stack([-reach[..., 1], reach[..., 0]], axis=-1) / np.maximum(length, _NO_SHADOW)[..., None]
    *batch, count, _ = length.shape
    rows = across.reshape(*batch, 3 * count, 2)
    extent = np.abs(rows @ np.swapaxes(reach.reshape(rows.shape), -1, -2)).reshape(*batch, count, 3, count, 3).sum(-1)
    centre = (rows @ np.swapaxes(pose[..., :2], -1, -2)).reshape(*batch, count, 3, count)  # (..., i, edge, j)
    own_extent = np.abs(across @ np.swapaxes(reach, -1, -2)).sum(-1)[..., None]
    own_centre = across @ pose[..., :2, None]
    overlap = np.minimum(own_extent + extent - np.abs(own_centre - centre), 2 * np.minimum(own_extent, extent))
    one_way = np.where(length[..., None] > _NO_SHADOW, overlap, np.inf).min(-2)  # over the edges of i
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
