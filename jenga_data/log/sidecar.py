"""A model's prediction for one episode, in an MCAP file beside it.

Its topics add to the episode's, so that a viewer that has both in one recording (Foxglove, `jenga replay`) draws the
prediction as a translucent ghost over the truth; rerun opens two files as two recordings. It names the episode's
hash and the checkpoint's, and is refused where either has changed.
"""

import re
from pathlib import Path

import numpy as np
from google.protobuf.message import Message

from jenga_data.episode import Episode, Prediction
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.log import codec, profile
from jenga_data.log.gather import Raw, gather, refuse_damage
from jenga_data.log.header import check_version
from jenga_data.log.output import Output
from jenga_data.log.proto import jenga_pb2 as pb
from jenga_data.log.records import one_line, open_log, walk
from jenga_data.log.urdf import block_link, ghost_urdf
from jenga_data.log.viewer import Transforms

KINDS = ("one_step", "open_loop")
_NAME = re.compile(r"[A-Za-z0-9_.-]+")
_MESSAGES = {"prediction": pb.Prediction, "state": pb.PredictedState}


def write_prediction(path: Path, episode: Episode, episode_sha256: str, prediction: Prediction) -> None:
    """Write a prediction for `episode`, whose file has the hash `episode_sha256`; replaces an older one.

    Raises:
        JengaError: the name or kind is not allowed, a frame is not in the episode, or it cannot be written.
    """
    _check(prediction, episode)
    root = f"/model/{prediction.name}"
    blocks, target = episode.header.blocks, episode.header.target
    prefix = f"{prediction.name}/"
    start = int(episode.time_ns[0])
    transforms = Transforms([prefix + block_link(i) for i in range(len(blocks))])
    out = Output(path, profile.PREDICTION_PROFILE)
    try:
        out.metadata(profile.EPISODE_METADATA, {"version": profile.version_text()})
        out.message(f"{root}/prediction", _head(episode, episode_sha256, prediction), start)
        out.text(f"{root}/{profile.ROBOT_DESCRIPTION[1:]}", ghost_urdf(blocks.size, target, prefix), start)
        for frame, pose in zip(prediction.frame.tolist(), prediction.pose, strict=True):
            time_ns = int(episode.time_ns[frame])
            data = pb.PredictedState(frame=frame).SerializeToString()
            data += codec.packed(pb.PredictedState.POSE_FIELD_NUMBER, pose)
            out.packed(f"{root}/state", pb.PredictedState, data, time_ns)
            out.message(f"{root}{profile.TF}", transforms.fill(pose, time_ns), time_ns)
        out.commit()
    except BaseException:
        out.discard()
        raise


def read_prediction(path: Path, *, episode_key: str, episode_sha256: str, checkpoint: str) -> Prediction:
    """Read a prediction back if it was made for this very episode by this very checkpoint.

    Raises:
        JengaError: no prediction, or of another major profile version.
        CheckFailed: damaged, or stale: made for another episode or by another checkpoint.
    """
    with one_line(path):
        with open_log(path) as stream:
            raw = gather(walk(stream), _kind_of)
        _check_kind(path, raw)
        refuse_damage(path, raw, "delete it and run jenga replay again")
        head, states = _read(raw)
        for what, found, needed in (
            ("episode", head.episode, episode_key),
            ("episode file", head.episode_sha256, episode_sha256),
            ("checkpoint", head.checkpoint, checkpoint),
        ):
            if found != needed:
                raise CheckFailed(
                    f"{path} is stale: made for {what} {found[:16]}, here is {needed[:16]};"
                    " delete it and run jenga replay again"
                )
        failure = codec.doubles(head.failure_probability, -1)
        poses = [codec.doubles(state.pose, len(failure), 7) for state in states]
        return Prediction(
            name=head.name,
            checkpoint=head.checkpoint,
            kind=head.kind,
            frame=np.array([state.frame for state in states], np.int64),
            pose=np.array(poses).reshape(-1, len(failure), 7),
            failure_probability=failure,
        )


def _kind_of(topic: str) -> type[Message] | None:
    _, model, _, last = [*topic.split("/"), "", "", ""][:4]
    return _MESSAGES.get(last) if model == "model" else None


def _check(prediction: Prediction, episode: Episode) -> None:
    if not _NAME.fullmatch(prediction.name):
        raise JengaError(f"model name {prediction.name!r}; allowed: letters, digits and _ . -")
    if prediction.kind not in KINDS:
        raise JengaError(f"prediction kind {prediction.kind!r}; allowed: {', '.join(KINDS)}")
    last = len(episode.time_ns) - 1
    if prediction.frame.size and not 0 <= prediction.frame.min() <= prediction.frame.max() <= last:
        low, high = prediction.frame.min(), prediction.frame.max()
        raise JengaError(f"prediction for frames {low} to {high}; the episode has frames 0 to {last}")


def _head(episode: Episode, episode_sha256: str, prediction: Prediction) -> pb.Prediction:
    return pb.Prediction(
        episode=episode.header.key,
        episode_sha256=episode_sha256,
        name=prediction.name,
        checkpoint=prediction.checkpoint,
        kind=prediction.kind,
        failure_probability=prediction.failure_probability.tolist(),
    )


def _check_kind(path: Path, raw: Raw) -> None:
    if raw.profile != profile.PREDICTION_PROFILE:
        raise JengaError(
            f"{path} is no prediction: its MCAP profile is {raw.profile!r}; give one that jenga replay wrote"
        )
    if profile.EPISODE_METADATA in raw.metadata:
        check_version(path, raw.metadata[profile.EPISODE_METADATA].get("version", ""))


def _read(raw: Raw) -> tuple[pb.Prediction, list[pb.PredictedState]]:
    by_kind: dict[str, list[bytes]] = {"prediction": [], "state": []}
    for topic, messages in raw.messages.items():
        by_kind[topic.rpartition("/")[2]] += [data for _, data in messages]
    if len(by_kind["prediction"]) != 1:
        raise ValueError(f"{len(by_kind['prediction'])} messages on /model/<name>/prediction; needed: 1")
    states = [codec.parse(pb.PredictedState, data) for data in by_kind["state"]]
    return codec.parse(pb.Prediction, by_kind["prediction"][0]), states
