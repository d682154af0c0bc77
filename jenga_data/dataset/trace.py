"""From a row of a dataset back to the moment of the log that it was taken from."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from jenga_data.dataset.difference import Differences
from jenga_data.dataset.episode_origin import config_of, origins_of
from jenga_data.dataset.logs_at_hand import find_log, log_folders
from jenga_data.dataset.manifest import SPLITS
from jenga_data.dataset.read import Dataset, open_dataset
from jenga_data.dataset.remade import compare, entries_of, resim_notes
from jenga_data.dataset.resim import make_again
from jenga_data.dataset.tolerance import beyond
from jenga_data.errors import JengaError

OUT = Path("runs/traced")
"""Where logs that are not at hand are made again."""


@dataclass(frozen=True)
class Moment:
    """A row of a dataset, and the moment of an episode that it shows.

    `entry` is the episode's row of `episodes.parquet`; `file` and `line` say where in `data/` the row is.
    """

    dataset: str
    hash: str
    row: int
    split: str
    file: str
    line: int
    frame: int
    entry: dict[str, Any]

    @property
    def time_s(self) -> float:
        """Time since the first frame [s]."""
        return self.frame * self.entry["control_step_ns"] / 1e9

    @property
    def log_name(self) -> str:
        return f"{self.entry['episode']}.mcap"


@dataclass(frozen=True)
class Log:
    """The log of an episode as far as it can be had. `state` is "found", "found a namesake" (another recording of the
    episode), "made again" or "none"; `differences` are those of its rows from the dataset's, None if not compared."""

    state: str
    path: Path | None
    same_bytes: bool
    differences: Differences | None
    notes: list[str]
    ok: bool


@dataclass(frozen=True)
class Trace:
    """Where a row comes from."""

    moment: Moment
    log: Log

    @property
    def ok(self) -> bool:
        return self.log.ok

    @property
    def replay(self) -> str:
        """The command that shows the moment."""
        return f"jenga replay {shlex.quote(str(self.log.path or self.moment.log_name))} --frame {self.moment.frame}"

    def as_dict(self) -> dict[str, Any]:
        """What `jenga dataset trace --json` prints."""
        m, log, entry = self.moment, self.log, self.moment.entry
        names = ("episode", "seed", "number", "config", "checkpoint", "commit", "tower", "round", "target", "outcome")
        return {
            **{name: getattr(m, name) for name in ("dataset", "hash", "row", "split", "file", "line")},
            **{name: entry[name] for name in names},
            "versions": _versions(entry["versions"]),
            "frame": m.frame,
            "frames": entry["frames"],
            "time_s": m.time_s,
            "log": {
                "name": m.log_name,
                "sha256": entry["log_sha256"],
                "bytes": entry["log_bytes"],
                "state": log.state,
                "path": str(log.path) if log.path else None,
                "same_bytes": log.same_bytes,
                "largest_difference": log.differences,
                "notes": log.notes,
            },
            "ok": self.ok,
            "replay": self.replay,
        }

    @property
    def text(self) -> str:
        """For people."""
        m, entry = self.moment, self.moment.entry
        model = f", model {entry['checkpoint']}" if entry["checkpoint"] else ""
        versions = ", ".join(f"{name} {number}" for name, number in _versions(entry["versions"]).items())
        lines = {
            "row": f"{m.row} of {m.dataset} ({m.split}): row {m.line} of {m.file}",
            "episode": f"{entry['episode']}: {entry['kind']}, round {entry['round']}, target {entry['target']}, "
            f"{entry['outcome']}",
            "moment": f"frame {m.frame} of {entry['frames']}, {m.time_s:.3f} s",
            "made from": f"config {entry['config']}, seed {entry['seed']}, number {entry['number']}{model}",
            "made by": f"commit {entry['commit'] or 'unknown'}; {versions or 'versions unknown'}",
            "log": f"{m.log_name}, {entry['log_bytes']} bytes, SHA-256 {entry['log_sha256']}",
            "": self._log_line(),
            "replay": self.replay,
        }
        notes = [f"{'':11}{note}" for note in self.log.notes]
        shown = [f"{name:11}{line}" for name, line in lines.items()]
        return "\n".join([*shown[:-1], *notes, shown[-1]])

    def _log_line(self) -> str:
        log = self.log
        if log.path is None:
            return "not at hand"
        if log.same_bytes:
            return f"{log.state}: {log.path}, and it has these bytes"
        found = ", ".join(f"{name} {value:.3g}" for name, value in (log.differences or {}).items())
        state = f"its state differs, at most by: {found}" if found else "its state is the same to the last bit"
        return f"{log.state}: {log.path}; its bytes are others, {state}"


def trace(where: str | Path, row: int, logs: Sequence[Path] = (), out: Path = OUT) -> Trace:
    """Find the moment and the log of a row; a log that is not at hand is made again below `out`.

    Args:
        row: number of the row, as `Dataset.rows` and `Dataset.column` count.
        logs: folders to look in before the known places, see `log_folders`.

    Raises:
        JengaError: there is no such dataset, row or folder, or `out` cannot be written.
        CheckFailed: the dataset is damaged.
    """
    dataset = open_dataset(where)
    moment = _moment(dataset, row)
    return Trace(moment, _log(dataset, moment, logs, out))


def _moment(dataset: Dataset, row: int) -> Moment:
    if not 0 <= row < len(dataset):
        raise JengaError(f"row is {row}; {dataset.manifest.identifier} has rows 0 to {len(dataset) - 1}")
    episode, frame = str(dataset.column("episode")[row]), int(dataset.column("frame")[row])
    entries = entries_of(dataset)
    if episode not in entries:
        raise JengaError(f"row {row} is of episode {episode}, which is in no table: run `jenga dataset verify`")
    tower = entries[episode]["tower"]
    split = next((name for name in SPLITS if tower in dataset.manifest.splits.towers(name)), "no split")
    ends = np.cumsum([f.rows for f in dataset.manifest.data_files])
    at = int(np.searchsorted(ends, row, side="right"))
    file = dataset.manifest.data_files[at]
    line = row - int(ends[at]) + file.rows
    return Moment(dataset.manifest.identifier, dataset.hash, row, split, file.path, line, frame, entries[episode])


def _log(dataset: Dataset, moment: Moment, logs: Sequence[Path], out: Path) -> Log:
    entry = moment.entry
    hand = find_log(log_folders(logs), moment.log_name, entry["log_bytes"], entry["log_sha256"])
    if hand.log:
        return Log("found", hand.log, True, None, [], True)
    notes = []
    for path in hand.namesakes:
        try:
            log = _compared(dataset, moment, path, "found a namesake", notes)
        except JengaError as error:
            notes.append(f"passed over: {error}")
            continue
        if log.ok:
            return log
        notes = [*log.notes, f"so {path} was passed over: it is another recording"]
    return _made_again(dataset, moment, notes, out)


def _made_again(dataset: Dataset, moment: Moment, notes: list[str], out: Path) -> Log:
    origin = origins_of(dataset)[moment.entry["episode"]]
    try:
        config_of(dataset.manifest, origin)
    except JengaError as error:
        return Log("none", None, False, None, [*notes, f"it cannot be made again: {error}"], False)
    path = make_again(dataset.manifest, [origin], 1, out)[origin]
    return _compared(dataset, moment, path, "made again", [*notes, *resim_notes(dataset.manifest, [origin])])


def _compared(dataset: Dataset, moment: Moment, path: Path, state: str, notes: list[str]) -> Log:
    (found,) = compare(dataset, {moment.entry["episode"]: path})
    odd = beyond([found.start], [found.differences])
    return Log(state, path, found.same_log, found.differences, [*notes, *odd], not odd)


def _versions(text: str) -> dict[str, str]:
    try:
        return msgspec.json.decode(text, type=dict[str, str])
    except msgspec.DecodeError:
        return {}
