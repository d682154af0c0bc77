"""By how much two recordings of one episode differ, column by column. Equal bits give no difference at all."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from jenga_data.dataset.read import Dataset
from jenga_data.dataset.rows import Ragged, Rows
from jenga_data.dataset.schema import COLUMNS, EPISODE_COLUMNS, arrow_schema
from jenga_data.dataset.tables import numpy_column, open_parquet, record_batch

Differences = dict[str, float]
"""Largest difference of every column that differs at all: in the column's unit for numbers, the share of differing
rows for words and truth values. "rows" is by how many rows there are more or less, "edges" how many edges are in one
of both only."""

PROVENANCE = ("episode", "config", "log_sha256", "log_bytes", "commit", "versions", "frames", "rows")
"""Columns of `episodes.parquet` that are no part of what happened: who wrote the log with what, and the key and
config that change when a configuration gets another field. (`rows` differ where the rows themselves do.)"""

_POSE = {".position": np.s_[..., :3], ".quaternion": np.s_[..., 3:]}
_TWIST = {".linear": np.s_[..., :3], ".angular": np.s_[..., 3:]}
_PARTS = {"block_pose": _POSE, "next_pose": _POSE, "block_twist": _TWIST, "next_twist": _TWIST}
"""Columns of two units are compared as two."""
_EDGES = ("edge_upper", "edge_lower", "edge_force")


def as_stored(rows: Rows, kind: str, blocks: int) -> Rows:
    """Rows in the types that a dataset has: floats rounded to 32 bit."""
    batch = record_batch(rows, arrow_schema(COLUMNS[kind], blocks))
    return {name: numpy_column(batch.column(name)) for name in batch.schema.names}


def recorded_rows(dataset: Dataset, episodes: Sequence[str]) -> Iterator[tuple[str, Rows]]:
    """Key and rows of each of these episodes that has rows, in the order of the files. One file is in memory at a
    time.

    Raises:
        CheckFailed: a file is damaged.
    """
    wanted = pa.array(episodes, pa.string())
    for entry in dataset.manifest.data_files:
        with open_parquet(dataset.folder / entry.path) as file:
            # pyarrow makes its compute functions when it is imported: the stubs do not know them.
            here = pc.is_in(file.read(columns=["episode"]).column(0), value_set=wanted)  # type: ignore[reportAttributeAccessIssue]
            if not pc.any(here).as_py():  # type: ignore[reportAttributeAccessIssue]
                continue
            table = file.read().filter(here)
            keys = np.asarray(numpy_column(table["episode"]))
            for key in dict.fromkeys(keys.tolist()):
                found = table.filter(pa.array(keys == key))
                yield key, {name: numpy_column(found[name]) for name in found.column_names}


def rows_difference(recorded: Rows, made: Rows) -> Differences:
    """What differs between the rows of an episode as they are stored in two datasets."""
    found: Differences = {}
    counts = len(recorded["episode"]), len(made["episode"])
    if counts[0] != counts[1]:
        found["rows"] = float(abs(counts[0] - counts[1]))
    both = np.arange(max(counts)) < min(counts)
    recorded, made = ({n: column[both[: len(column)]] for n, column in rows.items()} for rows in (recorded, made))
    for name in recorded.keys() - {"episode", *_EDGES}:
        one, other = np.asarray(recorded[name]), np.asarray(made[name])
        for part, where in _PARTS.get(name, {"": ...}).items():
            found |= _nonzero(name + part, column_difference(one[where], other[where]))
    return dict(sorted((found | _edge_difference(recorded, made)).items()))


def episode_difference(recorded: Mapping[str, Any], made: Mapping[str, Any]) -> Differences:
    """What differs between two entries of `episodes.parquet`, leaving out `PROVENANCE`."""
    found: Differences = {}
    for column in EPISODE_COLUMNS:
        if column.name not in PROVENANCE:
            kind = np.float32 if column.dtype == "float32" else None
            one, other = (np.array([entry[column.name]], kind) for entry in (recorded, made))
            found |= _nonzero(column.name, column_difference(one, other))
    return found


def column_difference(recorded: np.ndarray, made: np.ndarray) -> float:
    """Largest difference of numbers (a missing number differs infinitely from any other), share of differing words."""
    if recorded.dtype.kind not in "iuf":
        return float((recorded != made).mean()) if len(recorded) else 0.0
    if not recorded.size:
        return 0.0
    one, other = recorded.astype(float), made.astype(float)
    same = (one == other) | (np.isnan(one) & np.isnan(other))
    with np.errstate(invalid="ignore"):
        distance = np.where(same, 0.0, np.abs(one - other))
    return float(np.where(np.isnan(distance), np.inf, distance).max())


def largest(differences: Sequence[Differences]) -> Differences:
    """Column by column over many episodes."""
    found: Differences = {}
    for difference in differences:
        for name, value in difference.items():
            found[name] = max(value, found.get(name, 0.0))
    return dict(sorted(found.items()))


def _edge_difference(recorded: Rows, made: Rows) -> Differences:
    one, other = (_edges(rows) for rows in (recorded, made))
    force = max((abs(one[edge] - other[edge]) for edge in one.keys() & other.keys()), default=0.0)
    return _nonzero("edges", float(len(one.keys() ^ other.keys()))) | _nonzero("edge_force", force)


def _edges(rows: Rows) -> dict[tuple[int, int, int], float]:
    """Force of each edge by row, upper and lower block."""
    upper, lower, force = (rows[name] for name in _EDGES)
    assert isinstance(upper, Ragged)
    assert isinstance(lower, Ragged)
    assert isinstance(force, Ragged)
    row = np.repeat(np.arange(len(upper)), np.diff(upper.offset))
    keys = zip(row.tolist(), upper.values.tolist(), lower.values.tolist(), strict=True)
    return dict(zip(keys, force.values.tolist(), strict=True))


def _nonzero(name: str, value: float) -> Differences:
    return {name: value} if value else {}
