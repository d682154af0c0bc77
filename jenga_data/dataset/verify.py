"""Is a dataset whole, and does it keep what it promises? Reads every byte; trusts nothing but the code."""

import hashlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from jenga_data.dataset.check_files import check_hashes, check_manifest, check_schema
from jenga_data.dataset.check_keys import (
    check_counts,
    check_episodes,
    check_frames,
    check_splits,
    check_statistics,
)
from jenga_data.dataset.check_provenance import check_provenance
from jenga_data.dataset.check_rows import check_edges, check_layout, check_ranges, check_transitions
from jenga_data.dataset.locate import locate
from jenga_data.dataset.manifest import load_manifest
from jenga_data.dataset.read import Dataset
from jenga_data.dataset.rows import Rows
from jenga_data.dataset.statistics import ColumnStatistics
from jenga_data.dataset.tables import numpy_column, open_parquet
from jenga_data.errors import JengaError
from jenga_data.progress import progress

CHECKS = (
    "manifest",
    "files",
    "schema",
    "ranges",
    "edges",
    "frames",
    "episodes",
    "splits",
    "counts",
    "statistics",
    "provenance",
)
"""In this order; where one of the first three fails, the rest cannot be run."""

_SHOWN = 3


@dataclass(frozen=True)
class Check:
    """What one check found, in a line."""

    ok: bool
    detail: str


@dataclass(frozen=True)
class VerifyReport:
    """What all checks found, by the name of the check."""

    dataset: str
    hash: str
    checks: dict[str, Check]
    resim: dict[str, Any] = field(default_factory=dict)
    """What `jenga_data.dataset.check_resim` found in numbers, where that was asked for."""

    @property
    def ok(self) -> bool:
        return all(check.ok for check in self.checks.values())

    def as_dict(self) -> dict[str, Any]:
        """What `jenga dataset verify --json` prints."""
        checks = {name: {"ok": check.ok, "detail": check.detail} for name, check in self.checks.items()}
        more = {"resim": self.resim} if self.resim else {}
        return {"ok": self.ok, "dataset": self.dataset, "hash": self.hash, "checks": checks} | more


def verify(where: str | Path) -> VerifyReport:
    """Check a dataset given by folder or NAME@X.Y.Z. What is wrong with it is in the report, not raised.

    Raises:
        JengaError: there is no such dataset.
    """
    folder = locate(where)
    checks: dict[str, Check] = {}
    try:
        manifest = load_manifest(folder)
    except JengaError as error:
        checks["manifest"] = Check(False, str(error))
        return VerifyReport(str(where), "", _completed(checks))
    checks["manifest"] = _check(check_manifest(folder, manifest), f"format version {manifest.format_version}")
    checks["files"] = _check(check_hashes(folder, manifest), f"{len(manifest.files)} files")
    if checks["files"].ok:
        checks["schema"] = _check(check_schema(folder, manifest), f"{len(manifest.features)} columns")
    if all(check.ok for check in _completed(checks, CHECKS[:3]).values()):
        checks |= _content(Dataset(folder, manifest, manifest.hash))
    return VerifyReport(manifest.identifier, manifest.hash, _completed(checks))


def _content(dataset: Dataset) -> dict[str, Check]:
    manifest = dataset.manifest
    episodes = dataset.episodes()
    keys = {name: dataset.column(name) for name in ("episode", "frame")}
    statistics = ColumnStatistics(dataset.columns)
    train = manifest.splits.train
    blocks_of: dict[str, set[bytes]] = {}
    wrong: dict[str, dict[str, None]] = {"ranges": {}, "edges": {}, "frames": {}}
    with progress("verify", len(manifest.data_files)) as bar:
        for path, rows in _batches(dataset, bar.advance):
            ranges = [f"{path}: {line}" for line in chain(check_ranges(rows, manifest.blocks), check_layout(rows))]
            wrong["ranges"] |= dict.fromkeys(ranges)
            if not ranges:  # ids outside the tower would be no valid index
                wrong["edges"] |= dict.fromkeys(f"{path}: {line}" for line in check_edges(rows))
            wrong["frames"] |= dict.fromkeys(f"{path}: {line}" for line in check_transitions(rows))
            for tower, digest in _sets_of_blocks(rows):
                blocks_of.setdefault(tower, set()).add(digest)
            chosen = np.isin(np.asarray(rows["tower"]), train)
            statistics.add({name: column[chosen] for name, column in rows.items()})
    count = len(dataset)
    return {
        "ranges": _check(wrong["ranges"], f"{count} rows"),
        "edges": _check(wrong["edges"], f"{count} graphs"),
        "frames": _check(chain(check_frames(keys), wrong["frames"]), f"{count} rows"),
        "episodes": _check(check_episodes(dataset, keys, episodes), f"{len(episodes['episode'])} episodes"),
        "splits": _check(check_splits(manifest, episodes, blocks_of), f"{len(blocks_of)} towers"),
        "counts": _check(check_counts(manifest, count, episodes), f"{manifest.counts.invalid} invalid episodes apart"),
        "statistics": _check(check_statistics(manifest, statistics.summary()), f"{statistics.rows} training rows"),
        "provenance": _check(check_provenance(manifest, episodes), f"{len(manifest.provenance.recipes)} recipes"),
    }


def _batches(dataset: Dataset, each_file: Callable[[], None]) -> Iterator[tuple[str, Rows]]:
    """All rows with the path of their file, one row group at a time: memory does not grow with the dataset."""
    for entry in dataset.manifest.data_files:
        with open_parquet(dataset.folder / entry.path) as file:
            for group in range(file.num_row_groups):
                table = file.read_row_group(group)
                yield entry.path, {name: numpy_column(table[name]) for name in table.column_names}
        each_file()


def _sets_of_blocks(rows: Rows) -> Iterator[tuple[str, bytes]]:
    """Tower of each row and a hash of its blocks' sizes, masses and, where the format has them, wedges."""
    parts = [np.asarray(rows[name]) for name in ("block_size", "block_mass", "block_wedge") if name in rows]
    for i, name in enumerate(np.asarray(rows["tower"]).tolist()):
        yield name, hashlib.sha256(b"".join(part[i].tobytes() for part in parts)).digest()


def _check(wrong: Iterable[str], passed: str) -> Check:
    """Run a check. Its detail is the first few things that are wrong, or what passed."""
    try:
        lines = list(islice(wrong, 1000))
    except JengaError as error:
        lines = [str(error)]
    shown = "; ".join(lines[:_SHOWN]) + (f"; and {len(lines) - _SHOWN} more" if len(lines) > _SHOWN else "")
    return Check(not lines, shown or passed)


def _completed(checks: dict[str, Check], names: tuple[str, ...] = CHECKS) -> dict[str, Check]:
    not_run = Check(False, "not run, for what failed before")
    return {name: checks.get(name, not_run) for name in names}
