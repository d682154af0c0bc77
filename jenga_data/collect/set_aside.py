"""Episodes that could not be made, set aside so that the others are: which, why, and what was written of them."""

import traceback
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import msgspec

from jenga_data.errors import CheckFailed
from jenga_data.log.output import PARTIAL, partial_path
from jenga_data.pool import Failure, Lost

FOLDER = "set_aside"
"""Below a collection: `KEY.json` says why, `KEY.partial` is the log as far as it was written, if there is one."""
GIVE_UP = 10
"""So many episodes set aside, and none made, are the doing of the machine or of the code, not of a tower."""


@dataclass(frozen=True)
class Bug:
    """What an episode raised that no user caused. It is the same each time, so it is not tried again."""

    reason: str
    traceback: str

    @classmethod
    def of(cls, error: Exception) -> "Bug":
        text = " ".join(str(error).split())
        return cls(f"{type(error).__name__}: {text}".removesuffix(": "), traceback.format_exc())


@dataclass(frozen=True)
class SetAside:
    """One episode that was given up, as `OUT/set_aside/KEY.json` holds it."""

    number: int
    seed: int
    episode: str
    """Its key."""
    reason: str
    """Of the last try, in one line."""
    tries: tuple[Failure, ...]
    """How each try ended; none where a traceback says it."""
    traceback: str
    file: str
    """Where this stands, as the path was given."""


def set_aside(log: Path, seed: int, number: int, why: Lost | Bug) -> SetAside:
    """Note why there is no `log`, and move what was written of it out of the way of `jenga convert`.

    Raises:
        OSError: the system refused.
    """
    key = log.name.removesuffix(".mcap")
    folder = log.parent / FOLDER
    folder.mkdir(exist_ok=True)
    path = folder / f"{key}.json"
    tries, text = (why.tries, "") if isinstance(why, Lost) else ((), why.traceback)
    reason = why.reason if isinstance(why, Bug) else why.tries[-1].reason
    found = SetAside(number, seed, key, reason, tries, text, str(path))
    written = path.with_name(f"{key}.json{PARTIAL}")
    written.write_bytes(msgspec.json.format(msgspec.json.encode(found)))
    written.replace(path)
    if partial_path(log).exists():
        partial_path(log).replace(folder / f"{key}{PARTIAL}")
    return found


def take_back(log: Path) -> None:
    """Forget that an episode was set aside: it is there now."""
    folder, key = log.parent / FOLDER, log.name.removesuffix(".mcap")
    if folder.exists():
        for name in (f"{key}.json", f"{key}{PARTIAL}"):
            (folder / name).unlink(missing_ok=True)
        with suppress(OSError):  # others are still in it
            folder.rmdir()


def in_one_line(out: Path, found: Sequence[SetAside]) -> str:
    """What was set aside and why; "" for nothing."""
    if not found:
        return ""
    first = found[0]
    more = f" and {len(found) - 1} more" if len(found) > 1 else ""
    return (
        f"{len(found)} of the episodes set aside in {out / FOLDER}: number {first.number} ({first.reason}){more}; "
        "the same command tries them again"
    )


def refuse_missing(out: Path, found: Sequence[SetAside]) -> None:
    """For who needs every episode.

    Raises:
        CheckFailed: some were set aside.
    """
    if found:
        raise CheckFailed(in_one_line(out, found))


class Patience:
    """Ends a run in which nothing succeeds: with a broken installation, thousands of episodes would each be tried."""

    def __init__(self, out: Path) -> None:
        self._out, self._in_a_row = out, 0

    def succeeded(self) -> None:
        self._in_a_row = 0

    def failed(self, found: Sequence[SetAside]) -> None:
        """Raises:
        CheckFailed: so many in a row.
        """
        self._in_a_row += 1
        if self._in_a_row >= GIVE_UP:
            raise CheckFailed(f"stopped after {GIVE_UP} failures in a row: {in_one_line(self._out, found)}")
