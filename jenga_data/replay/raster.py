"""A z-buffer in numpy: which face of which box a camera sees at each pixel, without OpenGL or Vulkan.

A camera maps points to image coordinates u (right), v (up) and a *nearness* that is affine over any plane in the
image: 1 / depth in perspective, minus the depth in a parallel projection. So a face needs one comparison a pixel,
and boxes that touch or cut into each other come out right, which sorting their faces does not.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from jenga_data.geometry import rotation_matrices

NOTHING = -1
"""Index of the face at a pixel where there is none."""

_SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
_FACES = np.array([[1, 3, 2, 0], [4, 6, 7, 5], [0, 4, 5, 1], [3, 7, 6, 2], [2, 6, 4, 0], [1, 5, 7, 3]])
"""Corners of the faces -x, +x, -y, +y, -z, +z, counterclockwise seen from outside."""
FACE_NORMALS = np.repeat(np.eye(3), 2, axis=0) * np.tile([-1.0, 1.0], 3)[:, None]


@dataclass(frozen=True, eq=False)
class Camera:
    """A view of the world: `axes` are its right, up and forward directions, `window` what it frames.

    `distance` is that from the eye to the point looked at [m], infinite for a parallel projection. Image
    coordinates are metres in the plane through that point, so `window` is u low, u high, v low, v high [m].
    """

    look_at: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]
    distance: float
    window: tuple[float, float, float, float]

    @classmethod
    def fitting(
        cls,
        points: Float[np.ndarray, "point 3"],
        azimuth: float,
        elevation: float,
        aspect: float | None = None,
        distance: float = 1.6,
        margin: float = 0.04,
    ) -> "Camera":
        """Look at all `points` from a direction, with the smallest window of the given aspect that holds them.

        Args:
            azimuth: where the eye stands, from +x towards +y [rad].
            elevation: how high above the horizon it stands [rad].
            aspect: width over height of the picture; None takes that of the points.
            distance: from the eye to the middle of the points [m]; infinite for a parallel projection.
            margin: free border, as a part of the window.
        """
        forward = -np.array(
            [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
        )
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        axes = np.stack([right, np.cross(right, forward), forward])
        camera = cls((points.min(axis=0) + points.max(axis=0)) / 2, axes, distance, (0.0, 0.0, 0.0, 0.0))
        uv = camera.project(points)[:, :2]
        low, high = uv.min(axis=0), uv.max(axis=0)
        span = (high - low) * (1 + 2 * margin)
        if aspect is not None:
            span = np.maximum(span, [span[1] * aspect, span[0] / aspect])
        low, high = (low + high - span) / 2, (low + high + span) / 2
        return cls(camera.look_at, axes, distance, (float(low[0]), float(high[0]), float(low[1]), float(high[1])))

    @property
    def aspect(self) -> float:
        """Width over height of the window."""
        return (self.window[1] - self.window[0]) / (self.window[3] - self.window[2])

    def project(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Image coordinates u, v [m] and nearness of points in the world."""
        right, up, forward = self.axes
        offset = points - self.look_at
        u, v, depth = (
            offset[..., 0] * a[0] + offset[..., 1] * a[1] + offset[..., 2] * a[2] for a in (right, up, forward)
        )
        if np.isinf(self.distance):
            return np.stack([u, v, -depth], axis=-1)
        nearness = 1 / (self.distance + depth)
        return np.stack([u * self.distance * nearness, v * self.distance * nearness, nearness], axis=-1)

    def unproject(self, image: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """The inverse of `project`."""
        u, v, nearness = image[..., 0], image[..., 1], image[..., 2]
        if np.isinf(self.distance):
            depth, scale = -nearness, np.ones_like(nearness)
        else:
            depth, scale = 1 / nearness - self.distance, 1 / (nearness * self.distance)
        right, up, forward = self.axes
        u, v = u * scale, v * scale
        return np.stack([self.look_at[i] + u * right[i] + v * up[i] + depth * forward[i] for i in range(3)], axis=-1)

    def depth(self, nearness: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
        """Distance along the view [m], infinite where nothing was hit."""
        if np.isinf(self.distance):
            return -nearness
        return np.where(nearness > 0, 1 / np.where(nearness > 0, nearness, 1.0), np.inf)

    def nearness_of_height(self, v: Float[np.ndarray, "*batch"], z: float) -> Float[np.ndarray, "*batch"]:
        """Nearness of the horizontal plane at height z, which depends on v alone; NaN above the horizon."""
        up, forward = self.axes[1, 2], self.axes[2, 2]
        below = z - self.look_at[2]
        if np.isinf(self.distance):
            return (v * up - below) / forward
        nearness = (v * up / self.distance + forward) / (below + self.distance * forward)
        return np.where(nearness > 0, nearness, np.nan)

    def pixel_grid(self, width: int, height: int) -> tuple[Float[np.ndarray, " width"], Float[np.ndarray, " height"]]:
        """u of each column and v of each row, rows from the top."""
        u0, u1, v0, v1 = self.window
        return u0 + (np.arange(width) + 0.5) * (u1 - u0) / width, v1 - (np.arange(height) + 0.5) * (v1 - v0) / height


def box_corners(
    pose: Float[np.ndarray, "*batch 7"], size: Float[np.ndarray, "*#batch 3"]
) -> Float[np.ndarray, "*batch 8 3"]:
    """The eight corners of each box in the world."""
    local = _SIGNS * np.asarray(size)[..., None, :] / 2
    return pose[..., None, :3] + np.einsum("...ij,...cj->...ci", rotation_matrices(pose[..., 3:]), local)


def box_faces(pose: Float[np.ndarray, "box 7"], size: Float[np.ndarray, "box 3"]) -> Float[np.ndarray, "face 4 3"]:
    """Corners of every face in the world; faces 6 i to 6 i + 5 are those of box i, in the order of `FACE_NORMALS`."""
    return box_corners(pose, size)[:, _FACES].reshape(-1, 4, 3)


def rasterise(
    faces: Float[np.ndarray, "face 4 3"], camera: Camera, width: int, height: int
) -> tuple[Int[np.ndarray, "height width"], Float[np.ndarray, "height width"]]:
    """The nearest face at each pixel, `NOTHING` where there is none, and its nearness.

    Args:
        faces: corners of convex quadrangles in the world, counterclockwise from the front; those
            that show their back are left out.
    """
    index = np.full((height, width), NOTHING, np.int32)
    nearest = np.full((height, width), -np.inf)
    u, v = camera.pixel_grid(width, height)
    for number, corner in enumerate(camera.project(faces)):
        edge = np.roll(corner, -1, axis=0) - corner
        area = edge[0, 0] * edge[1, 1] - edge[0, 1] * edge[1, 0]
        if area <= 0 or not np.isfinite(corner).all():
            continue
        columns = slice(np.searchsorted(u, corner[:, 0].min()), np.searchsorted(u, corner[:, 0].max(), side="right"))
        rows = slice(np.searchsorted(-v, -corner[:, 1].max()), np.searchsorted(-v, -corner[:, 1].min(), side="right"))
        if columns.start >= columns.stop or rows.start >= rows.stop:
            continue
        du, dv = u[columns], v[rows, None]
        inside = np.ones((rows.stop - rows.start, columns.stop - columns.start), bool)
        for (u0, v0, _), (eu, ev, _) in zip(corner, edge, strict=True):
            inside &= eu * (dv - v0) >= ev * (du - u0)
        slope = np.linalg.solve(edge[:2, :2], edge[:2, 2])
        nearness = corner[0, 2] + slope[0] * (du - corner[0, 0]) + slope[1] * (dv - corner[0, 1])
        hit = inside & (nearness > nearest[rows, columns])
        index[rows, columns][hit] = number
        nearest[rows, columns][hit] = nearness[hit]
    return index, nearest
