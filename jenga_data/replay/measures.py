"""What a replay plots of an episode: arrays from arrays, shared by rerun and by the pictures."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from jenga_data.episode import Episode, Prediction
from jenga_data.errors import JengaError
from jenga_data.geometry import in_table_frame

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


def moment(episode: Episode, time: float | None, frame: int | None) -> float:
    """Seconds since the first frame of the moment that somebody asks for; the start if they do not.

    Raises:
        JengaError: both are given, or the episode has no such moment.
    """
    end, last = float(seconds(episode)[-1]), len(episode.time_ns) - 1
    if time is not None and frame is not None:
        raise JengaError("--time and --frame exclude each other; allowed: one of them")
    if frame is not None and not 0 <= frame <= last:
        raise JengaError(f"--frame is {frame}; episode {episode.header.key} has frames 0 to {last}")
    if time is not None and not 0 <= time <= end:
        raise JengaError(f"--time is {time}; episode {episode.header.key} goes from 0 to {end:.3f} s")
    return float(seconds(episode)[frame]) if frame is not None else time or 0.0


def samples_at_frames(episode: Episode) -> Int[np.ndarray, " frame"]:
    """The gripper's last sample that is not later than each frame, the first one before there is any."""
    return np.maximum(np.searchsorted(episode.gripper.time_ns, episode.time_ns, side="right") - 1, 0)


def others(episode: Episode) -> Int[np.ndarray, " other"]:
    """All blocks but the target."""
    return np.delete(np.arange(episode.pose.shape[1]), episode.header.target)


def displacement(episode: Episode) -> Float[np.ndarray, "frame block"]:
    """How far each block's centre is from where it was on the turntable at the first frame [m]."""
    pose = in_table_frame(episode.pose, episode.turntable)
    return np.linalg.norm(pose[..., :3] - pose[0, :, :3], axis=-1)


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


def error_scale(episode: Episode, prediction: Prediction) -> float:
    """Where the colours of a model's errors end [m]: beyond 99 % of them."""
    return round_scale(max(float(np.percentile(position_error(episode, prediction), 99)), 1e-4))


def metres_per_newton(force: Float[np.ndarray, "contact 3"]) -> float:
    """Scale of an episode's arrows: 95 % of them are at most 3 cm long, two blocks' heights, and 99 % at most 15 cm."""
    usual, strong = np.percentile(np.linalg.norm(force, axis=1), [95, 99]) if len(force) else (0.0, 0.0)
    return 0.01 / round_scale(max(float(usual) / 3, float(strong) / 15, 0.1))


def frames_without(episode: Episode, prediction: Prediction) -> Int[np.ndarray, " frame"]:
    """Frames at which what was drawn for a prediction must go away: the first one, and those after a run of it."""
    edge = np.setdiff1d(np.append(prediction.frame + 1, 0), prediction.frame)
    return edge[edge < len(episode.time_ns)]


def has_chances(prediction: Prediction) -> bool:
    """Whether a selector said anything about failure."""
    return bool(np.isfinite(prediction.failure_probability).any())


def model_labels(predictions: Sequence[Prediction]) -> list[str]:
    """A name for each prediction that no other has: its model and kind, and its checkpoint where those are the same."""
    plain = [f"{p.name} {p.kind.replace('_', ' ')}" for p in predictions]
    return [
        f"{label} {p.checkpoint[-8:]}" if plain.count(label) > 1 else label
        for label, p in zip(plain, predictions, strict=True)
    ]


def round_scale(value: float) -> float:
    """The next of 1, 2, 5, 10, ... above a positive value: the end of a colour scale that a person can read."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value * (1 - 1e-9)))
