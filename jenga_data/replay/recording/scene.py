"""The tower, what stands around it, and what the rollout is at."""

from collections.abc import Mapping

import numpy as np
import rerun as rr

from jenga_data import palette
from jenga_data.replay import hand
from jenga_data.replay.meshes import Mesh
from jenga_data.replay.recording.recorder import Recorder
from jenga_data.replay.recording.robot import SOLID, log_robot
from jenga_data.scenery import (
    COLUMN_HEIGHT,
    COLUMN_RADIUS,
    TABLE_CENTRE,
    TABLE_SIZE,
    TABLE_TOP,
    TURNTABLE_HEIGHT,
    TURNTABLE_RADIUS,
)

_TABLE = (0.20, 0.21, 0.22)
"""Darker than the turntable: on a black ground a pale table would be the brightest thing of all."""


def log_scene(to: Recorder, meshes: Mapping[str, Mesh]) -> None:
    """The tower, what it stands on, the robot or the gripper, and the phases."""
    episode, header = to.episode, to.episode.header
    to.static("/world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    _log_stand(to)
    colours = palette.rgba8(palette.block_colours(header.layout.level, header.target))
    edges = rr.Boxes3D(sizes=header.blocks.size, colors=[palette.rgba8(palette.INK)], radii=rr.Radius.ui_points(0.6))
    to.static("/world/edges", edges)
    to.boxes("/world/edges", episode.time_ns, episode.pose)
    names = [f"block {i}" for i in range(len(header.blocks))]
    tower = rr.Boxes3D(sizes=header.blocks.size, colors=colours, labels=names, show_labels=False, fill_mode=SOLID)
    to.static("/world/tower", tower)
    to.boxes("/world/tower", episode.time_ns, episode.pose)
    track = episode.gripper
    if header.robot is not None and episode.robot is not None:
        log_robot(to, header.robot, episode.robot, meshes)
    elif len(track.time_ns):
        to.static("/world/gripper", rr.Boxes3D(sizes=hand.SIZE, colors=palette.rgba8(hand.COLOUR), fill_mode=SOLID))
        to.boxes("/world/gripper", track.time_ns, hand.hand_poses(track.pose, track.width))
    if episode.phases:
        names = list(dict.fromkeys(phase.name for phase in episode.phases))
        colours = [palette.rgba8(palette.PHASES[i % len(palette.PHASES)]) for i in range(len(names))]
        to.static("/phase", rr.StateConfiguration(values=names, colors=colours))
        starts = np.array([phase.time_ns for phase in episode.phases])
        to.columns("/phase", starts, rr.StateChange.columns(state=[phase.name for phase in episode.phases]))


def _log_stand(to: Recorder) -> None:
    """Turntable, column and table."""
    stand = rr.Cylinders3D(
        lengths=[TURNTABLE_HEIGHT, COLUMN_HEIGHT],
        radii=[TURNTABLE_RADIUS, COLUMN_RADIUS],
        centers=[(0.0, 0.0, -TURNTABLE_HEIGHT / 2), (0.0, 0.0, TABLE_TOP + COLUMN_HEIGHT / 2)],
        colors=palette.rgba8(np.array([palette.TABLE, palette.STEEL])),
        fill_mode=SOLID,
    )
    to.static("/world/turntable", stand)
    colour = [palette.rgba8(_TABLE)]
    to.static("/world/table", rr.Boxes3D(sizes=[TABLE_SIZE], centers=[TABLE_CENTRE], colors=colour, fill_mode=SOLID))
