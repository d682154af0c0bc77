"""Writing a dataset's folder so that it appears whole or not at all."""

import hashlib
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from jenga_data.dataset.manifest import File
from jenga_data.errors import JengaError


def refuse_existing(out: Path) -> None:
    """A dataset never changes.

    Raises:
        JengaError: something lies at `out` already.
    """
    if out.exists() or out.is_symlink():
        raise JengaError(f"{out} exists, and a dataset never changes: choose another folder, or remove it first")


@contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """A folder beside `out` that gets its name when the body is through, and is removed when it is not.

    Raises:
        JengaError: `out` exists, or the system refused to write (full, read-only).
    """
    refuse_existing(out)
    folder = out.with_name(f".{out.name}.{secrets.token_hex(4)}.partial")
    try:
        folder.mkdir(parents=True)
        try:
            yield folder
            refuse_existing(out)
            folder.rename(out)
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    except OSError as error:
        raise JengaError(f"cannot write {out}: {error.strerror or error}; nothing was kept") from error


def file_entry(folder: Path, path: str, rows: int) -> File:
    """Size and hash of a written file, for the manifest."""
    with (folder / path).open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return File(path, (folder / path).stat().st_size, rows, digest)
