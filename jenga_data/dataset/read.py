"""Opening a dataset: columns as numpy arrays, whole and without an object a row."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow.parquet as pq
from jaxtyping import Float, Int, Shaped

from jenga_data.dataset.locate import locate
from jenga_data.dataset.manifest import SPLITS, File, Manifest, load_manifest
from jenga_data.dataset.rows import Ragged
from jenga_data.dataset.schema import EPISODE_COLUMNS, EPISODES, Column, arrow_schema, columns_of
from jenga_data.dataset.tables import numpy_column, open_parquet
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.log.files import file_sha256


class Edges(NamedTuple):
    """The support graphs of all rows: row i has the edges `offset[i]:offset[i + 1]`, each from a block (`upper`) to
    one right below it (`lower`), which lifts it by `force` [N]."""

    offset: Int[np.ndarray, " rows_and_one"]
    upper: Int[np.ndarray, " edge"]
    lower: Int[np.ndarray, " edge"]
    force: Float[np.ndarray, " edge"]


@dataclass(frozen=True, eq=False)
class Dataset:
    """One version of a dataset on disk. Rows are numbered in the order of the manifest's files.

    Columns are read when they are asked for and not kept. No byte of a file is decoded before its hash is found to be
    the manifest's: a Parquet reader can crash on damaged bytes. Against a dataset whose maker forged file and
    manifest together no hash helps; then `jenga_data.limits` bound what the file may claim, not what it may do.
    """

    folder: Path
    manifest: Manifest
    hash: str
    """SHA-256 of the manifest, and with it of everything."""

    def __len__(self) -> int:
        return sum(f.rows for f in self.manifest.data_files)

    @property
    def columns(self) -> tuple[Column, ...]:
        """The columns of its rows: those that its format has."""
        return columns_of(self.manifest.kind, self.manifest.format_version)

    def rows(self, split: str) -> Int[np.ndarray, " row"]:
        """Numbers of the rows of one split, ascending.

        Args:
            split: "train", "validation" or "test"; several joined by "+"; "all" for every row, split or not.

        Raises:
            JengaError: there is no such split.
        """
        if split == "all":
            return np.arange(sum(self._metadata_of(entry).num_rows for entry in self.manifest.data_files))
        names = split.split("+")
        if unknown := set(names) - set(SPLITS):
            raise JengaError(f"no split {sorted(unknown)[0]!r}; allowed: {', '.join(SPLITS)}, a sum of them, or all")
        towers = [t for name in dict.fromkeys(names) for t in self.manifest.splits.towers(name)]
        return np.flatnonzero(np.isin(self.column("tower"), towers))

    def column(self, name: str) -> Shaped[np.ndarray, "row ..."]:
        """One column of fixed shape, all rows stacked, read-only: Arrow's own memory where that is possible.

        Raises:
            JengaError: there is no such column; edges are read by `edges()`.
            CheckFailed: a file is damaged.
        """
        allowed = [c.name for c in self.columns if not c.ragged]
        if name not in allowed:
            raise JengaError(f"no column {name!r} of fixed shape in {self.folder}; allowed: {', '.join(allowed)}")
        parts = [part for part in self._parts(name) if isinstance(part, np.ndarray)]
        stacked = parts[0] if len(parts) == 1 else np.concatenate(parts)
        stacked.flags.writeable = False
        return stacked

    def edges(self) -> Edges:
        """The support graphs of all rows.

        Raises:
            CheckFailed: a file is damaged.
        """
        parts = [self._ragged(name) for name in ("edge_upper", "edge_lower", "edge_force")]
        ids = np.concatenate([part.values for part in parts[:2]])
        if any(not np.array_equal(part.offset, parts[0].offset) for part in parts[1:]) or (
            len(ids) and not 0 <= ids.min() <= ids.max() < self.manifest.blocks
        ):
            raise CheckFailed(f"the edges in {self.folder} are none: run `jenga dataset verify {self.folder}`")
        return Edges(parts[0].offset, *(p.values for p in parts))

    def episodes(self) -> dict[str, np.ndarray]:
        """The columns of `episodes.parquet`, one entry an episode.

        Raises:
            CheckFailed: the file is damaged.
        """
        for entry in self.manifest.files:
            if entry.path == EPISODES:
                self._check_hash(entry)
        with open_parquet(self.folder / EPISODES) as file:
            if not file.schema_arrow.equals(arrow_schema(EPISODE_COLUMNS, blocks=1)):
                raise CheckFailed(
                    f"{self.folder / EPISODES} has other columns: run `jenga dataset verify {self.folder}`"
                )
            table = file.read()
            return {c.name: np.asarray(numpy_column(table[c.name])) for c in EPISODE_COLUMNS}

    def _ragged(self, name: str) -> Ragged:
        parts = [part for part in self._parts(name) if isinstance(part, Ragged)]
        lengths = np.concatenate([np.diff(part.offset) for part in parts])
        return Ragged(np.concatenate([[0], np.cumsum(lengths)]), np.concatenate([part.values for part in parts]))

    def _parts(self, name: str) -> list[np.ndarray | Ragged]:
        parts = []
        for entry in self.manifest.data_files:
            with self.open_file(entry) as file:
                parts.append(numpy_column(file.read(columns=[name]).column(0)))
        return parts

    @contextmanager
    def open_file(self, entry: File) -> Iterator[pq.ParquetFile]:
        """One of the files of rows, to be read group by group.

        Raises:
            CheckFailed: it is damaged, or has other columns or rows than it should.
        """
        with open_parquet(self.folder / entry.path, self._metadata_of(entry)) as file:
            yield file

    @cached_property
    def _metadata(self) -> dict[str, pq.FileMetaData]:
        return {}

    def _metadata_of(self, entry: File) -> pq.FileMetaData:
        """What a data file says of itself, checked once: half of the time that reading a column of a file takes."""
        if entry.path not in self._metadata:
            self._check_hash(entry)
            with open_parquet(self.folder / entry.path) as file:
                expected = arrow_schema(self.columns, self.manifest.blocks)
                if not file.schema_arrow.equals(expected) or file.metadata.num_rows != entry.rows:
                    raise CheckFailed(
                        f"{self.folder / entry.path} has other columns or rows than its manifest says: "
                        f"run `jenga dataset verify {self.folder}`"
                    )
                self._metadata[entry.path] = file.metadata
        return self._metadata[entry.path]

    def _check_hash(self, entry: File) -> None:
        path = self.folder / entry.path
        if file_sha256(path) != entry.sha256:
            raise CheckFailed(f"{path} is damaged: it has not the hash that its manifest says; get it again")


def open_dataset(where: str | Path) -> Dataset:
    """Open a dataset by folder or NAME@X.Y.Z. Sizes of files are compared, their content is `verify`'s business.

    Raises:
        JengaError: there is no such dataset, or its manifest is not valid.
        CheckFailed: a file is missing or of another size.
    """
    folder = locate(where)
    manifest = load_manifest(folder)
    for entry in manifest.files:
        path = folder / entry.path
        found = path.stat().st_size if path.is_file() else None
        if found != entry.bytes:
            state = "is missing" if found is None else f"has {found} bytes, not {entry.bytes}"
            raise CheckFailed(f"{path} {state}: {manifest.identifier} is not whole; get it again, or convert its logs")
    return Dataset(folder, manifest, manifest.hash)
