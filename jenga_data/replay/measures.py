"""What a replay plots of an episode: arrays from arrays, shared by rerun and by the pictures."""

import numpy as np
from jaxtyping import Float, Int

from jenga_data.episode import Episode, Prediction

MM = 1e3
"""Millimetres in a metre."""


def seconds(episode: Episode) -> Float[np.ndarray, " frame"]:
    """Time of each frame since the first one [s]."""
    return (episode.time_ns - episode.time_ns[0]) * 1e-9


def seconds_of(episode: Episode, time_ns: Int[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    """Any of the log's times since the first frame [s]."""
    return (time_ns - episode.time_ns[0]) * 1e-9


def frame_at(episode: Episode, time_ns: Int[np.ndarray, "*batch"]) -> Int[np.ndarray, "*batch"]:
    """The last frame that is not later than each time."""
    return np.clip(np.searchsorted(episode.time_ns, time_ns, side="right") - 1, 0, len(episode.time_ns) - 1)


def others(episode: Episode) -> Int[np.ndarray, " other"]:
    """All blocks but the target."""
    return np.delete(np.arange(episode.pose.shape[1]), episode.header.target)


def displacement(episode: Episode) -> Float[np.ndarray, "frame block"]:
    """How far each block's centre is from where it was at the first frame [m]."""
    return np.linalg.norm(episode.pose[..., :3] - episode.pose[0, :, :3], axis=-1)


def largest_displacement_of_others(episode: Episode) -> Float[np.ndarray, " frame"]:
    """The farthest that any block but the target is from its start [m]."""
    return displacement(episode)[:, others(episode)].max(axis=1)


def position_error(episode: Episode, prediction: Prediction) -> Float[np.ndarray, "prediction block"]:
    """Distance between each block's predicted and true centre at the predicted frames [m]."""
    truth = episode.pose[prediction.frame, :, :3]
    return np.linalg.norm(prediction.pose[..., :3] - truth, axis=-1)


def standing_still_error(episode: Episode, prediction: Prediction) -> Float[np.ndarray, "prediction block"]:
    """The same for the trivial model, that nothing moves from the state in which the prediction starts [m]."""
    known = prediction.frame - 1
    if prediction.kind == "open_loop":
        known = np.full_like(known, known[0] if len(known) else 0)
    start = episode.pose[np.maximum(known, 0), :, :3]
    return np.linalg.norm(start - episode.pose[prediction.frame, :, :3], axis=-1)


def root_mean_square(value: Float[np.ndarray, "row block"]) -> Float[np.ndarray, " row"]:
    """Over the blocks of each row."""
    return np.sqrt((value**2).mean(axis=1))


def phase_name(episode: Episode, frame: int) -> str:
    """The phase that frame belongs to, "" before the first."""
    name = ""
    for phase in episode.phases:
        if phase.frame <= frame:
            name = phase.name
    return name
