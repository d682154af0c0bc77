"""Where logs lie: in folders that somebody names, and in the known places. A log is known by its hash, not its name."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from jenga_data.errors import JengaError
from jenga_data.log.files import file_sha256

SEARCH_PATH = "JENGA_LOGS"
"""Environment variable: folders of logs, separated as in PATH."""
SAMPLES = Path("datasets_manifest/samples")


@dataclass(frozen=True)
class AtHand:
    """The log with the wanted bytes, None if there is none, and files that have only its name."""

    log: Path | None
    namesakes: list[Path]


def log_folders(named: Sequence[Path] = ()) -> list[Path]:
    """Where logs are looked for: the named folders, $JENGA_LOGS, the current folder's `logs`, and the samples of the
    current folder and of the checkout.

    Raises:
        JengaError: a named folder does not exist.
    """
    for folder in named:
        if not folder.is_dir():
            raise JengaError(f"no such folder: {folder}; --logs names folders of MCAP logs")
    own = [Path(p) for p in os.environ.get(SEARCH_PATH, "").split(os.pathsep) if p]
    checkout = Path(__file__).resolve().parents[2]
    known = [*named, *own, Path("logs"), SAMPLES, checkout / SAMPLES]
    return [p for p in dict.fromkeys(path.resolve() for path in known) if p.is_dir()]


def find_log(folders: Sequence[Path], name: str, size: int, sha256: str) -> AtHand:
    """Look for a log of `size` bytes and this hash below the folders, whatever it is called there.

    Raises:
        JengaError: a file of that size or name cannot be read.
    """
    namesakes = []
    for path in _logs_below(folders):
        if path.stat().st_size == size and file_sha256(path) == sha256:
            return AtHand(path, namesakes)
        if path.name == name:
            namesakes.append(path)
    return AtHand(None, namesakes)


def _logs_below(folders: Sequence[Path]) -> Iterator[Path]:
    for folder in folders:
        yield from (path for path in sorted(folder.rglob("*.mcap")) if path.is_file())
