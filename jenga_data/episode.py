"""One rollout in memory: what the simulator hands to the log, and what the log hands to everybody else."""

from dataclasses import dataclass, field
from typing import Any, SupportsIndex

import numpy as np
from jaxtyping import Float, Int

from jenga_data.blocks import Blocks
from jenga_data.clock import CONTROL_STEP_NS
from jenga_data.outcome import Verdict
from jenga_data.tower import Layout, TowerState

TABLE = -1
LEFT_FINGER = -2
RIGHT_FINGER = -3
ROBOT = -4
"""Ids of what a block can touch besides other blocks (0 and up)."""


@dataclass(frozen=True, eq=False)
class Contacts:
    """Which bodies touch at one moment, one row a pair, and the total force that `second` exerts on `first` [N]."""

    first: Int[np.ndarray, " contact"]
    second: Int[np.ndarray, " contact"]
    force: Float[np.ndarray, "contact 3"]


@dataclass(frozen=True)
class Solid:
    """A primitive of a link, as a viewer draws it, in the link's frame.

    `shape` is "box" (`size`: edge lengths along x, y, z), "sphere" (radius, 0, 0), or "cylinder" or "capsule" (radius,
    length without a capsule's caps, 0), both along the solid's own z [m]. `pose` is x y z and a wxyz quaternion.
    """

    shape: str
    size: tuple[float, float, float]
    pose: tuple[float, float, float, float, float, float, float]
    color: tuple[float, float, float, float]


@dataclass(frozen=True)
class Link:
    """A rigid part of the robot or of what belongs to it: a link of the arm, a finger, the push-stick, its holder."""

    name: str
    solids: tuple[Solid, ...]


@dataclass(frozen=True)
class RobotModel:
    """What of a robot stays the same in an episode: the names of its joints, and its links."""

    joints: tuple[str, ...]
    links: tuple[Link, ...]


@dataclass(frozen=True, eq=False)
class RobotState:
    """A robot at one moment: its joints [rad, rad/s, N m], and the links' poses in the world."""

    position: Float[np.ndarray, " joint"]
    velocity: Float[np.ndarray, " joint"]
    torque: Float[np.ndarray, " joint"]
    link_pose: Float[np.ndarray, "link 7"]


@dataclass(frozen=True, eq=False)
class EpisodeHeader:
    """All that is known of an episode before its first frame.

    `key` names it: a hash of (config, seed, number) and of the acting model's checkpoint, if one acts.
    `turn` is the number of quarter turns the table made to bring the target along x, `face` which of the
    target's own ends is pulled (0: its -x end, 1: its +x end).
    """

    key: str
    kind: str
    seed: int
    number: int
    blocks: Blocks
    layout: Layout
    target: int
    turn: int
    face: int
    config: dict[str, Any]
    checkpoint: str = ""
    provenance: dict[str, str] = field(default_factory=dict)
    control_step_ns: int = CONTROL_STEP_NS
    robot: RobotModel | None = None

    @property
    def round(self) -> int:
        return self.layout.round


@dataclass(frozen=True, eq=False)
class Frame:
    """The state at one control step.

    `sim_state` is MuJoCo's integration state, empty where there is no MuJoCo. `turntable` is the angle by which the
    turntable has turned since frame 0 [rad]; `robot` is None where the episode has none.
    """

    index: int
    time_ns: int
    pose: Float[np.ndarray, "block 7"]
    twist: Float[np.ndarray, "block 6"]
    contacts: Contacts
    sim_state: Float[np.ndarray, " state"]
    turntable: float = 0.0
    robot: RobotState | None = None


@dataclass(frozen=True, eq=False)
class Action:
    """What was commanded between frame `frame` and the next, and what came of it: displacements in the world [m].

    `wanted` is what the controller asked for before it was put on the limits, None where it is `displacement`.
    """

    frame: int
    time_ns: int
    displacement: Float[np.ndarray, "3"]
    reached: Float[np.ndarray, "3"]
    wanted: Float[np.ndarray, "3"] | None = None


@dataclass(frozen=True, eq=False)
class GripperSample:
    """The gripper at one moment: pose of the point between the fingertips in the world, opening [m], and the force
    that the block exerts on each fingertip in the gripper's frame [N]."""

    time_ns: int
    pose: Float[np.ndarray, "7"]
    width: float
    left_force: Float[np.ndarray, "3"]
    right_force: Float[np.ndarray, "3"]


@dataclass(frozen=True)
class Phase:
    """What the rollout does from `frame` on, e.g. "grasp" or "pull"."""

    frame: int
    time_ns: int
    name: str


@dataclass(frozen=True)
class Result:
    """How an episode ended: the verdict on the tower, and what went wrong on the robot's side ("" if nothing)."""

    verdict: Verdict
    cause: str = ""


@dataclass(frozen=True, eq=False)
class GripperTrack:
    """All gripper samples of an episode, stacked."""

    time_ns: Int[np.ndarray, " sample"]
    pose: Float[np.ndarray, "sample 7"]
    width: Float[np.ndarray, " sample"]
    left_force: Float[np.ndarray, "sample 3"]
    right_force: Float[np.ndarray, "sample 3"]


@dataclass(frozen=True, eq=False)
class RobotTrack:
    """The robot's states at all frames, stacked."""

    position: Float[np.ndarray, "frame joint"]
    velocity: Float[np.ndarray, "frame joint"]
    torque: Float[np.ndarray, "frame joint"]
    link_pose: Float[np.ndarray, "frame link 7"]


@dataclass(frozen=True, eq=False)
class Episode:
    """A whole log, stacked. `result` is None where the log ends before its outcome, `robot` where there is none."""

    header: EpisodeHeader
    time_ns: Int[np.ndarray, " frame"]
    pose: Float[np.ndarray, "frame block 7"]
    twist: Float[np.ndarray, "frame block 6"]
    contacts: list[Contacts]
    sim_state: Float[np.ndarray, "frame state"]
    action_frame: Int[np.ndarray, " action"]
    action: Float[np.ndarray, "action 3"]
    action_reached: Float[np.ndarray, "action 3"]
    gripper: GripperTrack
    phases: list[Phase]
    result: Result | None
    turntable: Float[np.ndarray, " frame"]
    robot: RobotTrack | None
    action_wanted: Float[np.ndarray, "action 3"] | None = None
    """Before limits; None where nobody asked for more than was done."""

    def tower_state(self, frame: SupportsIndex) -> TowerState:
        """The tower at `frame`, as the controller saw it."""
        return TowerState(self.header.blocks, self.header.layout, self.pose[frame], self.twist[frame])

    @property
    def lag(self) -> Float[np.ndarray, "action 3"]:
        """How far the hand's set point is ahead of the hand before each action [m]: what the target fell short so far.

        The hand holds the target, so the way of the one is the way of the other. Before the first action it is taken
        to be 0.
        """
        after = np.minimum(self.action_frame + 1, len(self.pose) - 1)
        target = self.header.target
        short = self.action - (self.pose[after, target, :3] - self.pose[self.action_frame, target, :3])
        return np.cumsum(short, axis=0) - short


@dataclass(frozen=True, eq=False)
class Prediction:
    """What one model says of an episode, drawn over the truth by replay.

    `pose[k]` is the tower that the model expects at frame `frame[k]`: for `kind` "one_step" from the true state
    one frame before, for "open_loop" from its own prediction, started at `frame[0] - 1`.
    `failure_probability` is the selector's for each block at frame 0, NaN where it has none.
    """

    name: str
    checkpoint: str
    kind: str
    frame: Int[np.ndarray, " prediction"]
    pose: Float[np.ndarray, "prediction block 7"]
    failure_probability: Float[np.ndarray, " block"]
