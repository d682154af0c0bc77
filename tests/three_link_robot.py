"""A small robot that no simulator knows: a base on the table, an arm that swings about z, and a tool at its end."""

import numpy as np

from jenga_data.episode import Link, RobotModel, RobotState, RobotTrack, Solid
from jenga_data.scenery import TABLE_TOP

IDENTITY = (1.0, 0.0, 0.0, 0.0)
LYING = (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)
"""Turns a solid's z to the link's x."""
BASE = np.array([-0.22, 0.10, TABLE_TOP])
REACH = 0.16
RED, GREY, BLACK = (0.9, 0.1, 0.1, 1.0), (0.6, 0.6, 0.65, 1.0), (0.1, 0.1, 0.1, 1.0)

MODEL = RobotModel(
    joints=("swing", "lift"),
    links=(
        Link(
            "base",
            (
                Solid("box", (0.10, 0.10, 0.02), (0.0, 0.0, 0.01, *IDENTITY), GREY),
                Solid("cylinder", (0.025, 0.18, 0.0), (0.0, 0.0, 0.11, *IDENTITY), GREY),
            ),
        ),
        Link("arm", (Solid("capsule", (0.02, REACH, 0.0), (REACH / 2, 0.0, 0.0, *LYING), RED),)),
        Link(
            "tool 1",
            (
                Solid("sphere", (0.025, 0.0, 0.0), (0.0, 0.0, 0.0, *IDENTITY), BLACK),
                Solid("box", (0.04, 0.01, 0.01), (0.03, 0.0, 0.0, *IDENTITY), BLACK),
            ),
        ),
    ),
)


def state(swing: float, lift: float = 0.2, speed: float = 0.0) -> RobotState:
    """The robot with its arm turned by `swing` [rad] about z and its shoulder `lift` above the base's foot [m]."""
    turn = [np.cos(swing / 2), 0.0, 0.0, np.sin(swing / 2)]
    shoulder = BASE + np.array([0.0, 0.0, lift])
    end = shoulder + REACH * np.array([np.cos(swing), np.sin(swing), 0.0])
    pose = np.array([[*BASE, *IDENTITY], [*shoulder, *turn], [*end, *turn]])
    return RobotState(np.array([swing, lift]), np.array([speed, 0.0]), np.array([-3.0 * speed, 2.5]), pose)


def track(frames: int, start: float = -1.2, speed: float = 0.6, step: float = 0.032) -> RobotTrack:
    """The arm swings towards the tower at a constant speed [rad/s]."""
    states = [state(start + speed * step * k, speed=speed) for k in range(frames)]
    names = ("position", "velocity", "torque", "link_pose")
    return RobotTrack(*(np.stack([getattr(s, name) for s in states]) for name in names))
