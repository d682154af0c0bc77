"""What pictures are made of: quadrangles with a colour, from boxes and from a robot's primitives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from jenga_data.episode import RobotModel, Solid
from jenga_data.geometry import rotation_matrices
from jenga_data.replay.raster import box_corners, box_faces

_END_GRAIN = 0.93
"""The ends of a block are a little darker than its sides."""
_AROUND = 24
"""Faces around a cylinder: even, so that its ends fall into quadrangles."""
_RINGS = 4
"""Rows of faces from the equator of a sphere to its pole."""


@dataclass(frozen=True, eq=False)
class Faces:
    """Convex quadrangles in the world, counterclockwise seen from outside; a triangle has its last corner twice.

    `colour` is sRGB in [0, 1], `patch` the number of the smooth surface that a face is part of: edges are drawn
    between patches only.
    """

    corner: Float[np.ndarray, "face 4 3"]
    colour: Float[np.ndarray, "face 3"]
    patch: Int[np.ndarray, " face"]

    def corners(self) -> Float[np.ndarray, "point 3"]:
        """Corners of all faces, those that are not finite left out."""
        corners = self.corner.reshape(-1, 3)
        return corners[np.isfinite(corners).all(axis=1)]

    def normals(self) -> Float[np.ndarray, "face 3"]:
        """Unit vectors that point out of each face."""
        with np.errstate(invalid="ignore"):  # faces that are not finite are not drawn
            diagonal = self.corner[:, 2:] - self.corner[:, :2]
            normal = np.cross(diagonal[:, 0], diagonal[:, 1])
            return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)

    @classmethod
    def joined(cls, parts: Sequence["Faces"]) -> "Faces":
        """All faces of several groups, in order; a patch stays in its group."""
        first = np.cumsum([0, *(int(part.patch.max(initial=-1)) + 1 for part in parts)])
        return cls(
            np.concatenate([part.corner for part in parts]),
            np.concatenate([part.colour for part in parts]),
            np.concatenate([part.patch + start for part, start in zip(parts, first, strict=False)]),
        )


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

    def faces(self) -> Faces:
        """Six faces a box, in the order of `raster.FACE_NORMALS`."""
        shade = np.tile([_END_GRAIN, _END_GRAIN, 1.0, 1.0, 1.0, 1.0], len(self.pose))
        colour = np.repeat(self.colour, 6, axis=0) * shade[:, None]
        return Faces(box_faces(self.pose, self.size), colour, np.arange(6 * len(self.pose)))


def robot_faces(model: RobotModel, link_pose: Float[np.ndarray, "link 7"]) -> Faces:
    """A robot's solids with its links at these poses in the world; opacities are left out."""
    none = Faces(np.zeros((0, 4, 3)), np.zeros((0, 3)), np.zeros(0, np.int64))
    links = zip(model.links, rotation_matrices(link_pose[:, 3:]), link_pose[:, :3], strict=True)
    return Faces.joined([none, *(_moved(solid, turn, at) for link, turn, at in links for solid in link.solids)])


def solid_bounds(
    model: RobotModel, link_pose: Float[np.ndarray, "frame link 7"]
) -> tuple[Float[np.ndarray, "frame solid 3"], Float[np.ndarray, "frame solid 3"]]:
    """Low and high corner of the bounding box of each solid of all links, in order, in the world."""
    turn, middle, reach = rotation_matrices(link_pose[..., 3:]), [], []
    for number, link in enumerate(model.links):
        for solid in link.solids:
            own = np.array(solid.pose)
            middle.append(link_pose[:, number, :3] + turn[:, number] @ own[:3])
            reach.append(_reach(solid, turn[:, number] @ rotation_matrices(own[3:])))
    shape = (len(link_pose), len(middle), 3)
    centre, half = (np.array(rows).reshape(shape[1], shape[0], 3).swapaxes(0, 1) for rows in (middle, reach))
    return centre - half, centre + half


def _reach(solid: Solid, turn: Float[np.ndarray, "frame 3 3"]) -> Float[np.ndarray, "frame 3"]:
    """How far a solid that is turned so reaches from its centre along x, y and z."""
    radius, length, _ = solid.size
    if solid.shape == "box":
        return (np.abs(turn) * np.array(solid.size)).sum(axis=-1) / 2
    along = np.abs(turn[..., 2])
    across = np.sqrt(np.maximum(1.0 - along**2, 0.0)) if solid.shape == "cylinder" else 1.0
    return along * length / 2 + radius * across


def _moved(solid: Solid, turn: Float[np.ndarray, "3 3"], at: Float[np.ndarray, "3"]) -> Faces:
    corner, patch = solid_quads(solid.shape, solid.size)
    own = np.array(solid.pose)
    in_link = corner @ rotation_matrices(own[3:]).T + own[:3]
    return Faces(in_link @ turn.T + at, np.tile(solid.color[:3], (len(patch), 1)), patch)


def solid_quads(
    shape: str, size: tuple[float, float, float]
) -> tuple[Float[np.ndarray, "face 4 3"], Int[np.ndarray, " face"]]:
    """Faces of a primitive (see `episode.Solid`) in its own frame, and the patch of each.

    A round surface is one patch of flat faces with their corners on it.

    Raises:
        ValueError: there is no such shape.
    """
    radius, length, _ = size
    if shape == "box":
        return box_faces(np.eye(7)[3:4], np.array([size], np.float64)), np.arange(6)
    if shape == "cylinder":
        ends = np.array([[radius, -length / 2], [radius, length / 2]])
        side, top = _turned(ends), _disc(radius, length / 2)
        bottom = top[:, ::-1] * np.array([1.0, 1.0, -1.0])
        return np.concatenate([side, top, bottom]), np.repeat([0, 1, 2], [len(side), len(top), len(bottom)])
    if shape in ("sphere", "capsule"):
        half = length / 2 if shape == "capsule" else 0.0
        angle = np.linspace(0.0, np.pi / 2, _RINGS + 1)
        upper = np.stack([radius * np.cos(angle), half + radius * np.sin(angle)], axis=1)
        upper[-1, 0] = 0.0
        lower = upper[::-1] * np.array([1.0, -1.0])
        side = _turned(np.concatenate([lower, upper if half else upper[1:]]))
        return side, np.zeros(len(side), np.int64)
    raise ValueError(f"no solid has the shape {shape!r}")


def _ring() -> Float[np.ndarray, "corner 2"]:
    angle = np.linspace(0.0, 2 * np.pi, _AROUND + 1)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _turned(profile: Float[np.ndarray, "corner 2"]) -> Float[np.ndarray, "face 4 3"]:
    """The surface that a line of (distance from the axis, height), from low to high, makes when turned about z."""
    ring = _ring()
    points = np.concatenate(
        [profile[:, None, :1] * ring, np.broadcast_to(profile[:, None, 1:], (len(profile), len(ring), 1))], axis=2
    )
    quads = np.stack([points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]], axis=2).reshape(-1, 4, 3)
    # At the lower pole the first two corners are one: put last, where the rasteriser allows it.
    at_pole = np.linalg.norm(quads[:, 0] - quads[:, 1], axis=1) == 0
    quads[at_pole] = np.roll(quads[at_pole], 2, axis=1)
    return quads


def _disc(radius: float, height: float) -> Float[np.ndarray, "face 4 3"]:
    """A flat end that is seen from above, in quadrangles that share a corner of the rim."""
    rim = np.concatenate([radius * _ring()[:-1], np.full((_AROUND, 1), height)], axis=1)
    return np.stack([rim[[0, k, k + 1, k + 2]] for k in range(1, _AROUND - 2, 2)])
