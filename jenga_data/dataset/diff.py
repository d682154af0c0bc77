"""What two datasets, or two versions of one, have different."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from jenga_data.dataset.episode_batches import episode_batches
from jenga_data.dataset.manifest import SPLITS, Manifest
from jenga_data.dataset.read import Dataset, open_dataset
from jenga_data.dataset.rows import Ragged
from jenga_data.dataset.tables import numpy_column

_SHOWN = 10
"""Lines of one section in a text."""


@dataclass(frozen=True)
class Diff:
    """Everything that differs between a dataset and another one.

    Attributes:
        fields: what the manifests say differently, by its path in them; None where one says nothing.
        only: keys of the episodes that only the first, and only the second has.
        differ: columns, of rows or of the table of episodes, in which an episode of both differs.
        moved: sides of the towers that both have on different ones.
        files: paths of the files with the same content in both, of the first alone and of the second alone.
    """

    identifiers: tuple[str, str]
    hashes: tuple[str, str]
    fields: dict[str, tuple[Any, Any]]
    only: tuple[list[str], list[str]]
    same: int
    differ: dict[str, list[str]]
    moved: dict[str, tuple[str, str]]
    files: tuple[list[str], list[str], list[str]]

    @property
    def equal(self) -> bool:
        """Their manifests are the same, and with them every byte that they vouch for."""
        return self.hashes[0] == self.hashes[1]

    def as_dict(self) -> dict[str, Any]:
        """What `jenga dataset diff --json` prints."""
        shared, removed, added = self.files
        return {
            "equal": self.equal,
            "datasets": list(self.identifiers),
            "hashes": list(self.hashes),
            "manifest": {path: list(values) for path, values in self.fields.items()},
            "episodes": {
                "removed": self.only[0],
                "added": self.only[1],
                "same": self.same,
                "differ": self.differ,
            },
            "moved": {tower: list(sides) for tower, sides in self.moved.items()},
            "files": {"shared": shared, "removed": removed, "added": added},
        }

    def text(self) -> str:
        """For people: one section for every kind of difference, long ones cut."""
        first, second = self.identifiers
        if self.equal:
            return f"{first} and {second} are equal: {self.same} episodes in {len(self.files[0])} files"
        shared, removed, added = self.files
        # Statistics follow from the rows: that there are others is enough to know.
        fields = {path: pair for path, pair in self.fields.items() if not path.startswith("statistics.")}
        columns = dict.fromkeys(path.split(".")[1] for path in self.fields.keys() - fields.keys())
        sections = [
            (f"episodes only in {first}", self.only[0]),
            (f"episodes only in {second}", self.only[1]),
            ("episodes that differ", [f"{key}: {', '.join(columns)}" for key, columns in self.differ.items()]),
            ("towers on another side", [f"{tower}: {a} -> {b}" for tower, (a, b) in self.moved.items()]),
            ("manifest", [f"{path}: {_short(a)} -> {_short(b)}" for path, (a, b) in fields.items()]),
            ("columns with other statistics", sorted(columns)),
            (f"files only in {first}", removed),
            (f"files only in {second}", added),
        ]
        lines = [f"{first} -> {second}: {self.same} episodes are the same, {len(shared)} files are shared"]
        for title, found in sections:
            lines += [f"{title}: {len(found)}", *(f"  {line}" for line in found[:_SHOWN])] if found else []
            lines += [f"  and {len(found) - _SHOWN} more; --json lists them"] if len(found) > _SHOWN else []
        return "\n".join(lines)


def diff(first: str | Path, second: str | Path) -> Diff:
    """Compare two datasets, given by folder or NAME@X.Y.Z. Of rows in files that both share nothing is read.

    Raises:
        JengaError: a dataset is not there.
        CheckFailed: one is damaged so far that it cannot be read; hashes of files are `verify`'s business.
    """
    a, b = open_dataset(first), open_dataset(second)
    differ = _different_episodes(a, b)
    keys = [set(dataset.episodes()["episode"].tolist()) for dataset in (a, b)]
    sides = [{t: side for side in SPLITS for t in d.manifest.splits.towers(side)} for d in (a, b)]
    return Diff(
        identifiers=(a.manifest.identifier, b.manifest.identifier),
        hashes=(a.hash, b.hash),
        fields=_different_fields(a.manifest, b.manifest),
        only=(sorted(keys[0] - keys[1]), sorted(keys[1] - keys[0])),
        same=len(keys[0] & keys[1]) - len(differ),
        differ=differ,
        moved={t: (side, sides[1][t]) for t, side in sorted(sides[0].items()) if sides[1].get(t, side) != side},
        files=_files(a.manifest, b.manifest),
    )


def _files(a: Manifest, b: Manifest) -> tuple[list[str], list[str], list[str]]:
    hashes = [{file.sha256 for file in manifest.files} for manifest in (a, b)]
    shared = [file.path for file in b.files if file.sha256 in hashes[0]]
    removed = [file.path for file in a.files if file.sha256 not in hashes[1]]
    return shared, removed, [file.path for file in b.files if file.sha256 not in hashes[0]]


def _different_fields(a: Manifest, b: Manifest) -> dict[str, tuple[Any, Any]]:
    """What the manifests say; files, towers and hashes are compared elsewhere."""
    plain = [msgspec.to_builtins(manifest) for manifest in (a, b)]
    for fields in plain:
        fields["splits"] = {"rule": fields["splits"]["rule"]}
        del fields["files"], fields["hash"]
    return dict(_changes(*plain, path=""))


def _changes(a: Any, b: Any, path: str) -> Iterator[tuple[str, tuple[Any, Any]]]:
    """The smallest parts that differ, by dotted paths; records in a list go by their name."""
    a_records, b_records = _by_name(a), _by_name(b)
    if a_records is not None and b_records is not None:
        for key in dict.fromkeys([*a_records, *b_records]):
            yield from _changes(a_records.get(key), b_records.get(key), f"{path}.{key}" if path else key)
    elif a != b:
        yield path, (a, b)


def _by_name(value: Any) -> dict[str, Any] | None:
    if isinstance(value, list) and all(isinstance(v, dict) and "name" in v for v in value):
        return {record["name"]: record for record in value}
    return value if isinstance(value, dict) else None


def _different_episodes(a: Dataset, b: Dataset) -> dict[str, list[str]]:
    """Columns in which an episode of both differs, by its key."""
    tables = [dataset.episodes() for dataset in (a, b)]
    _, at_a, at_b = np.intersect1d(tables[0]["episode"], tables[1]["episode"], return_indices=True)
    found: dict[str, list[str]] = {}
    keys = tables[0]["episode"][at_a]
    for name in tables[0]:
        one, other = tables[0][name][at_a], tables[1][name][at_b]
        for key in keys[(one != other) & ~((one != one) & (other != other))].tolist():
            found.setdefault(key, []).append(name)
    shared = {file.sha256 for file in a.manifest.data_files} & {file.sha256 for file in b.manifest.data_files}
    prints = [_fingerprints(dataset, shared, set(keys.tolist())) for dataset in (a, b)]
    for key in prints[0].keys() & prints[1].keys():
        one, other = prints[0][key], prints[1][key]
        columns = [name for name in one if name in other and one[name] != other[name]]
        found.setdefault(key, []).extend(name for name in columns if name not in found[key])
    return {key: found[key] for key in sorted(found) if found[key]}


def _fingerprints(dataset: Dataset, shared: set[str], keys: set[str]) -> dict[str, dict[str, bytes]]:
    """A hash of every column of the episodes `keys` that lie in other files than the shared ones."""
    hashes: dict[str, dict[str, tuple[Any, Any]]] = {}
    for file in dataset.manifest.data_files:
        if file.sha256 in shared:
            continue
        with dataset.open_file(file) as source:
            for key, batch in episode_batches(source):
                if key not in keys:
                    continue
                columns = hashes.setdefault(key, {n: (hashlib.sha256(), hashlib.sha256()) for n in batch.schema.names})
                for name, (values, lengths) in columns.items():
                    column = numpy_column(batch[name])
                    values.update(_bytes(column.values if isinstance(column, Ragged) else column))
                    lengths.update(_bytes(np.diff(column.offset)) if isinstance(column, Ragged) else b"")
    return {key: {n: v.digest() + s.digest() for n, (v, s) in columns.items()} for key, columns in hashes.items()}


def _bytes(values: np.ndarray) -> bytes:
    return "\0".join(values.tolist()).encode() if values.dtype.kind == "U" else values.tobytes()


def _short(value: Any) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
