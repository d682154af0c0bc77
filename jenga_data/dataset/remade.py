"""Episodes that were made again beside what the dataset recorded of them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jenga_data.dataset.difference import (
    Differences,
    as_stored,
    episode_difference,
    largest,
    recorded_rows,
    rows_difference,
)
from jenga_data.dataset.episode_origin import Origin, evenly, later_fields, origins_of, sort_out
from jenga_data.dataset.manifest import Manifest
from jenga_data.dataset.read import Dataset
from jenga_data.dataset.resim import make_again
from jenga_data.dataset.rows import Rows, rows_of
from jenga_data.dataset.sources import Source, read_sources
from jenga_data.dataset.tolerance import beyond
from jenga_data.log.reader import read_episode
from jenga_data.outcome import Outcome
from jenga_data.progress import progress


@dataclass(frozen=True)
class Remade:
    """One episode, recorded and made again. `differences` is empty where every bit of its rows and labels is the same;
    `start` is the part of it that the first row has. `same_code`: by the same commit and versions."""

    episode: str
    origin: Origin
    log: Path
    same_log: bool
    same_code: bool
    differences: Differences
    start: Differences


@dataclass(frozen=True)
class Resim:
    """Episodes of a dataset that were made again, those that could not be, by the reason, and what else to know."""

    remade: list[Remade]
    cannot: dict[str, list[str]]
    notes: list[str]

    @property
    def beyond(self) -> list[str]:
        """What differs by more than `jenga_data.dataset.tolerance` allows, a line each."""
        if not self.remade:
            return ["no episode could be made again, so nothing was compared"]
        return beyond([r.start for r in self.remade], [r.differences for r in self.remade])

    @property
    def largest(self) -> Differences:
        """Largest difference of every column that differs."""
        return largest([r.differences for r in self.remade])

    @property
    def lines(self) -> list[str]:
        """What was found, for people."""
        count = len(self.remade)
        differ = ", ".join(f"{name} {value:.3g}" for name, value in self.largest.items())
        odd = sum(bool(r.differences) for r in self.remade)
        bits = f"{odd} of them differ, at most by: {differ}" if odd else "the largest difference is 0"
        logs = f"{sum(r.same_log for r in self.remade)} of {count} logs have the same bytes"
        if count and not all(r.same_code for r in self.remade):
            logs += " (they name the commit and the versions that wrote them, and those differ)"
        lines = [f"{count} episodes made again; {bits}", logs, *self.notes]
        return lines + [f"{len(e)} cannot be made again, first {e[0]}: {why}" for why, e in self.cannot.items()]

    def as_dict(self) -> dict[str, Any]:
        """For --json."""
        return {
            "episodes": len(self.remade),
            "differing": [r.episode for r in self.remade if r.differences],
            "largest_difference": self.largest,
            "same_logs": sum(r.same_log for r in self.remade),
            "same_code": sum(r.same_code for r in self.remade),
            "cannot": [{"reason": why, "episodes": len(e), "first": e[0]} for why, e in self.cannot.items()],
            "notes": self.notes,
            "beyond_tolerance": self.beyond,
        }


def resim(dataset: Dataset, episodes: int | None, workers: int, out: Path) -> Resim:
    """Make episodes of a dataset again into logs below `out`, and compare.

    Args:
        episodes: how many, evenly spread over those that can be made again; None for all of those.

    Raises:
        JengaError: `out` cannot be written, or a worker died.
        CheckFailed: the dataset is damaged.
    """
    key_of = {origin: key for key, origin in origins_of(dataset).items()}
    can, cannot = sort_out(dataset.manifest, key_of)
    chosen = can if episodes is None else evenly(can, episodes)
    logs = make_again(dataset.manifest, chosen, workers, out)
    remade = compare(dataset, {key_of[origin]: log for origin, log in logs.items()})
    without = {why: [key_of[origin] for origin in origins] for why, origins in cannot.items()}
    return Resim(remade, without, resim_notes(dataset.manifest, chosen))


def resim_notes(manifest: Manifest, origins: Sequence[Origin]) -> list[str]:
    """What to know of the configurations that were used."""
    names = dict.fromkeys(origin.config for origin in origins)
    later = {name: later_fields(manifest, name) for name in names}
    return [
        f"config {name} lacks {', '.join(fields)}: their defaults were used, and keys and file names differ"
        for name, fields in later.items()
        if fields
    ]


def compare(dataset: Dataset, logs: Mapping[str, Path]) -> list[Remade]:
    """Compare episodes of a dataset, by their keys, with logs that may be theirs.

    Raises:
        JengaError: a log cannot be read.
        CheckFailed: the dataset or a log is damaged.
    """
    if not logs:
        return []
    entries, origins = entries_of(dataset), origins_of(dataset)
    sources = {source.path: source for source in read_sources(list(logs.values())).logs}
    found: dict[str, Remade] = {}
    with progress("compare", len(logs)) as bar:
        for key, rows in _with_rows(dataset, list(logs)):
            entry, source = entries[key], sources[logs[key].resolve()]
            whole, start = _differences(dataset, rows, source)
            found[key] = Remade(
                episode=key,
                origin=origins[key],
                log=logs[key],
                same_log=source.log_sha256 == entry["log_sha256"],
                same_code=(source.commit, source.versions) == (entry["commit"], entry["versions"]),
                differences=dict(sorted((whole | episode_difference(entry, vars(source))).items())),
                start=start,
            )
            bar.advance()
    return [found[key] for key in logs]


def _with_rows(dataset: Dataset, episodes: list[str]) -> Iterator[tuple[str, Rows]]:
    """Recorded rows of each; none at all of an episode that made none, such as one whose grasp missed."""
    left = dict.fromkeys(episodes)
    for key, rows in recorded_rows(dataset, episodes):
        del left[key]
        yield key, rows
    yield from ((key, {}) for key in left)


def entries_of(dataset: Dataset) -> dict[str, dict[str, Any]]:
    columns = dataset.episodes()
    names = list(columns)
    rows = zip(*(columns[name].tolist() for name in names), strict=True)
    return {row[names.index("episode")]: dict(zip(names, row, strict=True)) for row in rows}


def _differences(dataset: Dataset, recorded: Rows, source: Source) -> tuple[Differences, Differences]:
    """Of all rows, and of the first."""
    rows = {} if source.outcome == Outcome.INVALID else rows_of(read_episode(source.path))
    counts = [len(r["episode"]) if r else 0 for r in (recorded, rows)]
    if not all(counts):
        return ({"rows": float(max(counts))} if any(counts) else {}), {}
    blocks, kind = dataset.manifest.blocks, dataset.manifest.kind
    if (found := np.asarray(rows["block_mass"]).shape[1]) != blocks:
        return {"blocks": float(abs(found - blocks))}, {"blocks": float(abs(found - blocks))}
    made = as_stored(rows, kind, blocks)
    return rows_difference(recorded, made), rows_difference(first_row(recorded), first_row(made))


def first_row(rows: Rows) -> Rows:
    """The first row alone."""
    return {name: column[np.arange(len(column)) < 1] for name, column in rows.items()}
