"""Predictions of a checkpoint over a logged episode, for replay to draw over the truth."""

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from jenga_data.episode import Episode, Prediction
from jenga_data.errors import JengaError
from jenga_data.log.files import file_sha256, prediction_path
from jenga_data.log.reader import read_episode
from jenga_data.log.sidecar import read_prediction, write_prediction
from jenga_models.ahead import answers_plans, plan_ahead
from jenga_models.checkpoint import Checkpoint, load
from jenga_models.columns import Towers
from jenga_models.metrics import advance
from jenga_models.predict import Selector, opened

ONE_STEP = "one_step"
OPEN_LOOP = "open_loop"


def overlay(checkpoint: Checkpoint | Path, path: Path, kind: str = ONE_STEP, start: int = 0) -> Prediction:
    """The prediction of a checkpoint for the episode logged at `path`, kept in a sidecar file beside it.

    A selector says its probabilities, whatever `kind`; `start` is the frame at which an open loop begins. What a
    sidecar of this checkpoint holds already is not computed again.

    Raises:
        JengaError: the log or the checkpoint cannot be read or do not fit, `kind` is unknown, or the sidecar
            cannot be written.
        CheckFailed: the sidecar was made for another content of the log.
    """
    checkpoint = checkpoint if isinstance(checkpoint, Checkpoint) else load(checkpoint)
    if kind not in (ONE_STEP, OPEN_LOOP):
        raise JengaError(f"unknown kind of prediction {kind!r}; allowed: {ONE_STEP}, {OPEN_LOOP}")
    kind = ONE_STEP if checkpoint.kind == "selection" else kind
    episode, sha256 = read_episode(path), file_sha256(path)
    sidecar = prediction_path(path, checkpoint.hash, kind)
    if sidecar.exists():
        known = read_prediction(
            sidecar, episode_key=episode.header.key, episode_sha256=sha256, checkpoint=checkpoint.hash
        )
        if kind != OPEN_LOOP or known.frame[0] == _actions(episode, start)[0][0] + 1:
            return known
    if checkpoint.kind == "selection":
        prediction = predict_selection(checkpoint, episode)
    elif kind == ONE_STEP:
        prediction = predict_one_step(checkpoint, episode)
    else:
        prediction = predict_open_loop(checkpoint, episode, start)
    write_prediction(sidecar, episode, sha256, prediction)
    return prediction


def predict_one_step(checkpoint: Checkpoint | Path, episode: Episode) -> Prediction:
    """The tower after every action of the episode, each from the true tower before it.

    Raises:
        JengaError: the checkpoint is no simulator, or the episode has no actions.
    """
    checkpoint = opened(checkpoint, "dynamics")
    frame, action = _actions(episode, 0)
    towers = _towers(episode, episode.pose[frame], episode.twist[frame])
    pose = advance(checkpoint, towers, action, lag=episode.lag[np.isin(episode.action_frame, frame)])
    return _prediction(checkpoint, ONE_STEP, episode, frame + 1, pose)


def predict_open_loop(checkpoint: Checkpoint | Path, episode: Episode, start: int = 0) -> Prediction:
    """The tower after every action from frame `start` on, from the true tower there and then the model's own.

    Raises:
        JengaError: the checkpoint is no simulator, or no action comes at or after `start`.
    """
    checkpoint = opened(checkpoint, "dynamics")
    frame, action = _actions(episode, start)
    run = np.arange(len(frame)) + frame[0] == frame  # up to the first gap between actions
    frame, action = frame[run], action[run]
    if answers_plans(checkpoint):
        at = frame[:1]
        towers = _towers(episode, episode.pose[at], episode.twist[at])
        lag = episode.lag[episode.action_frame == frame[0]]
        pose = plan_ahead(checkpoint, towers, action[None], lag).pose[0]
        return _prediction(checkpoint, OPEN_LOOP, episode, frame + 1, pose)
    poses = [episode.pose[frame[0]]]
    for now in action:
        poses.append(advance(checkpoint, _towers(episode, poses[-1][None]), now[None])[0])
    return _prediction(checkpoint, OPEN_LOOP, episode, frame + 1, np.stack(poses[1:]))


def predict_selection(checkpoint: Checkpoint | Path, episode: Episode) -> Prediction:
    """The probability that pulling each legal target fails, in the tower of frame 0; no poses.

    Raises:
        JengaError: the checkpoint is no selector.
    """
    checkpoint = opened(checkpoint, "selection")
    targets = episode.header.layout.legal_targets()
    probability = np.full(len(episode.header.blocks), np.nan)
    probability[targets] = Selector(checkpoint).failure_probability(episode.tower_state(0), targets)
    nothing = np.zeros((0, *episode.pose.shape[1:]))
    return _prediction(checkpoint, ONE_STEP, episode, np.zeros(0, np.int64), nothing, probability)


def _actions(episode: Episode, start: int) -> tuple[Int[np.ndarray, " action"], Float[np.ndarray, "action 3"]]:
    """Frames and displacements of the actions from `start` on whose next frame was logged as well."""
    chosen = (episode.action_frame >= start) & (episode.action_frame + 1 < len(episode.time_ns))
    frame, action = episode.action_frame[chosen], episode.action[chosen]
    if len(frame) == 0:
        last = f"the last is at frame {episode.action_frame[-1]}" if len(episode.action_frame) else "it has none"
        raise JengaError(f"episode {episode.header.key} has no action from frame {start} on: {last}")
    return frame, action


def _towers(
    episode: Episode, pose: Float[np.ndarray, "row block 7"], twist: Float[np.ndarray, "row block 6"] | None = None
) -> Towers:
    header, rows = episode.header, len(pose)

    def each(values: np.ndarray) -> np.ndarray:
        return np.broadcast_to(values, (rows, *values.shape))

    return Towers.of_poses(
        each(header.blocks.size),
        each(header.blocks.mass),
        pose,
        each(header.layout.level),
        each(header.layout.slot),
        np.full(rows, header.target),
        twist=twist,
    )


def _prediction(
    checkpoint: Checkpoint,
    kind: str,
    episode: Episode,
    frame: Int[np.ndarray, " prediction"],
    pose: Float[np.ndarray, "prediction block 7"],
    probability: Float[np.ndarray, " block"] | None = None,
) -> Prediction:
    unknown = np.full(len(episode.header.blocks), np.nan)
    name = re.sub(r"[^A-Za-z0-9_.-]", "_", checkpoint.name)
    return Prediction(
        name,
        checkpoint.hash,
        kind,
        frame,
        pose.astype(float),
        unknown if probability is None else probability,
    )
