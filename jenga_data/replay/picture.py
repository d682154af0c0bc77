"""Pictures of towers that need neither OpenGL nor Vulkan: one tower, a film strip, a grid of towers."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from jenga_data.episode import Episode
from jenga_data.errors import JengaError
from jenga_data.geometry import rotation_matrices
from jenga_data.palette import TARGET, block_colours, wood
from jenga_data.replay import hand, style
from jenga_data.replay.measures import phase_name, samples_at_frames, seconds
from jenga_data.replay.paint import TURNTABLE_RADIUS, Boxes, paint
from jenga_data.replay.raster import Camera
from jenga_data.tower import TowerState

AZIMUTH, ELEVATION = np.radians(222.0), np.radians(20.0)
"""Where the eye stands unless a caller says otherwise: the -x side, to which every block is pulled, faces left."""

_FAR = 0.30
"""Boxes farther from the turntable's axis do not widen the view [m]."""


def tower_camera(boxes: Sequence[Boxes], azimuth: float = AZIMUTH, elevation: float = ELEVATION) -> Camera:
    """A camera that sees the turntable and all of the given boxes, so that pictures of one film share their frame.

    Args:
        azimuth: where the eye stands, from +x towards +y [rad].
        elevation: how high above the horizon it stands [rad].
    """
    around = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    disc = TURNTABLE_RADIUS * np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
    corners = np.concatenate([disc, *(b.corners() for b in boxes)])
    near = np.linalg.norm(corners[:, :2], axis=1) < _FAR
    return Camera.fitting(corners[near], azimuth, elevation)


def render_tower(
    where: Axes | Path,
    pose: Float[np.ndarray, "block 7"],
    size: Float[np.ndarray, "block 3"],
    *,
    colours: Float[np.ndarray, "block 3"] | None = None,
    target: int | None = None,
    others: Sequence[Boxes] = (),
    ghosts: Sequence[Boxes] = (),
    camera: Camera | None = None,
    height: int = 900,
) -> Float[np.ndarray, "height width 3"]:
    """Draw a tower into axes or a PNG file, and return the picture.

    Args:
        colours: of each block; by default wood, in two tones by the direction a block lies in.
        target: drawn in its own colour, whatever `colours` says.
        others: solid boxes besides the blocks, such as a gripper's.
        ghosts: translucent boxes, such as a prediction.
        camera: what to look at; by default everything, from the side that blocks are pulled to.
        height: of the picture [pixels]; its width follows from the camera.
    """
    if colours is None:
        along_y = np.abs(rotation_matrices(pose[:, 3:])[:, 0, 0]) < np.sqrt(0.5)
        colours = wood(along_y.astype(np.int64))
    if target is not None:
        colours = colours.copy()
        colours[target] = TARGET
    boxes = Boxes.joined([Boxes(pose, size, colours), *others])
    camera = camera or tower_camera([boxes, *ghosts])
    image = paint(boxes, ghosts, camera, max(1, round(height * camera.aspect)), height)
    if isinstance(where, Axes):
        where.imshow(image, interpolation="none")
        where.set_axis_off()
    else:
        _write_png(where, image)
    return image


def gripper_boxes(episode: Episode, frame: int) -> list[Boxes]:
    """The gripper at a frame, as solid boxes; none where the episode has no gripper."""
    track = episode.gripper
    if not len(track.time_ns):
        return []
    sample = samples_at_frames(episode)[[frame]]
    return [Boxes(hand.hand_poses(track.pose[sample], track.width[sample])[0], hand.SIZE, hand.COLOUR)]


def film_strip(episode: Episode, frames: Sequence[int], path: Path, height: int = 560) -> None:
    """Write several moments of an episode side by side, each with its phase and its time.

    Raises:
        JengaError: the episode has no such frame.
    """
    count = len(episode.time_ns)
    for frame in frames:
        if not 0 <= frame < count:
            raise JengaError(f"frame {frame} is not in the episode; it has frames 0 to {count - 1}")
    size = episode.header.blocks.size
    colours = block_colours(episode.header.layout.level, episode.header.target)
    scenes = [(Boxes(episode.pose[f], size, colours), gripper_boxes(episode, f)) for f in frames]
    camera = tower_camera([box for tower, grippers in scenes for box in (tower, *grippers)])
    time = seconds(episode)
    titles = [f"{phase_name(episode, f) or 'start'}\n{time[f]:.2f} s" for f in frames]
    with style.applied():
        figure, axes = _picture_grid(titles, columns=len(frames), camera=camera, height=height)
        for one, (tower, grippers) in zip(axes, scenes, strict=True):
            render_tower(one, tower.pose, size, colours=colours, others=grippers, camera=camera, height=height)
        style.save(figure, path)


def tower_grid(
    states: Sequence[TowerState],
    titles: Sequence[str],
    path: Path,
    *,
    targets: Sequence[int | None] | None = None,
    columns: int = 5,
    height: int = 380,
) -> None:
    """Write many towers to one scale, such as the rounds of a game, `columns` in a row."""
    colours = [block_colours(state.layout.level) for state in states]
    towers = [Boxes(s.pose, s.blocks.size, c) for s, c in zip(states, colours, strict=True)]
    camera = tower_camera(towers)
    with style.applied():
        figure, axes = _picture_grid(titles, min(columns, len(states)), camera, height)
        for one, tower, target in zip(axes, towers, targets or [None] * len(towers), strict=True):
            render_tower(one, tower.pose, tower.size, colours=tower.colour, target=target, camera=camera, height=height)
        style.save(figure, path)


def _picture_grid(titles: Sequence[str], columns: int, camera: Camera, height: int) -> tuple[Figure, list[Axes]]:
    """Axes of exactly `height` pixels for each title, so that no picture is resampled."""
    rows = -(-len(titles) // columns)
    width = max(1, round(height * camera.aspect))
    letter = max(28.0, 0.085 * width)  # pixels: large enough to read when the whole strip is as wide as a page
    title_height = round(letter * (0.6 + 1.25 * max(title.count("\n") + 1 for title in titles)))
    total_width, total_height = columns * width, rows * (height + title_height)
    figure = Figure(figsize=(total_width / style.DPI, total_height / style.DPI))
    axes = []
    for number, title in enumerate(titles):
        row, column = divmod(number, columns)
        bottom = total_height - (row + 1) * (height + title_height)
        box = (column * width / total_width, bottom / total_height, width / total_width, height / total_height)
        one = figure.add_axes(box)
        one.set_title(title, pad=6, fontsize=letter * 72 / style.DPI)
        axes.append(one)
    return figure, axes


def _write_png(path: Path, image: Float[np.ndarray, "height width 3"]) -> None:
    try:
        Image.fromarray(np.round(image * 255).astype(np.uint8)).save(path, "PNG")
    except OSError as error:
        raise JengaError(f"cannot write {path}: {error.strerror or error}; choose another --out") from error
