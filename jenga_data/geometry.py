"""Footprints, gaps and rotations of boxes, for any number of towers at once.

Every function takes poses with leading batch axes, so that the converter (one tower), the controller (100
sampled towers) and the checks (a whole episode) share it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jenga_data.tower import turn_poses

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


def in_table_frame(
    pose: Float[np.ndarray, "frame block 7"], angle: Float[np.ndarray, " frame"]
) -> Float[np.ndarray, "frame block 7"]:
    """Poses as one sees them who turns with the turntable: rotated about the world's z by minus its angle [rad].

    What stands on the turntable keeps its place here while the turntable turns. Signs of quaternions are those of
    `turn_poses`; positions are exactly those of the world where the angle is 0.
    """
    return turn_poses(pose, -angle[:, None])


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
    shadow = _Shadows.of(pose, size)
    one_way = shadow.overlap_across_own_edges(shadow)
    return np.minimum(one_way, np.swapaxes(one_way, -1, -2))


def footprint_overlap_of(
    pose: Float[np.ndarray, "*batch block 7"],
    size: Float[np.ndarray, "*#batch block 3"],
    first: tuple[Int[np.ndarray, " pair"], ...],
    second: tuple[Int[np.ndarray, " pair"], ...],
) -> Float[np.ndarray, " pair"]:
    """`footprint_overlap` of some pairs alone: of the blocks at the indices `first` and `second` of (*batch, block)."""
    every = _Shadows.of(pose, size)
    a, b = every.at(first), every.at(second)
    return np.minimum(a.overlap_across_own_edges(b), b.overlap_across_own_edges(a))[:, 0, 0]


class _Shadows(NamedTuple):
    """Boxes seen from above."""

    centre: Float[np.ndarray, "*batch block 2"]
    reach: Float[np.ndarray, "*batch block 3 2"]
    """Half of each edge's shadow."""
    across: Float[np.ndarray, "*batch block 3 2"]
    """Unit vector across each edge."""
    upright: Bool[np.ndarray, "*batch block 3"]

    @classmethod
    def of(cls, pose: Float[np.ndarray, "*batch block 7"], size: Float[np.ndarray, "*#batch block 3"]) -> "_Shadows":
        reach = np.swapaxes(rotation_matrices(pose[..., 3:]), -1, -2)[..., :2] * size[..., None] / 2
        length = np.linalg.norm(reach, axis=-1)
        across = np.stack([-reach[..., 1], reach[..., 0]], axis=-1) / np.maximum(length, _NO_SHADOW)[..., None]
        return cls(pose[..., :2], reach, across, length <= _NO_SHADOW)

    def block(self, index: int) -> "_Shadows":
        one = slice(index, index + 1) if index != -1 else slice(index, None)
        return _Shadows(
            self.centre[..., one, :], self.reach[..., one, :, :], self.across[..., one, :, :], self.upright[..., one, :]
        )

    def at(self, index: tuple[Int[np.ndarray, " pair"], ...]) -> "_Shadows":
        """One block a batch."""
        return _Shadows(*(part[index][:, None] for part in self))

    def overlap_across_own_edges(self, other: "_Shadows") -> Float[np.ndarray, "*batch block other"]:
        """Least overlap with each of the others over the directions across one's own edges."""
        *batch, count, _ = self.upright.shape
        rows = self.across.reshape(*batch, 3 * count, 2)
        others = other.upright.shape[-2]
        sides = np.swapaxes(other.reach.reshape(*batch, 3 * others, 2), -1, -2)
        extent = np.abs(rows @ sides).reshape(*batch, count, 3, others, 3).sum(-1)
        centre = (rows @ np.swapaxes(other.centre, -1, -2)).reshape(*batch, count, 3, others)  # (..., i, edge, j)
        own_extent = np.abs(self.across @ np.swapaxes(self.reach, -1, -2)).sum(-1)[..., None]
        own_centre = self.across @ self.centre[..., None]
        overlap = np.minimum(own_extent + extent - np.abs(own_centre - centre), 2 * np.minimum(own_extent, extent))
        return np.where(self.upright[..., None], np.inf, overlap).min(-2)


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
    every = _Shadows.of(pose, size)
    alone = every.block(target)
    across_own = alone.overlap_across_own_edges(every)[..., 0, :]
    across_theirs = every.overlap_across_own_edges(alone)[..., 0]
    overlap = np.minimum(across_own, across_theirs)
    return np.asarray((np.delete(overlap, target, axis=-1) <= 0).all(-1))
