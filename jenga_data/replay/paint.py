"""Boxes on a turntable as a picture: light, soft shadows, drawn edges, and translucent ghosts.

Everything is rendered at twice the resolution and averaged down, so that edges are smooth.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import gaussian_filter, map_coordinates

from jenga_data.geometry import rotation_matrices
from jenga_data.palette import PAPER, TABLE
from jenga_data.replay.raster import FACE_NORMALS, NOTHING, Camera, box_corners, box_faces, rasterise

SAMPLES = 2
"""Rendered pixels to a pixel of the picture, along each side."""
TURNTABLE_RADIUS = 0.12
TABLE_DEPTH = 0.010
"""The turntable's top is at z = 0, the table below it by so much [m]."""

_LIGHT = np.array([-0.50, -0.62, 1.15]) / np.linalg.norm([-0.50, -0.62, 1.15])
"""Towards the light: above, and from the side that the pull goes to."""
_AMBIENT, _DIFFUSE = 0.66, 0.41
_END_GRAIN = 0.93
"""The ends of a block are a little darker than its sides."""
_SHADOW_ON_BLOCKS, _SHADOW_ON_TABLE = 0.40, 0.30
_SHADOW_CELL = 0.001
"""Resolution of the shadows [m]."""
_LIFT, _BIAS = 0.0015, 0.0005
"""A face does not shade itself: its points are lifted off it, and what hides the light is nearer to it by more [m]."""
_SOFT = 0.005
"""Blur of the shadows on the table [m]."""
_FADE = 0.025
"""Shadows on the table fade out within so much of a picture's sides [m]: none is cut off by the next picture."""
_REACH = 1.0
"""What is farther from the turntable casts no shadow [m]: where physics broke, a block may be a kilometre away."""
_EDGE = 0.50
"""Brightness of a drawn edge against its face."""
_GHOST_ALPHA = 0.50
_GHOST_TIE = 0.0004
"""A ghost's faces win against the truth only if nearer by more [m]: where the two agree, the truth shows."""


@dataclass(frozen=True, eq=False)
class Boxes:
    """Any number of boxes in the world; `size` is full edge lengths [m], `colour` is sRGB in [0, 1]."""

    pose: Float[np.ndarray, "box 7"]
    size: Float[np.ndarray, "box 3"]
    colour: Float[np.ndarray, "box 3"]

    def corners(self) -> Float[np.ndarray, "point 3"]:
        """Corners of all boxes in the world, those of boxes without a finite pose left out."""
        corners = box_corners(self.pose, self.size).reshape(-1, 3)
        return corners[np.isfinite(corners).all(axis=1)]

    @classmethod
    def joined(cls, parts: Sequence["Boxes"]) -> "Boxes":
        """All boxes of several groups, in order."""
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("pose", "size", "colour")))


def paint(
    boxes: Boxes,
    ghosts: Sequence[Boxes],
    camera: Camera,
    width: int,
    height: int,
    table: float = TURNTABLE_RADIUS,
) -> Float[np.ndarray, "{height} {width} 3"]:
    """The picture, rows from the top, sRGB in [0, 1]. Boxes with a pose that is not finite are left out.

    Args:
        table: radius of the turntable [m].
    """
    fine_width, fine_height = width * SAMPLES, height * SAMPLES
    u, v = np.meshgrid(*camera.pixel_grid(fine_width, fine_height))
    sun = _Sun.over(boxes)
    face, nearness = rasterise(box_faces(boxes.pose, boxes.size), camera, fine_width, fine_height)
    hit = face != NOTHING
    image = np.empty((fine_height, fine_width, 3))
    image[~hit] = _table(sun, camera, u[~hit], v[~hit], table)
    normal = _face_normals(boxes)[face[hit]]
    points = camera.unproject(np.stack([u[hit], v[hit], nearness[hit]], axis=-1))
    light = _face_brightness(boxes)[face[hit]] * (1.0 - _SHADOW_ON_BLOCKS * sun.on_boxes(points + _LIFT * normal))
    image[hit] = np.clip(boxes.colour[face[hit] // len(FACE_NORMALS)] * light[:, None], 0.0, 1.0)
    image[_edges(face) & hit] *= _EDGE
    for ghost in ghosts:
        _blend(image, camera.depth(nearness), ghost, camera)
    return image.reshape(height, SAMPLES, width, SAMPLES, 3).mean(axis=(1, 3))


def _face_normals(boxes: Boxes) -> Float[np.ndarray, "face 3"]:
    return np.einsum("bij,fj->bfi", rotation_matrices(boxes.pose[:, 3:]), FACE_NORMALS).reshape(-1, 3)


def _face_brightness(boxes: Boxes) -> Float[np.ndarray, " face"]:
    brightness = _AMBIENT + _DIFFUSE * np.maximum(_face_normals(boxes) @ _LIGHT, 0.0).reshape(-1, 6)
    brightness[:, :2] *= _END_GRAIN
    return brightness.ravel()


def _table(
    sun: "_Sun", camera: Camera, u: Float[np.ndarray, " pixel"], v: Float[np.ndarray, " pixel"], radius: float
) -> Float[np.ndarray, "pixel 3"]:
    """Paper, the turntable as a disc with a rim, and the shadows on both; paper alone where it is seen from below."""
    image = np.tile(np.array(PAPER), (len(u), 1))
    if camera.axes[2, 2] >= 0:
        return image
    table, top = _on_plane(camera, u, v, -TABLE_DEPTH), _on_plane(camera, u, v, 0.0)
    rim, disc = (np.hypot(p[:, 0], p[:, 1]) < radius for p in (table, top))
    fade = np.clip(_to_border(camera, u) / _FADE, 0.0, 1.0)
    image *= 1.0 - _SHADOW_ON_TABLE * (fade * sun.on_table(table))[:, None]
    image[rim] = np.array(TABLE) * 0.7
    image[disc] = np.array(TABLE) * (1.0 - _SHADOW_ON_TABLE * sun.on_table(top[disc]))[:, None]
    return image


def _to_border(camera: Camera, u: Float[np.ndarray, " pixel"]) -> Float[np.ndarray, " pixel"]:
    """Distance to the nearer side of the picture [m]."""
    return np.minimum(u - camera.window[0], camera.window[1] - u)


def _on_plane(
    camera: Camera, u: Float[np.ndarray, " pixel"], v: Float[np.ndarray, " pixel"], z: float
) -> Float[np.ndarray, "pixel 3"]:
    """Where the ray through each pixel meets the horizontal plane at height z, NaN where it does not."""
    return camera.unproject(np.stack([u, v, camera.nearness_of_height(v, z)], axis=-1))


def _edges(face: Int[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels on either side of a border between two faces."""
    edges = np.zeros(face.shape, bool)
    across, down = face[:, 1:] != face[:, :-1], face[1:] != face[:-1]
    edges[:, 1:] |= across
    edges[:, :-1] |= across
    edges[1:] |= down
    edges[:-1] |= down
    return edges


def _blend(image: np.ndarray, depth: Float[np.ndarray, "h w"], ghost: Boxes, camera: Camera) -> None:
    """Draw translucent boxes over the picture, in place, where they are nearer to the eye than what is there."""
    face, nearness = rasterise(box_faces(ghost.pose, ghost.size), camera, *image.shape[1::-1])
    ghost_depth = camera.depth(nearness)
    hit = face != NOTHING
    faces, edges = hit & (ghost_depth < depth - _GHOST_TIE), hit & _edges(face) & (ghost_depth < depth + 2 * _GHOST_TIE)
    colour = ghost.colour[np.maximum(face, 0) // len(FACE_NORMALS)]
    image[faces] += _GHOST_ALPHA * (colour - image)[faces]
    image[edges] += 0.8 * (0.75 * colour - image)[edges]


@dataclass(frozen=True, eq=False)
class _Sun:
    """The scene as the light sees it, in a parallel projection: what is nearest to it, and how much it covers."""

    camera: Camera
    nearest: Float[np.ndarray, "h w"]
    cover: Float[np.ndarray, "h w"]

    @classmethod
    def over(cls, boxes: Boxes) -> "_Sun":
        azimuth, elevation = float(np.arctan2(_LIGHT[1], _LIGHT[0])), float(np.arcsin(_LIGHT[2]))
        corners = boxes.corners()
        near = corners[np.linalg.norm(corners, axis=1) < _REACH]
        near = np.concatenate([near, _REACH * np.array([[-0.1, 0.0, 0.0], [0.1, 0.0, 0.0]])])  # never an empty view
        camera = Camera.fitting(near, azimuth, elevation, distance=np.inf, margin=0.1)
        u0, u1, v0, v1 = camera.window
        width, height = int((u1 - u0) / _SHADOW_CELL), int((v1 - v0) / _SHADOW_CELL)
        face, nearest = rasterise(box_faces(boxes.pose, boxes.size), camera, width, height)
        cover = gaussian_filter((face != NOTHING).astype(float), _SOFT / _SHADOW_CELL)
        return cls(camera, nearest, cover)

    def _cells(self, points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "3 point"]:
        """Row and column in the shadow's grid, and the nearness to the light, of points in the world."""
        u0, u1, v0, v1 = self.camera.window
        height, width = self.nearest.shape
        u, v, nearness = self.camera.project(points).T
        return np.stack([(v1 - v) / (v1 - v0) * height - 0.5, (u - u0) / (u1 - u0) * width - 0.5, nearness])

    def on_table(self, points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, " point"]:
        """How much of the light is kept from points that lie below everything: what is in the way, blurred."""
        return map_coordinates(self.cover, np.nan_to_num(self._cells(points)[:2], nan=-9.0), order=1)

    def on_boxes(self, points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, " point"]:
        """The same for points on the boxes: what is nearer to the light, weighted over the four cells around each."""
        row, column, nearness = self._cells(points)
        height, width = self.nearest.shape
        top, left = np.floor(row).astype(np.int32), np.floor(column).astype(np.int32)
        down, across = row - top, column - left
        shadow = np.zeros(len(points))
        for r, row_weight in ((top, 1 - down), (top + 1, down)):
            for c, column_weight in ((left, 1 - across), (left + 1, across)):
                nearest = self.nearest[np.clip(r, 0, height - 1), np.clip(c, 0, width - 1)]
                shadow += row_weight * column_weight * (nearest > nearness + _BIAS)
        return shadow
