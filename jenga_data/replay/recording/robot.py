"""The robot: a transform a link, and below it what the link looks like."""

from collections.abc import Mapping

import numpy as np
import rerun as rr

from jenga_data.episode import Link, RobotModel, RobotTrack
from jenga_data.geometry import rotation_matrices
from jenga_data.replay.meshes import Mesh
from jenga_data.replay.recording.recorder import Recorder

SOLID = rr.components.FillMode.Solid


def log_robot(to: Recorder, model: RobotModel, track: RobotTrack, meshes: Mapping[str, Mesh]) -> None:
    """A transform a link over time, and below it its mesh, or what it is made of: an entity a kind of solid."""
    for number, link in enumerate(model.links):
        path = link_path(link)
        pose = track.link_pose[:, number].astype(np.float32)
        moves = rr.Transform3D.columns(translation=pose[:, :3], quaternion=pose[:, [4, 5, 6, 3]])
        to.columns(path, to.episode.time_ns, moves)
        if mesh := meshes.get(link.name):
            to.static(f"{path}/mesh", _mesh(mesh))
            continue
        for shape in shapes_of(link):
            to.static(f"{path}/{shape}", _solids(link, shape))


def _mesh(mesh: Mesh) -> rr.Mesh3D:
    colors = np.round(255 * mesh.color).astype(np.uint8)
    return rr.Mesh3D(vertex_positions=mesh.vertex, triangle_indices=mesh.triangle, vertex_colors=colors)


def link_path(link: Link) -> str:
    return "/world/robot/" + rr.escape_entity_path_part(link.name)


def shapes_of(link: Link) -> list[str]:
    """Every shape of its solids once."""
    return list(dict.fromkeys(solid.shape for solid in link.solids))


def _solids(link: Link, shape: str) -> rr.AsComponents:
    """All of a link's solids of one shape."""
    solids = [solid for solid in link.solids if solid.shape == shape]
    size, pose = np.array([solid.size for solid in solids]), np.array([solid.pose for solid in solids])
    colour = np.round(255 * np.array([solid.color for solid in solids])).astype(np.uint8)
    centre, turn = pose[:, :3], pose[:, [4, 5, 6, 3]]
    radii, lengths = size[:, 0], size[:, 1]
    match shape:
        case "box":
            return rr.Boxes3D(sizes=size, centers=centre, quaternions=turn, colors=colour, fill_mode=SOLID)
        case "sphere":
            return rr.Ellipsoids3D(radii=radii, centers=centre, colors=colour, fill_mode=SOLID)
        case "cylinder":
            return rr.Cylinders3D(
                radii=radii, lengths=lengths, centers=centre, quaternions=turn, colors=colour, fill_mode=SOLID
            )
        case "capsule":
            # Here a capsule's origin is the middle of its lower cap, not its own middle.
            low = centre - rotation_matrices(pose[:, 3:])[..., 2] * lengths[:, None] / 2
            return rr.Capsules3D(
                radii=radii, lengths=lengths, translations=low, quaternions=turn, colors=colour, fill_mode=SOLID
            )
        case other:
            raise ValueError(f"no solid has the shape {other!r}")
