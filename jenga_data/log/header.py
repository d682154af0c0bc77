"""What an episode's file says of the whole episode: the header as metadata and /tower, and back."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from jenga_data.episode import EpisodeHeader, RobotModel
from jenga_data.errors import JengaError
from jenga_data.limits import MAX_CONFIG_BYTES, MAX_DEPTH, MAX_NAME
from jenga_data.log import codec, profile
from jenga_data.log.gather import Raw

_NEEDED = ("key", "kind", "seed", "number", "control_step_ns")


def write_metadata(header: EpisodeHeader) -> dict[str, str]:
    """The metadata record "jenga"."""
    return {
        "version": profile.version_text(),
        "key": header.key,
        "kind": header.kind,
        "seed": str(header.seed),
        "number": str(header.number),
        "checkpoint": header.checkpoint,
        "control_step_ns": str(header.control_step_ns),
    } | _repeated(header)


def _repeated(header: EpisodeHeader) -> dict[str, str]:
    """What /tower says too; repeated so that a search of files need not read messages."""
    return {
        "round": str(header.round),
        "target": str(header.target),
        "turn": str(header.turn),
        "face": str(header.face),
        "tower": header.blocks.tower,
    }


def write_config(config: Mapping[str, Any]) -> bytes:
    """The attachment config.json: the same bytes for the same config, whatever the order of its keys."""
    return json.dumps(config, sort_keys=True, indent=1, allow_nan=False).encode() + b"\n"


def check_kind(path: Path, raw: Raw) -> None:
    """Refuse what is no episode, or one of another major profile version.

    Raises:
        JengaError: with what was found and the way out.
    """
    metadata = raw.metadata.get(profile.EPISODE_METADATA)
    if raw.profile == profile.PREDICTION_PROFILE:
        raise JengaError(f"{path} is a model's prediction; give the episode that lies beside it")
    if metadata is None:
        if raw.damage:
            return  # It may have been there: the damage is what to say.
        raise JengaError(f"{path} is no jenga episode: it has no metadata record {profile.EPISODE_METADATA!r}")
    check_version(path, metadata.get("version", ""))


def check_version(path: Path, text: str) -> None:
    """Refuse another major profile version, older or newer.

    Raises:
        JengaError: with both versions and the way out.
    """
    major = text[:MAX_NAME].partition(".")[0]
    if major == str(profile.VERSION[0]):
        return
    out = "read it with the jenga that wrote it (its metadata record 'provenance' says which)"
    if major.isascii() and major.isdigit() and int(major) > profile.VERSION[0]:
        out = "install a newer jenga"
    raise JengaError(f"{path} has profile version {text[:MAX_NAME]!r}, this jenga reads {profile.VERSION[0]}.x; {out}")


def read_header_of(raw: Raw) -> EpisodeHeader:
    """The header from metadata, /tower, /robot and config.json.

    Raises:
        ValueError: something is missing, out of range or contradicts itself.
    """
    metadata = raw.metadata.get(profile.EPISODE_METADATA, {})
    _check_lengths(metadata)
    if missing := [name for name in _NEEDED if not metadata.get(name)]:
        raise ValueError(f"metadata record {profile.EPISODE_METADATA!r} lacks {', '.join(missing)}")
    towers = raw.messages.get(profile.TOWER, [])
    if len(towers) != 1:
        raise ValueError(f"{len(towers)} messages on {profile.TOWER}; needed: 1")
    blocks, layout, tower = codec.read_tower(towers[0][1])
    header = EpisodeHeader(
        key=_file_name(metadata["key"]),
        kind=metadata["kind"],
        seed=_whole(metadata, "seed"),
        number=_whole(metadata, "number"),
        blocks=blocks,
        layout=layout,
        target=tower.target,
        turn=tower.turn,
        face=tower.face,
        config=_read_config(raw.attachments.get(profile.CONFIG)),
        checkpoint=metadata.get("checkpoint", ""),
        provenance=dict(raw.metadata.get(profile.PROVENANCE_METADATA, {})),
        control_step_ns=_whole(metadata, "control_step_ns"),
        robot=_read_robot(raw),
    )
    if header.control_step_ns <= 0:
        raise ValueError(f"control_step_ns is {header.control_step_ns}; allowed: more than 0")
    for name, value in _repeated(header).items():
        if metadata.get(name, value) != value:
            raise ValueError(f"metadata says {name} = {metadata[name][:MAX_NAME]!r}, {profile.TOWER} says {value}")
    return header


def _read_robot(raw: Raw) -> RobotModel | None:
    robots = raw.messages.get(profile.ROBOT, [])
    if len(robots) > 1:
        raise ValueError(f"{len(robots)} messages on {profile.ROBOT}; allowed: 1")
    try:
        return codec.read_robot(robots[0][1]) if robots else None
    except ValueError as error:
        raise ValueError(f"{profile.ROBOT}: {error}") from None


def _whole(metadata: Mapping[str, str], name: str) -> int:
    try:
        return int(metadata[name])
    except ValueError:
        raise ValueError(f"metadata {name} is {metadata[name][:40]!r}; allowed: a whole number") from None


def _read_config(data: bytes | None) -> dict[str, Any]:
    if data is None:
        return {}
    if len(data) > MAX_CONFIG_BYTES:
        raise ValueError(f"attachment {profile.CONFIG} of {len(data)} bytes; allowed: {MAX_CONFIG_BYTES}")
    try:
        config = json.loads(data)
    except (ValueError, RecursionError):
        raise ValueError(f"attachment {profile.CONFIG} is no JSON") from None
    if not isinstance(config, dict):
        raise ValueError(f"attachment {profile.CONFIG} is no JSON object")
    level: list[Any] = [config]
    for _ in range(MAX_DEPTH):
        level = [v for value in level for v in _inner(value)]
    if level:
        raise ValueError(f"attachment {profile.CONFIG} is nested more than {MAX_DEPTH} deep")
    return config


def _inner(value: object) -> Iterable[Any]:
    return value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()


def _check_lengths(metadata: Mapping[str, str]) -> None:
    """What stands in every row of a dataset, and in messages, is short."""
    for name, value in metadata.items():
        if name in (*_NEEDED, "checkpoint") and len(value) > MAX_NAME:
            raise ValueError(f"metadata {name} has {len(value)} characters; allowed: {MAX_NAME}")


def _file_name(key: str) -> str:
    """A key names files: it must not lead anywhere else."""
    if not key.isprintable() or key.startswith(".") or any(c in key for c in "/\\:"):
        raise ValueError(f"metadata key is {key!r}; allowed: a plain file name")
    return key
