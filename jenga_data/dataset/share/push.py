"""Putting a dataset at an address: data first, the manifest last, so that no reader meets half a dataset."""

import hashlib
import time
from dataclasses import dataclass
from pathlib import Path

from jenga_data.dataset.check_files import check_hashes
from jenga_data.dataset.manifest import DATA, MANIFEST, File, canonical_bytes
from jenga_data.dataset.read import Dataset, open_dataset
from jenga_data.dataset.share.fetch import read_manifest_bytes
from jenga_data.dataset.share.remote import Remote, connect
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.progress import progress


@dataclass(frozen=True)
class Pushed:
    """What `jenga dataset push --json` prints. `sent` files were transferred, `kept` ones lay there already."""

    dataset: str
    hash: str
    address: str
    sent: int
    sent_bytes: int
    kept: int
    seconds: float


def push(where: str | Path, address: str) -> Pushed:
    """Copy a dataset, given by folder or NAME@X.Y.Z, to `address`.

    Every file is read back from there and its SHA-256 compared before the manifest follows. Files that lie there
    with the right hash are not sent again, so the same command goes on where it was interrupted. The manifest is
    the same to the byte: a dataset never changes, not even by saying where it lies.

    Raises:
        JengaError: there is no such dataset, the address holds another one, or the connection broke.
        CheckFailed: the dataset is damaged here, or arrived damaged.
    """
    start = time.monotonic()
    dataset = open_dataset(where)
    manifest = dataset.manifest
    for line in check_hashes(dataset.folder, manifest):
        raise CheckFailed(f"{dataset.folder}: {line}; a damaged dataset is not pushed")
    remote = connect(address)
    sent = sent_bytes = kept = 0
    with remote.talking():
        _refuse_another(remote, dataset)
        with progress(f"push {manifest.identifier} [MB]", sum(f.bytes for f in manifest.files) / 1e6) as bar:
            for entry in manifest.files:
                if _is_there(remote, entry):
                    kept += 1
                else:
                    _send(remote, entry, dataset.folder)
                    sent, sent_bytes = sent + 1, sent_bytes + entry.bytes
                bar.advance(entry.bytes / 1e6, note=entry.path)
        remote.write(MANIFEST, dataset.folder / MANIFEST)
        if read_manifest_bytes(remote) != canonical_bytes(manifest):
            raise CheckFailed(f"{MANIFEST} arrived damaged at {remote.name}: run the same command again")
    seconds = round(time.monotonic() - start, 3)
    return Pushed(manifest.identifier, manifest.hash, remote.name, sent, sent_bytes, kept, seconds)


def _refuse_another(remote: Remote, dataset: Dataset) -> None:
    """An address holds one version for ever: whoever pulls from it later must get what was cited."""
    try:
        found = read_manifest_bytes(remote)
    except FileNotFoundError:
        found = b""
    if found and found != canonical_bytes(dataset.manifest):
        raise JengaError(
            f"{remote.name} holds another dataset than {dataset.manifest.identifier} "
            f"({dataset.manifest.hash[:12]}...), and a dataset never changes: choose another address"
        )
    listed = {f.path for f in dataset.manifest.files}
    if foreign := [path for path in remote.files(DATA) if path not in listed and not path.endswith(".partial")]:
        raise JengaError(f"{remote.name} holds {foreign[0]}, which is not of this dataset: choose another address")


def _is_there(remote: Remote, entry: File) -> bool:
    """Whether the file lies there with the right content; it is read for that."""
    try:
        return remote.size(entry.path) in (None, entry.bytes) and _remote_sha256(remote, entry) == entry.sha256
    except FileNotFoundError:
        return False


def _send(remote: Remote, entry: File, folder: Path) -> None:
    remote.write(entry.path, folder / entry.path)
    if not _is_there(remote, entry):
        raise CheckFailed(f"{entry.path} arrived damaged at {remote.name}: run the same command again")


def _remote_sha256(remote: Remote, entry: File) -> str:
    digest = hashlib.sha256()
    for block in remote.read(entry.path, entry.bytes):
        digest.update(block)
    return digest.hexdigest()
