"""Hashes of log files, and the name of what a model says of one."""

import hashlib
from pathlib import Path

from jenga_data.errors import JengaError


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, in hex.

    Raises:
        JengaError: it cannot be read.
    """
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise JengaError(f"cannot read {path}: {error.strerror or error}") from error


def prediction_path(episode: Path, checkpoint: str, kind: str) -> Path:
    """Where the prediction of one checkpoint for one episode lies: beside the episode, named by both."""
    return episode.with_name(f"{episode.name.removesuffix('.mcap')}.{kind}-{checkpoint[:12]}.prediction.mcap")
