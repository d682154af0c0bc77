"""The rows of a dynamics dataset as the frames of a LeRobotDataset: arrays only."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from jenga_data.dataset.read import Dataset

Frames = dict[str, Shaped[np.ndarray, "frame ..."]]
"""Features by name, each with the frame as its first axis and at most one other."""

_POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
_FORCE = tuple(f"{side}_force_{axis}" for side in ("left", "right") for axis in "xyz")


def _state_names(dataset: Dataset) -> list[str]:
    blocks = range(dataset.manifest.blocks)
    return [f"block_{b}_{axis}" for b in blocks for axis in _POSE] + list(_FORCE)


def _environment_names(dataset: Dataset) -> list[str]:
    blocks = range(dataset.manifest.blocks)
    sizes = [f"block_{b}_{edge}" for b in blocks for edge in ("length", "width", "height")]
    return sizes + [f"block_{b}_mass" for b in blocks] + [f"block_{b}_is_target" for b in blocks]


FEATURES: dict[str, Callable[[Dataset], list[str] | None]] = {
    "observation.state": _state_names,
    "observation.environment_state": _environment_names,
    "action": lambda _: ["dx", "dy", "dz"],
    "next.done": lambda _: None,
    "next.success": lambda _: None,
    "timestamp": lambda _: None,
    "frame_index": lambda _: None,
    "episode_index": lambda _: None,
    "index": lambda _: None,
    "task_index": lambda _: None,
}
"""What the numbers of each feature are called. SI; poses and actions in the world frame, forces in the gripper's."""


def frames_of(dataset: Dataset, rows: Int[np.ndarray, " frame"], lengths: Sequence[int], step: float) -> Frames:
    """The frames of all episodes, one after the other.

    Args:
        rows: row of the dataset that each frame is.
        lengths: frames of each episode.
        step: time between two frames [s].
    """
    count = len(rows)
    start = np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(int)
    episode = np.repeat(np.arange(len(lengths)), lengths)
    number = dataset.column("frame")[rows].astype(np.int64)
    last = np.r_[episode[1:] != episode[:-1], True]
    return {
        "observation.state": _state(dataset, rows, number, episode),
        "observation.environment_state": _environment(dataset, rows),
        "action": dataset.column("action")[rows],
        "next.done": last,
        "next.success": dataset.column("target_clear")[rows] & ~dataset.column("collapsed")[rows] & last,
        "timestamp": ((number - number[start][episode]) * step).astype(np.float32),
        "frame_index": np.arange(count) - start[episode],
        "episode_index": episode,
        "index": np.arange(count),
        "task_index": np.zeros(count, np.int64),
    }


def _state(
    dataset: Dataset,
    rows: Int[np.ndarray, " frame"],
    number: Int[np.ndarray, " frame"],
    episode: Int[np.ndarray, " frame"],
) -> Float[np.ndarray, "frame state"]:
    """Poses of all blocks, and the forces on the fingertips over the step that led to the frame.

    A row tells the forces over the step that follows, which would be a look into the future; they move on by one
    row. Where the row before is of another time the forces are 0.
    """
    pose = dataset.column("block_pose")[rows].reshape(len(rows), -1)
    ahead = np.concatenate([dataset.column(f"{side}_force")[rows] for side in ("left", "right")], axis=1)
    follows: Bool[np.ndarray, " frame"] = np.zeros(len(rows), bool)
    follows[1:] = (episode[1:] == episode[:-1]) & (np.diff(number) == 1)
    behind = np.zeros_like(ahead)
    behind[follows] = ahead[:-1][follows[1:]]
    return np.concatenate([pose, behind], axis=1)


def _environment(dataset: Dataset, rows: Int[np.ndarray, " frame"]) -> Float[np.ndarray, "frame environment"]:
    """What stays the same for an episode: sizes and masses of the blocks, and 1 for the target."""
    size = dataset.column("block_size")[rows].reshape(len(rows), -1)
    target = np.arange(dataset.manifest.blocks) == dataset.column("target")[rows][:, None]
    return np.concatenate([size, dataset.column("block_mass")[rows], target.astype(np.float32)], axis=1)
