"""Pictures of a tower that need neither OpenGL nor Vulkan."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from PIL import Image

from jenga_data.episode import Episode
from jenga_data.errors import JengaError
from jenga_data.geometry import rotation_matrices
from jenga_data.palette import TARGET, wood
from jenga_data.replay import hand
from jenga_data.replay.measures import samples_at_frames
from jenga_data.replay.paint import TURNTABLE, Stand, paint
from jenga_data.replay.raster import Camera
from jenga_data.replay.solids import Boxes, Faces, robot_faces

AZIMUTH, ELEVATION = np.radians(222.0), np.radians(20.0)
"""Where the eye stands unless a caller says otherwise: the -x side, to which every block is pulled, faces left."""

_ASIDE = np.radians(70.0)
"""From where a robot stands, as seen from the tower, to where the eye stands beside it: the arm hides no tower."""
_FAR = 0.42
"""Parts farther from the turntable's axis do not widen the view; the top of a tower that tips over comes so far [m]."""


def tower_camera(
    parts: Sequence[Boxes | Faces],
    azimuth: float = AZIMUTH,
    elevation: float = ELEVATION,
    stand: Stand = TURNTABLE,
) -> Camera:
    """A camera that sees the turntable and all of the given parts, so that pictures of one film share their frame.

    Args:
        azimuth: where the eye stands, from +x towards +y [rad].
        elevation: how high above the horizon it stands [rad].
        stand: what the tower stands on.
    """
    corners = np.concatenate([stand.outline(), *(part.corners() for part in parts)])
    near = np.linalg.norm(corners[:, :2], axis=1) < _FAR
    return Camera.fitting(corners[near], azimuth, elevation)


def render_tower(
    where: Axes | Path | None,
    pose: Float[np.ndarray, "block 7"],
    size: Float[np.ndarray, "block 3"],
    *,
    colours: Float[np.ndarray, "block 3"] | None = None,
    target: int | None = None,
    others: Sequence[Boxes | Faces] = (),
    ghosts: Sequence[Boxes] = (),
    camera: Camera | None = None,
    height: int = 900,
    stand: Stand = TURNTABLE,
) -> Float[np.ndarray, "height width 3"]:
    """Draw a tower into axes, a PNG file or neither, and return the picture.

    Args:
        colours: of each block; by default wood, in two tones by the direction a block lies in.
        target: drawn in its own colour, whatever `colours` says.
        others: solid parts besides the blocks, such as a robot's.
        ghosts: translucent boxes, such as a prediction.
        camera: what to look at; by default everything, from the side that blocks are pulled to.
        height: of the picture [pixels]; its width follows from the camera.
        stand: what the tower stands on.
    """
    if colours is None:
        along_y = np.abs(rotation_matrices(pose[:, 3:])[:, 0, 0]) < np.sqrt(0.5)
        colours = wood(along_y.astype(np.int64))
    if target is not None:
        colours = colours.copy()
        colours[target] = TARGET
    parts = [Boxes(pose, size, colours), *others]
    camera = camera or tower_camera([*parts, *ghosts], stand=stand)
    faces = Faces.joined([part.faces() if isinstance(part, Boxes) else part for part in parts])
    image = paint(faces, ghosts, camera, max(1, round(height * camera.aspect)), height, stand)
    if isinstance(where, Axes):
        where.imshow(image, interpolation="none")
        where.set_axis_off()
    elif where is not None:
        _write_png(where, image)
    return image


def free_azimuth(episode: Episode) -> float:
    """From where the tower is seen past a robot [rad]: the usual side, or to that side of the robot where one is."""
    if episode.robot is None or not episode.robot.link_pose.size:
        return float(AZIMUTH)
    x, y = episode.robot.link_pose[0, :, :2].mean(axis=0) - episode.pose[0, :, :2].mean(axis=0)
    sides = np.arctan2(y, x) + np.array([-_ASIDE, _ASIDE])
    return float(sides[np.argmax(np.cos(sides - AZIMUTH))])


def gripper_boxes(episode: Episode, frame: int) -> list[Boxes]:
    """The gripper at a frame, as solid boxes; none where the episode has no gripper."""
    track = episode.gripper
    if not len(track.time_ns):
        return []
    sample = samples_at_frames(episode)[[frame]]
    return [Boxes(hand.hand_poses(track.pose[sample], track.width[sample])[0], hand.SIZE, hand.COLOUR)]


def robot_parts(episode: Episode, frame: int) -> list[Boxes | Faces]:
    """The robot's links at a frame, or the gripper alone where the log says nothing of a robot; none without both."""
    if episode.robot is None or episode.header.robot is None:
        return [*gripper_boxes(episode, frame)]
    return [robot_faces(episode.header.robot, episode.robot.link_pose[frame])]


def _write_png(path: Path, image: Float[np.ndarray, "height width 3"]) -> None:
    try:
        Image.fromarray(np.round(image * 255).astype(np.uint8)).save(path, "PNG")
    except OSError as error:
        raise JengaError(f"cannot write {path}: {error.strerror or error}; choose another path") from error
