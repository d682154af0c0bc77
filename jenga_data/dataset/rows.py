"""From an episode in memory to the rows of a dataset, as numpy columns. Knows neither files nor Arrow."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from jenga_data.dataset.schema import DATASET_KIND, FORCE_STEP, POSE_STEP, TWIST_STEP
from jenga_data.episode import Contacts, Episode, Result
from jenga_data.errors import JengaError
from jenga_data.graph import support_edges
from jenga_data.outcome import THRESHOLDS, collapsed


@dataclass(frozen=True, eq=False)
class Ragged:
    """A list column: row i holds `values[offset[i]:offset[i + 1]]`."""

    offset: Int[np.ndarray, " rows_and_one"]
    values: Shaped[np.ndarray, " value"]

    def __len__(self) -> int:
        return len(self.offset) - 1

    def __getitem__(self, chosen: Bool[np.ndarray, " row"]) -> "Ragged":
        """The rows where `chosen` is true."""
        lengths = np.diff(self.offset)
        return Ragged(np.concatenate([[0], np.cumsum(lengths[chosen])]), self.values[np.repeat(chosen, lengths)])


Rows = dict[str, np.ndarray | Ragged]
"""Columns by name, each with the row as its first axis."""


def rows_of(episode: Episode) -> Rows:
    """All rows that an episode gives: one for a selection, one an action for an extraction.

    Raises:
        JengaError: the log's kind makes no dataset, it has no outcome, or its parts contradict each other.
    """
    kind = episode.header.kind
    if kind not in DATASET_KIND:
        raise JengaError(f"episode {episode.header.key} is of kind {kind!r}; allowed: {', '.join(DATASET_KIND)}")
    result = _checked(episode)
    if DATASET_KIND[kind] == "selection":
        frames = np.zeros(1, np.int64)
        return _keys(episode, frames) | _state(episode, frames) | _labels(result)
    frames = episode.action_frame.astype(np.int64)
    return _keys(episode, frames) | _state(episode, frames) | _transition(episode, result, frames)


def _checked(episode: Episode) -> Result:
    header, count, frames = episode.header, len(episode.header.blocks), len(episode.pose)
    wrong = ""
    if episode.result is None:
        wrong = "has no outcome"
    elif frames == 0:
        wrong = "has no frames"
    elif len(header.layout.level) != count or episode.pose.shape[1] != count:
        wrong = f"has {count} blocks, {len(header.layout.level)} of them in the layout, {episode.pose.shape[1]} poses"
    elif not 0 <= header.target < count:
        wrong = f"has target {header.target}, which is none of its {count} blocks"
    elif len(episode.action_frame) and not (
        episode.action_frame.min() >= 0
        and episode.action_frame.max() < frames - 1
        and (np.diff(episode.action_frame) > 0).all()
    ):
        wrong = f"has actions that do not each lie between two of its {frames} frames, in order"
    if wrong or episode.result is None:
        raise JengaError(f"episode {header.key} {wrong}: run `jenga log doctor` on its log")
    return episode.result


def _keys(episode: Episode, frames: Int[np.ndarray, " row"]) -> Rows:
    header = episode.header
    same = {
        "episode": header.key,
        "tower": header.blocks.tower,
        "round": header.round,
        "target": header.target,
        "turn": header.turn,
        "face": header.face,
    }
    keys: Rows = {name: np.full(len(frames), value) for name, value in same.items()}
    return keys | {"frame": frames}


def _state(episode: Episode, frames: Int[np.ndarray, " row"]) -> Rows:
    header, rows = episode.header, len(frames)
    pose = in_steps(episode.pose[frames], POSE_STEP)
    edges = [support_edges(p, header.blocks.size) for p in pose]
    force = [edge_forces(episode.contacts[f], e, len(header.blocks)) for f, e in zip(frames, edges, strict=True)]
    offset = np.concatenate([[0], np.cumsum([e.shape[1] for e in edges])]).astype(np.int64)
    both = np.concatenate([np.zeros((2, 0), np.int64), *edges], axis=1)

    def repeat(values: np.ndarray) -> np.ndarray:
        return np.broadcast_to(values, (rows, *values.shape))

    return {
        "block_size": repeat(header.blocks.size),
        "block_mass": repeat(header.blocks.mass),
        "block_wedge": repeat(header.blocks.wedge),
        "block_pose": pose,
        "block_twist": in_steps(episode.twist[frames], TWIST_STEP),
        "level": repeat(header.layout.level),
        "slot": repeat(header.layout.slot),
        "edge_upper": Ragged(offset, both[0]),
        "edge_lower": Ragged(offset, both[1]),
        "edge_force": Ragged(offset, in_steps(np.concatenate([np.zeros(0), *force]), FORCE_STEP)),
    }


def in_steps(values: Float[np.ndarray, "*any"], step: float) -> Float[np.ndarray, "*any"]:
    """The nearest whole multiples of `step`, a power of two: noise below it would make most of a file's bytes."""
    return np.round(values / step) * step


def edge_forces(contacts: Contacts, edges: Int[np.ndarray, "2 edge"], blocks: int) -> Float[np.ndarray, " edge"]:
    """Upward force that the lower block of each edge exerts on the upper one [N], summed over their contacts."""
    lift = np.zeros((blocks, blocks))  # [on, by]
    between = (contacts.first >= 0) & (contacts.second >= 0)
    first, second, up = contacts.first[between], contacts.second[between], contacts.force[between, 2]
    np.add.at(lift, (first, second), up)
    np.add.at(lift, (second, first), -up)
    return lift[edges[0], edges[1]]


def _labels(result: Result) -> Rows:
    verdict = result.verdict
    labels = {
        "failure": verdict.failure,
        "strict_failure": verdict.strict_failure,
        "dragged": verdict.dragged,
        "outcome": str(verdict.outcome),
        "moved": verdict.moved,
    }
    return {name: np.full(1, value) for name, value in labels.items()}


def _transition(episode: Episode, result: Result, frames: Int[np.ndarray, " row"]) -> Rows:
    clear, gripper = result.verdict.clear_frame, episode.gripper
    start, end = episode.time_ns[frames], episode.time_ns[frames + 1]
    return {
        "action": episode.action,
        "action_reached": episode.action_reached,
        "next_pose": in_steps(episode.pose[frames + 1], POSE_STEP),
        "next_twist": in_steps(episode.twist[frames + 1], TWIST_STEP),
        "left_force": step_means(gripper.time_ns, gripper.left_force, start, end),
        "right_force": step_means(gripper.time_ns, gripper.right_force, start, end),
        "target_clear": (frames >= clear) & (clear >= 0),
        "collapsed": collapsed(episode.pose[0], episode.pose[frames + 1], episode.header.target, THRESHOLDS.drop),
    }


def step_means(
    time_ns: Int[np.ndarray, " sample"],
    values: Float[np.ndarray, "sample axis"],
    start_ns: Int[np.ndarray, " step"],
    end_ns: Int[np.ndarray, " step"],
) -> Float[np.ndarray, "step axis"]:
    """Mean of the samples in each step (start, end], 0 where there is none.

    A sample at the very start shows what the step before did, so it is left out.
    """
    first, last = np.searchsorted(time_ns, start_ns, "right"), np.searchsorted(time_ns, end_ns, "right")
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return (total[last] - total[first]) / np.maximum(last - first, 1)[:, None]
