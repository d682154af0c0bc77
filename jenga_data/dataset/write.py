"""Logs become the files of a dataset's rows, one shard a task, on as many processes as are wanted."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jenga_data.dataset.manifest import DATA, File
from jenga_data.dataset.schema import COLUMNS, Column, arrow_schema
from jenga_data.dataset.shards import Shard
from jenga_data.dataset.sources import Source
from jenga_data.dataset.spool import SpoolReader
from jenga_data.dataset.staging import file_entry
from jenga_data.dataset.statistics import ColumnStatistics
from jenga_data.dataset.tables import numpy_column, open_parquet, table_writer
from jenga_data.errors import JengaError
from jenga_data.pool import run_every
from jenga_data.progress import progress


@dataclass(frozen=True, eq=False)
class Part:
    """One file of rows in a new dataset, and the statistics of its training rows."""

    file: File
    statistics: ColumnStatistics


@dataclass(frozen=True, eq=False)
class Written(Part):
    """A file that was made from logs. `episodes` are the records of its episodes, without their columns of rows."""

    episodes: list[dict[str, Any]]


@dataclass(frozen=True)
class _Task:
    folder: Path
    kind: str
    blocks: int
    shard: Shard
    train: frozenset[str]


def write_shards(
    folder: Path, kind: str, blocks: int, shards: Sequence[Shard], train: frozenset[str], workers: int
) -> list[Written]:
    """Write all shards into `folder`, from the rows that wait, in the order of their paths for any number of workers.

    Raises:
        JengaError: a worker died.
    """
    (folder / DATA).mkdir(exist_ok=True)
    tasks = [_Task(folder, kind, blocks, shard, train) for shard in shards]
    outcomes = Counter[str]()
    with progress("convert", sum(len(shard.sources) for shard in shards)) as bar:

        def each(sources: Sequence[Source]) -> None:
            outcomes.update(s.outcome for s in sources)
            bar.advance(len(sources), ", ".join(f"{count} {outcome}" for outcome, count in sorted(outcomes.items())))

        return sorted(_written(tasks, min(workers, len(tasks)), each), key=lambda part: part.file.path)


def _written(tasks: Sequence[_Task], workers: int, each: Callable[[Sequence[Source]], None]) -> Iterator[Written]:
    if workers <= 1:
        for task in tasks:
            yield _write_shard(task, lambda source: each([source]))
        return
    for task, part in run_every(_write_shard, tasks, workers):
        each(task.shard.sources)
        yield part


def _write_shard(task: _Task, each: Callable[[Source], None] = lambda _: None) -> Written:
    """Write one file, a row group in memory at a time, calling `each` after every episode."""
    refuse_name(task.folder, task.shard.path)
    columns = COLUMNS[task.kind]
    schema = arrow_schema(columns, task.blocks)
    episodes = []
    spool = SpoolReader()
    with table_writer(task.folder / task.shard.path, columns, schema) as table:
        for source in task.shard.sources:
            assert source.spooled is not None
            rows = spool.rows(source.spooled)
            table.write(rows)
            episodes.append(vars(source) | {"frames": source.spooled.frames, "rows": rows.num_rows})
            each(source)
    file = file_entry(task.folder, task.shard.path, table.rows)
    return Written(file, training_statistics(task.folder / file.path, columns, task.train), episodes)


def refuse_name(folder: Path, path: str) -> None:
    """A file that is there already may be a link to a parent's: writing to it would change that.

    Raises:
        JengaError: there is one.
    """
    if (folder / path).exists():
        raise JengaError(f"a parent misuses the name {path} for other episodes: convert its logs again")


def training_statistics(path: Path, columns: Sequence[Column], train: frozenset[str]) -> ColumnStatistics:
    """Statistics of the rows of the towers `train` in one file, as they are stored: a function of the file's bytes.

    Raises:
        CheckFailed: the file is damaged.
    """
    statistics = ColumnStatistics(columns)
    with open_parquet(path) as file:
        for group in range(file.num_row_groups):
            table = file.read_row_group(group)
            rows = {name: numpy_column(table[name]) for name in table.column_names}
            here = np.isin(np.asarray(rows["tower"]), list(train))
            statistics.add({name: column[here] for name, column in rows.items()})
    return statistics
