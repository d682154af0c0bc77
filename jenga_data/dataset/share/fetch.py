"""Getting single files of a dataset from elsewhere: nothing gets its name before its hash is right."""

import hashlib
import shutil
from collections.abc import Iterable
from pathlib import Path

from jenga_data.dataset.manifest import MANIFEST, File, Manifest, load_manifest
from jenga_data.dataset.share.remote import Remote
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.limits import MAX_MANIFEST_BYTES
from jenga_data.log.files import file_sha256

_INCOMING = "incoming"
"""The file that is being fetched, beside the folder of those that have arrived: no listed path can meet it."""


def read_manifest_bytes(remote: Remote) -> bytes:
    """The bytes of the manifest at an address, not checked yet but for their number.

    Raises:
        FileNotFoundError: there is none.
        CheckFailed: it is absurdly large.
    """
    return b"".join(remote.read(MANIFEST, MAX_MANIFEST_BYTES))


def fetch_manifest(remote: Remote, folder: Path) -> Manifest:
    """Get the manifest into `folder`. What lies there of another version is removed.

    Raises:
        JengaError: there is none, or it is not valid.
        CheckFailed: it was damaged.
    """
    try:
        raw = read_manifest_bytes(remote)
    except FileNotFoundError as error:
        raise JengaError(f"no dataset at {remote.name}: there is no {MANIFEST}; push one there first") from error
    path = folder / MANIFEST
    if not path.is_file() or path.read_bytes() != raw:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        path.write_bytes(raw)
    try:
        return load_manifest(folder)
    except JengaError as error:
        shutil.rmtree(folder)
        raise type(error)(str(error).replace(str(path), f"{MANIFEST} at {remote.name}")) from error


def refuse_too_much(remote: Remote, files: Iterable[File], folder: Path) -> None:
    """Before anything is fetched: is there room, and is every file as long as the manifest says?

    Raises:
        JengaError: the disk has no room for the files.
        CheckFailed: a file is missing or has another size.
    """
    missing = [f for f in files if not _is_there(f, folder)]
    wanted, free = sum(f.bytes for f in missing), shutil.disk_usage(folder).free
    if wanted > free:
        raise JengaError(f"{remote.name} needs {wanted} bytes and the disk has {free}: make room, or pull a part")
    for entry in missing:
        _check_size(remote, entry)


def fetch(remote: Remote, entry: File, folder: Path) -> int:
    """Get one file into `folder`, unless it has arrived before. Returns the bytes that were transferred.

    Raises:
        CheckFailed: it is missing, or is not what the manifest says.
    """
    target = folder / entry.path
    if _is_there(entry, folder):
        return 0
    incoming = folder.parent / _INCOMING
    digest = hashlib.sha256()
    with incoming.open("wb") as file:
        for block in remote.read(entry.path, entry.bytes):
            digest.update(block)
            file.write(block)
    if digest.hexdigest() != entry.sha256:
        incoming.unlink()
        found = digest.hexdigest()[:12]
        raise CheckFailed(
            f"{entry.path} at {remote.name} has SHA-256 {found}..., not {entry.sha256[:12]}...: it is damaged there, "
            "and was not kept"
        )
    target.parent.mkdir(parents=True, exist_ok=True)
    incoming.replace(target)
    return entry.bytes


def _is_there(entry: File, folder: Path) -> bool:
    path = folder / entry.path
    return path.is_file() and path.stat().st_size == entry.bytes and file_sha256(path) == entry.sha256


def _check_size(remote: Remote, entry: File) -> None:
    try:
        size = remote.size(entry.path)
    except FileNotFoundError as error:
        raise CheckFailed(f"{entry.path} is missing at {remote.name}: get the dataset elsewhere") from error
    if size not in (None, entry.bytes):
        raise CheckFailed(
            f"{entry.path} at {remote.name} has {size} bytes, not {entry.bytes}: it is damaged there, and not fetched"
        )
