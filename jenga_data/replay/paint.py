"""Bodies on a turntable as a picture: light, soft shadows, drawn edges, and translucent ghosts.

Everything is rendered at twice the resolution and averaged down, so that edges are smooth.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import gaussian_filter, map_coordinates

from jenga_data.palette import PAPER, TABLE
from jenga_data.replay.raster import NOTHING, Camera, rasterise
from jenga_data.replay.solids import Boxes, Faces, solid_quads
from jenga_data.scenery import COLUMN_RADIUS, TABLE_TOP, TURNTABLE_HEIGHT, TURNTABLE_RADIUS

SAMPLES = 2
"""Rendered pixels to a pixel of the picture, along each side."""

_LIGHT = np.array([-0.50, -0.62, 1.15]) / np.linalg.norm([-0.50, -0.62, 1.15])
"""Towards the light: above, and from the side that the pull goes to."""
_AMBIENT, _DIFFUSE = 0.66, 0.41
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
_SHADE = 0.75
"""Brightness of the column, which stands in the turntable's shade."""
_GHOST_ALPHA = 0.50
_GHOST_TIE = 0.0004
"""A ghost's faces win against the truth only if nearer by more [m]: where the two agree, the truth shows."""


@dataclass(frozen=True)
class Stand:
    """What a tower stands on: a disc with its top at z = 0, and, where the paper lies deeper, a column below it."""

    radius: float
    """Of the disc [m]."""
    floor: float
    """Height of the paper, which stands for the table [m]."""

    def outline(self) -> Float[np.ndarray, "point 3"]:
        """Points around the disc and around the foot of what carries it."""
        around = np.linspace(0, 2 * np.pi, 48, endpoint=False)
        ring = np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
        foot = COLUMN_RADIUS * ring + np.array([0.0, 0.0, self.floor])
        return np.concatenate([self.radius * ring, foot]) if self.has_column else self.radius * ring

    @property
    def has_column(self) -> bool:
        return self.floor < -TURNTABLE_HEIGHT


TURNTABLE = Stand(TURNTABLE_RADIUS, TABLE_TOP)


def paint(
    faces: Faces,
    ghosts: Sequence[Boxes],
    camera: Camera,
    width: int,
    height: int,
    stand: Stand = TURNTABLE,
) -> Float[np.ndarray, "{height} {width} 3"]:
    """The picture, rows from the top, sRGB in [0, 1]. Faces with a corner that is not finite are left out."""
    fine_width, fine_height = width * SAMPLES, height * SAMPLES
    u, v = np.meshgrid(*camera.pixel_grid(fine_width, fine_height))
    sun = _Sun.over(faces)
    face, nearness = rasterise(faces.corner, camera, fine_width, fine_height)
    hit = face != NOTHING
    image = np.empty((fine_height, fine_width, 3))
    column = _column(camera, fine_width, fine_height, stand)
    image[~hit] = _ground(sun, camera, u[~hit], v[~hit], stand, column[~hit])
    normals = faces.normals()
    points = camera.unproject(np.stack([u[hit], v[hit], nearness[hit]], axis=-1))
    shadow = sun.on_faces(points + _LIFT * normals[face[hit]])
    light = _brightness(normals)[face[hit]] * (1.0 - _SHADOW_ON_BLOCKS * shadow)
    image[hit] = np.clip(faces.colour[face[hit]] * light[:, None], 0.0, 1.0)
    image[_edges(_patches(faces, face)) & hit] *= _EDGE
    for ghost in ghosts:
        _blend(image, camera.depth(nearness), ghost, camera)
    return image.reshape(height, SAMPLES, width, SAMPLES, 3).mean(axis=(1, 3))


def _patches(faces: Faces, face: Int[np.ndarray, "h w"]) -> Int[np.ndarray, "h w"]:
    """The patch at each pixel, `NOTHING` where there is no face."""
    return np.append(faces.patch, NOTHING)[face]


def _ground(
    sun: "_Sun",
    camera: Camera,
    u: Float[np.ndarray, " pixel"],
    v: Float[np.ndarray, " pixel"],
    stand: Stand,
    column: Float[np.ndarray, "pixel 3"],
) -> Float[np.ndarray, "pixel 3"]:
    """Paper, the disc with its rim on its column, and the shadows on them; paper alone where it is seen from below."""
    image = np.tile(np.array(PAPER), (len(u), 1))
    if camera.axes[2, 2] >= 0:
        return image
    floor, under, top = (_on_plane(camera, u, v, z) for z in (stand.floor, -TURNTABLE_HEIGHT, 0.0))
    fade = np.clip(_to_border(camera, u) / _FADE, 0.0, 1.0)
    shadow = np.maximum(sun.on_table(floor), _disc_shadow(floor, stand))
    image *= 1.0 - _SHADOW_ON_TABLE * (fade * shadow)[:, None]
    image = np.where(np.isnan(column), image, column)
    rim, disc = (np.hypot(p[:, 0], p[:, 1]) < stand.radius for p in (under, top))
    image[rim] = np.array(TABLE) * 0.7
    image[disc] = np.array(TABLE) * (1.0 - _SHADOW_ON_TABLE * sun.on_table(top[disc]))[:, None]
    return image


def _column(camera: Camera, width: int, height: int, stand: Stand) -> Float[np.ndarray, "h w 3"]:
    """The column in the disc's shade where it would be seen without the disc, NaN elsewhere."""
    image = np.full((height, width, 3), np.nan)
    if stand.has_column:
        corner, patch = solid_quads("cylinder", (COLUMN_RADIUS, -TURNTABLE_HEIGHT - stand.floor, 0.0))
        middle = np.array([0.0, 0.0, (stand.floor - TURNTABLE_HEIGHT) / 2])
        faces = Faces(corner + middle, np.tile(np.array(TABLE) * _SHADE, (len(patch), 1)), patch)
        face, _ = rasterise(faces.corner, camera, width, height)
        image[face != NOTHING] = (faces.colour * _brightness(faces.normals())[:, None])[face[face != NOTHING]]
    return image


def _brightness(normals: Float[np.ndarray, "face 3"]) -> Float[np.ndarray, " face"]:
    """Of each face in full light."""
    return _AMBIENT + _DIFFUSE * np.maximum(normals @ _LIGHT, 0.0)


def _disc_shadow(points: Float[np.ndarray, "point 3"], stand: Stand) -> Float[np.ndarray, " point"]:
    """How much of the light the disc keeps from points on the paper, blurred as the shadows of all else are."""
    along = points[:, :2] + _LIGHT[:2] / _LIGHT[2] * -stand.floor
    inside = (stand.radius - np.linalg.norm(along, axis=1)) / _SOFT
    return np.nan_to_num(np.clip(0.5 + inside / 3, 0.0, 1.0)) if stand.has_column else np.zeros(len(points))


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
    there = ghost.faces()
    face, nearness = rasterise(there.corner, camera, *image.shape[1::-1])
    ghost_depth = camera.depth(nearness)
    hit = face != NOTHING
    faces, edges = hit & (ghost_depth < depth - _GHOST_TIE), hit & _edges(face) & (ghost_depth < depth + 2 * _GHOST_TIE)
    colour = np.repeat(ghost.colour, 6, axis=0)[np.maximum(face, 0)]
    image[faces] += _GHOST_ALPHA * (colour - image)[faces]
    image[edges] += 0.8 * (0.75 * colour - image)[edges]


@dataclass(frozen=True, eq=False)
class _Sun:
    """The scene as the light sees it, in a parallel projection: what is nearest to it, and how much it covers."""

    camera: Camera
    nearest: Float[np.ndarray, "h w"]
    cover: Float[np.ndarray, "h w"]

    @classmethod
    def over(cls, faces: Faces) -> "_Sun":
        azimuth, elevation = float(np.arctan2(_LIGHT[1], _LIGHT[0])), float(np.arcsin(_LIGHT[2]))
        corners = faces.corners()
        near = corners[np.linalg.norm(corners, axis=1) < _REACH]
        near = np.concatenate([near, _REACH * np.array([[-0.1, 0.0, 0.0], [0.1, 0.0, 0.0]])])  # never an empty view
        camera = Camera.fitting(near, azimuth, elevation, distance=np.inf, margin=0.1)
        u0, u1, v0, v1 = camera.window
        width, height = int((u1 - u0) / _SHADOW_CELL), int((v1 - v0) / _SHADOW_CELL)
        face, nearest = rasterise(faces.corner, camera, width, height)
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

    def on_faces(self, points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, " point"]:
        """The same for points on the faces: what is nearer to the light, weighted over the four cells around each."""
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
