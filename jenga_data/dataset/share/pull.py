"""Getting a dataset, or a part of it, from an address: whole or not at all, and at the second try only the rest."""

import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock, Timeout

from jenga_data.dataset.manifest import File, Manifest
from jenga_data.dataset.read import Dataset
from jenga_data.dataset.schema import EPISODES
from jenga_data.dataset.share.fetch import fetch, fetch_manifest, refuse_too_much
from jenga_data.dataset.share.part import Part, choose, files_of, part_of, sources_of, write_part
from jenga_data.dataset.share.remote import Remote, connect
from jenga_data.dataset.staging import refuse_existing
from jenga_data.errors import JengaError
from jenga_data.progress import Bar, progress


@dataclass(frozen=True)
class Pulled:
    """What `jenga dataset pull --json` prints. `fetched` files were transferred, `kept` ones had come before."""

    dataset: str
    hash: str
    out: str
    rows: int
    episodes: int
    fetched: int
    fetched_bytes: int
    kept: int
    seconds: float


def pull(address: str, out: Path, split: str = "", episodes: Sequence[str] = ()) -> Pulled:
    """Get the dataset at `address` into the new folder `out`.

    Files arrive in the hidden folder `.OUT.partial` beside it, are checked there against the manifest's SHA-256 and
    stay if this is interrupted: the next try fetches the rest. With `split` or `episodes` only the files that hold
    wanted rows are fetched, and `out` becomes a dataset of the wanted rows alone whose parent is the whole.

    Args:
        split: "train", "validation" or "test", several joined by "+"; "" for all.
        episodes: keys of episodes; of those in `split`, none for all.

    Raises:
        JengaError: `out` exists, there is no dataset, no such part, no room, or the connection broke.
        CheckFailed: a file is missing or damaged.
    """
    start = time.monotonic()
    refuse_existing(out)
    part = part_of(split, episodes)
    remote = connect(address)
    with _staging(out) as staging, remote.talking():
        whole = staging / "whole"
        manifest = fetch_manifest(remote, whole)
        transfer = _Transfer(remote, manifest.identifier, whole)
        if part.splits or part.episodes:
            ready, manifest = staging / "part", _pull_part(transfer, part, manifest, staging / "part")
        else:
            transfer.get(manifest.files)
            ready = whole
        refuse_existing(out)
        ready.rename(out)
    return Pulled(
        dataset=manifest.identifier,
        hash=manifest.hash,
        out=str(out),
        rows=manifest.counts.rows,
        episodes=manifest.counts.episodes,
        fetched=transfer.fetched,
        fetched_bytes=transfer.bytes,
        kept=transfer.kept,
        seconds=round(time.monotonic() - start, 3),
    )


def _pull_part(transfer: "_Transfer", part: Part, manifest: Manifest, folder: Path) -> Manifest:
    """Fetch what holds the part, and write it as a dataset. Whole files are fetched: only they have a hash."""
    transfer.get([f for f in manifest.files if f.path == EPISODES])
    whole = Dataset(transfer.folder, manifest, manifest.hash)
    sources = sources_of(whole.episodes())
    chosen = choose(part, manifest, sources)
    files = files_of(manifest, sources, chosen)
    transfer.get(files)
    shutil.rmtree(folder, ignore_errors=True)
    return write_part(whole, part, chosen, files, folder)


class _Transfer:
    """Fetches files into a folder and counts."""

    def __init__(self, remote: Remote, identifier: str, folder: Path) -> None:
        self._remote = remote
        self._identifier = identifier
        self.folder = folder
        self.fetched = self.bytes = self.kept = 0

    def get(self, files: Sequence[File]) -> None:
        refuse_too_much(self._remote, files, self.folder)
        with progress(f"pull {self._identifier} [MB]", sum(f.bytes for f in files) / 1e6) as bar:
            for entry in files:
                self._one(entry, bar)

    def _one(self, entry: File, bar: Bar) -> None:
        transferred = fetch(self._remote, entry, self.folder)
        self.bytes += transferred
        self.fetched += transferred > 0
        self.kept += transferred == 0
        bar.advance(entry.bytes / 1e6, note=entry.path)


@contextmanager
def _staging(out: Path) -> Iterator[Path]:
    """The folder beside `out` in which files arrive, for one process at a time; removed once `out` is there."""
    folder = out.with_name(f".{out.name}.partial")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with FileLock(folder / "lock", timeout=0):
            yield folder
        shutil.rmtree(folder)
    except Timeout as error:
        raise JengaError(f"{out} is being pulled by another process: wait for it") from error
    except OSError as error:
        raise JengaError(f"cannot write {out}: {error.strerror or error}; what was fetched is in {folder}") from error
