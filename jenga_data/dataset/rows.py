"""From an episode in memory to the rows of a dataset, as numpy columns. Knows neither files nor Arrow."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from jenga_data.clock import MOMENTS
from jenga_data.dataset.schema import DATASET_KIND, FORCE_STEP, MOVED_STEP, POSE_STEP, TWIST_STEP
from jenga_data.episode import Contacts, Episode, Result
from jenga_data.errors import JengaError
from jenga_data.graph import support_lists
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


def rows_of(episode: Episode, number: Int[np.ndarray, " frame"] | None = None) -> Rows:
    """All rows that an episode gives: one for a selection, one an action for an extraction.

    Args:
        number: what the episode's frames are called, where it is an excerpt of one.

    Raises:
        JengaError: the log's kind makes no dataset, it has no outcome, or its parts contradict each other.
    """
    return rows_of_all([(episode, np.arange(len(episode.pose)) if number is None else number)])


def rows_of_all(episodes: Sequence[tuple[Episode, Int[np.ndarray, " _"]]]) -> Rows:
    """The rows of episodes of one kind and size, one episode after the other: many at once take less time.

    Raises:
        JengaError: as `rows_of`.
    """
    results = [_checked(episode) for episode, _ in episodes]
    selection = all(DATASET_KIND[episode.header.kind] == "selection" for episode, _ in episodes)
    taken = [
        (episode, number, np.zeros(1, np.int64) if selection else episode.action_frame.astype(np.int64))
        for episode, number in episodes
    ]
    parts = [
        _keys(episode, number[frames])
        | (_labels(result) | _motion(episode, number) if selection else _transition(episode, result, frames, number))
        for (episode, number, frames), result in zip(taken, results, strict=True)
    ]
    joined: Rows = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return joined | _state([(episode, frames) for episode, _, frames in taken])


def _checked(episode: Episode) -> Result:
    kind = episode.header.kind
    if kind not in DATASET_KIND:
        raise JengaError(f"episode {episode.header.key} is of kind {kind!r}; allowed: {', '.join(DATASET_KIND)}")
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


def _keys(episode: Episode, frames: Int[np.ndarray, " row"]) -> dict[str, np.ndarray]:
    header = episode.header
    same = {
        "episode": header.key,
        "tower": header.blocks.tower,
        "round": header.round,
        "target": header.target,
        "turn": header.turn,
        "face": header.face,
    }
    keys = {name: np.full(len(frames), value) for name, value in same.items()}
    return keys | {"frame": frames}


def _state(taken: Sequence[tuple[Episode, Int[np.ndarray, " _"]]]) -> Rows:
    blocks = len(taken[0][0].header.blocks)
    count = [len(frames) for _, frames in taken]
    same = {
        "block_size": [episode.header.blocks.size for episode, _ in taken],
        "block_mass": [episode.header.blocks.mass for episode, _ in taken],
        "block_wedge": [episode.header.blocks.wedge for episode, _ in taken],
        "level": [episode.header.layout.level for episode, _ in taken],
        "slot": [episode.header.layout.slot for episode, _ in taken],
    }
    rows: Rows = {name: np.repeat(np.stack(values), count, axis=0) for name, values in same.items()}
    pose = in_steps(np.concatenate([episode.pose[frames] for episode, frames in taken]), POSE_STEP)
    twist = in_steps(np.concatenate([episode.twist[frames] for episode, frames in taken]), TWIST_STEP)
    offset, upper, lower = support_lists(pose, np.asarray(rows["block_size"]))
    contacts = [episode.contacts[f] for episode, frames in taken for f in frames.tolist()]
    force = in_steps(edge_forces(contacts, offset, upper, lower, blocks), FORCE_STEP)
    edges = {"edge_upper": upper, "edge_lower": lower, "edge_force": force}
    rows |= {"block_pose": pose, "block_twist": twist}
    return rows | {name: Ragged(offset, values) for name, values in edges.items()}


def in_steps(values: Float[np.ndarray, "*any"], step: float) -> Float[np.ndarray, "*any"]:
    """The nearest whole multiples of `step`, a power of two: noise below it would make most of a file's bytes."""
    return np.round(values / step) * step


def edge_forces(
    contacts: Sequence[Contacts],
    offset: Int[np.ndarray, " row_and_one"],
    upper: Int[np.ndarray, " edge"],
    lower: Int[np.ndarray, " edge"],
    blocks: int,
) -> Float[np.ndarray, " edge"]:
    """Upward force that the lower block of each edge exerts on the upper one [N], summed over their contacts.

    Args:
        contacts: those of each row.
        offset: row i has the edges `offset[i]` to `offset[i + 1]`, sorted by upper, then lower block.
    """
    row = np.repeat(np.arange(len(contacts)), [len(c.first) for c in contacts])
    first, second, up = (
        np.concatenate([np.zeros(0, kind), *(part(c) for c in contacts)])
        for kind, part in ((int, lambda c: c.first), (int, lambda c: c.second), (float, lambda c: c.force[:, 2]))
    )
    between = (first >= 0) & (second >= 0) & (first < blocks) & (second < blocks)
    row, first, second, up = row[between], first[between], second[between], up[between]
    edge = (np.repeat(np.arange(len(contacts)), np.diff(offset)) * blocks + upper) * blocks + lower
    lifts = np.concatenate([(row * blocks + first) * blocks + second, (row * blocks + second) * blocks + first])
    at = np.minimum(np.searchsorted(edge, lifts), max(len(edge) - 1, 0))
    known = edge[at] == lifts if len(edge) else np.zeros(len(lifts), bool)
    lift = np.zeros(len(edge))
    np.add.at(lift, at[known], np.concatenate([up, -up])[known])
    return lift


def _labels(result: Result) -> dict[str, np.ndarray]:
    verdict = result.verdict
    labels = {
        "failure": verdict.failure,
        "strict_failure": verdict.strict_failure,
        "dragged": verdict.dragged,
        "outcome": str(verdict.outcome),
        "moved": verdict.moved,
    }
    return {name: np.full(1, value) for name, value in labels.items()}


def _motion(episode: Episode, number: Int[np.ndarray, " frame"]) -> dict[str, np.ndarray]:
    """What the first moments of a pull do to every block; an excerpt must hold the frames of those moments."""
    at = np.searchsorted(number, np.minimum(MOMENTS, number[-1]))
    moved = episode.pose[at, :, :3] - episode.pose[0, :, :3]
    return {"block_moved": in_steps(moved, MOVED_STEP)[None]}


def _transition(
    episode: Episode, result: Result, frames: Int[np.ndarray, " row"], number: Int[np.ndarray, " frame"]
) -> dict[str, np.ndarray]:
    clear, gripper = result.verdict.clear_frame, episode.gripper
    start, end = episode.time_ns[frames], episode.time_ns[frames + 1]
    return {
        "action": episode.action,
        "action_reached": episode.action_reached,
        "next_pose": in_steps(episode.pose[frames + 1], POSE_STEP),
        "next_twist": in_steps(episode.twist[frames + 1], TWIST_STEP),
        "left_force": step_means(gripper.time_ns, gripper.left_force, start, end),
        "right_force": step_means(gripper.time_ns, gripper.right_force, start, end),
        "target_clear": (number[frames] >= clear) & (clear >= 0),
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
    count = np.maximum(last - first, 0)
    step = np.repeat(np.arange(len(first)), count)
    sample = np.arange(len(step)) + np.repeat(first - (np.cumsum(count) - count), count)
    # Summed step by step: differences of one running sum would depend on all samples before, which may not be read.
    total = np.zeros((len(first), values.shape[1]))
    np.add.at(total, step, values[sample])
    return total / np.maximum(count, 1)[:, None]
