"""Where in the world the bodies of an episode touch: the log holds who touches whom and how hard."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from jenga_data.episode import LEFT_FINGER, RIGHT_FINGER, ROBOT, TABLE, Episode
from jenga_data.geometry import rotation_matrices
from jenga_data.replay import hand
from jenga_data.replay.measures import samples_at_frames
from jenga_data.replay.solids import solid_bounds

_FAR = 10.0
"""Beyond everything [m]: the table reaches so far to the sides and down."""


@dataclass(frozen=True, eq=False)
class ContactPoints:
    """Every contact of every frame, frame by frame. `force` is what `second` exerts on `first` [N]."""

    frame: Int[np.ndarray, " contact"]
    first: Int[np.ndarray, " contact"]
    second: Int[np.ndarray, " contact"]
    point: Float[np.ndarray, "contact 3"]
    force: Float[np.ndarray, "contact 3"]

    def counts(self, frames: int) -> Int[np.ndarray, " frame"]:
        """How many contacts each frame has."""
        return np.bincount(self.frame, minlength=frames)


def contact_points(episode: Episode) -> ContactPoints:
    """Place every contact in the middle of where the two bodies' bounding boxes overlap.

    That is the middle of the shared area for blocks that lie flat, and near it for tilted ones. Of a robot's solids the
    one counts that reaches deepest into the block's box. Contacts of the fingers are left out where the episode has no
    gripper track, and those of the rest of the robot where it has neither that nor a robot.
    """
    contacts = episode.contacts
    frame = np.repeat(np.arange(len(contacts)), [len(c.first) for c in contacts])
    first = np.concatenate([c.first for c in contacts])
    second = np.concatenate([c.second for c in contacts])
    force = np.concatenate([c.force for c in contacts])
    low, high = _bounds(episode)
    inner_low = np.maximum(low[frame, first], low[frame, second])
    inner_high = np.minimum(high[frame, first], high[frame, second])
    point = (inner_low + inner_high) / 2
    touched = second == ROBOT
    if episode.robot is not None and episode.header.robot is not None and touched.any():
        at, block = frame[touched], first[touched]
        solids = solid_bounds(episode.header.robot, episode.robot.link_pose)
        point[touched] = _deepest(low[at, block], high[at, block], *(bound[at] for bound in solids))
    known = np.isfinite(point).all(axis=1)
    return ContactPoints(frame[known], first[known], second[known], point[known], force[known])


def _deepest(
    low: Float[np.ndarray, "contact 3"],
    high: Float[np.ndarray, "contact 3"],
    solid_low: Float[np.ndarray, "contact solid 3"],
    solid_high: Float[np.ndarray, "contact solid 3"],
) -> Float[np.ndarray, "contact 3"]:
    """The middle of what a block's bounding box shares with that of the solid that reaches deepest into it."""
    if not solid_low.shape[1]:
        return np.full(low.shape, np.nan)
    inner_low, inner_high = np.maximum(low[:, None], solid_low), np.minimum(high[:, None], solid_high)
    best = np.argmax((inner_high - inner_low).min(axis=-1), axis=1)
    row = np.arange(len(low))
    return (inner_low[row, best] + inner_high[row, best]) / 2


def _bounds(episode: Episode) -> tuple[Float[np.ndarray, "frame body 3"], Float[np.ndarray, "frame body 3"]]:
    """Low and high corner of each body's bounding box: the blocks, then four more that their negative ids reach."""
    frames, blocks = episode.pose.shape[:2]
    low = np.full((frames, blocks + 4, 3), np.nan)
    high = low.copy()

    def fill(body: int | slice | np.ndarray, pose: np.ndarray, size: np.ndarray) -> None:
        reach = (np.abs(rotation_matrices(pose[..., 3:])) * size[..., None, :]).sum(axis=-1) / 2
        low[:, body], high[:, body] = pose[..., :3] - reach, pose[..., :3] + reach

    fill(slice(0, blocks), episode.pose, episode.header.blocks.size)
    low[:, TABLE] = -_FAR
    high[:, TABLE] = _FAR, _FAR, 0.0
    if len(episode.gripper.time_ns):
        sample = samples_at_frames(episode)
        bodies = hand.hand_poses(episode.gripper.pose[sample], episode.gripper.width[sample])
        for body, box in ((ROBOT, hand.PALM), (LEFT_FINGER, hand.LEFT_PAD), (RIGHT_FINGER, hand.RIGHT_PAD)):
            fill(body, bodies[:, box], hand.SIZE[box])
    return low, high


@dataclass(frozen=True, eq=False)
class GraphNodes:
    """The nodes of a contact graph, laid out like the tower: `name`, where it is drawn, and each body's row."""

    name: list[str]
    position: Float[np.ndarray, "node 2"]
    row: Int[np.ndarray, " body"]
    """Row of each body, by its id: negative ids reach the last four."""


def graph_nodes(episode: Episode, contacts: ContactPoints) -> GraphNodes:
    """One node a block, in three columns and as many rows as there are levels, and one for all else that is touched."""
    level, slot = episode.header.layout.level, episode.header.layout.slot
    height = float(level[episode.header.target])
    side = -2.0 if slot[episode.header.target] == 0 else 2.0  # so that no edge to the target runs behind a block
    around = {
        "table": (TABLE, 0.0, -1.2),
        "left": (LEFT_FINGER, side, height + 0.6),
        "right": (RIGHT_FINGER, side, height - 0.6),
        "robot": (ROBOT, side, height - 1.8),
    }
    bodies = set(contacts.first.tolist()) | set(contacts.second.tolist())
    there = {name: values for name, values in around.items() if values[0] in bodies}
    row = np.arange(len(level) + 4)
    for number, (body, _, _) in enumerate(there.values()):
        row[body] = len(level) + number
    extra = np.reshape([values[1:] for values in there.values()], (-1, 2))
    position = np.concatenate([np.stack([slot - 1.0, level], axis=1), extra])
    return GraphNodes([*map(str, range(len(level))), *there], position, row)
