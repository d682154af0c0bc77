"""Where the rows of logs wait between reading and writing: which logs share a file is known when all were read."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from jenga_data.dataset.rows import rows_of_all
from jenga_data.dataset.schema import COLUMNS, arrow_schema
from jenga_data.dataset.tables import record_batch
from jenga_data.log.excerpt import Excerpt

_FRAMES_AT_ONCE = 32
"""Rows are made of so many frames together, or of one log that has more: it takes half the time of one by one."""


@dataclass(frozen=True)
class Spooled:
    """Where the rows of one log wait, and of how many frames its log is."""

    path: Path
    number: int
    """Of the record batch in the file."""
    frames: int


class SpoolWriter:
    """Makes the rows of logs of one kind and size, and puts those of each log into a record batch of its own."""

    def __init__(self, path: Path, kind: str, blocks: int, writer: pa.RecordBatchFileWriter) -> None:
        self._path, self._writer = path, writer
        self._kind, self._schema = kind, arrow_schema(COLUMNS[kind], blocks)
        self._waiting: list[Excerpt] = []
        self._count = 0

    def add(self, found: Excerpt) -> Spooled:
        """Take over what the rows of a log are made from.

        Raises:
            JengaError: it makes no rows.
        """
        place = Spooled(self._path, self._count, found.frames)
        self._waiting.append(found)
        self._count += 1
        if sum(len(waiting.episode.pose) for waiting in self._waiting) >= _FRAMES_AT_ONCE:
            self.flush()
        return place

    def flush(self) -> None:
        """Write what is waiting."""
        if not self._waiting:
            return
        batch = record_batch(rows_of_all([(found.episode, found.number) for found in self._waiting]), self._schema)
        start = 0
        for found in self._waiting:
            rows = 1 if self._kind == "selection" else len(found.episode.action_frame)
            self._writer.write_batch(batch.slice(start, rows))
            start += rows
        self._waiting = []


@contextmanager
def spool_folder(folder: Path) -> Iterator[Path]:
    """A place within the folder of a new dataset that is gone before the dataset is there."""
    spool = folder / ".spool"
    spool.mkdir()
    try:
        yield spool
    finally:
        shutil.rmtree(spool)


@contextmanager
def spool_writer(path: Path, kind: str, blocks: int) -> Iterator[SpoolWriter]:
    """A new file of rows, complete when the body is through."""
    with (
        pa.OSFile(str(path), "wb") as file,
        pa.ipc.new_file(file, arrow_schema(COLUMNS[kind], blocks)) as writer,
    ):
        spool = SpoolWriter(path, kind, blocks, writer)
        yield spool
        spool.flush()


class SpoolReader:
    """Finds rows again. They are mapped, not read, until somebody looks at them."""

    def __init__(self) -> None:
        self._files: dict[Path, pa.RecordBatchFileReader] = {}

    def rows(self, place: Spooled) -> pa.RecordBatch:
        if place.path not in self._files:
            self._files[place.path] = pa.ipc.open_file(pa.memory_map(str(place.path)))
        return self._files[place.path].get_batch(place.number)
