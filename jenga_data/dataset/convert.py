"""Logs in, a dataset out: byte-identical for the same logs in any order, one episode in memory at a time."""

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jenga_data.dataset import describe, tally
from jenga_data.dataset.manifest import MANIFEST, File, Manifest, canonical_bytes, check_identity, sealed
from jenga_data.dataset.rows import rows_of
from jenga_data.dataset.schema import COLUMNS, EPISODE_COLUMNS, EPISODES, FORMAT_VERSION, arrow_schema
from jenga_data.dataset.shards import Shard, plan
from jenga_data.dataset.sources import Sources, read_sources
from jenga_data.dataset.split import split_towers
from jenga_data.dataset.staging import file_entry, new_folder, refuse_existing
from jenga_data.dataset.statistics import ColumnStatistics
from jenga_data.dataset.tables import record_batch, table_writer
from jenga_data.errors import JengaError
from jenga_data.log.reader import read_for_rows
from jenga_data.progress import progress


def convert(
    logs: Sequence[Path], out: Path, name: str, version: str, *, licence: str = describe.LICENCE, description: str = ""
) -> Manifest:
    """Make the dataset NAME@VERSION in the new folder `out` from all logs below the folders `logs`.

    The kind follows from the logs. Episodes whose physics broke are counted in the manifest and in no file.

    Raises:
        JengaError: `out` exists or cannot be written, or the logs are damaged, unfinished, mixed or too few.
    """
    check_identity(name, version)
    refuse_existing(out)
    sources = read_sources(logs)
    splits = split_towers(s.tower for s in sources.valid)
    with new_folder(out) as folder:
        writer = _ShardWriter(folder, sources, frozenset(splits.train))
        with progress("convert", len(sources.valid)) as bar:
            files = [writer.write(shard, lambda: bar.advance(note=writer.summary())) for shard in plan(sources.valid)]
        counts = tally.counts(sources, rows=sum(f.rows for f in files))
        if not writer.statistics.rows:
            raise JengaError(f"the logs give {counts.rows} rows, none of them to train on: collect more episodes")
        files.append(_write_episodes(folder, writer.episodes))
        unsealed = Manifest(
            name=name,
            version=version,
            format_version=FORMAT_VERSION,
            kind=sources.kind,
            description=description or describe.DESCRIPTION[sources.kind],
            blocks=sources.blocks,
            features=describe.features(sources.kind, sources.blocks),
            files=sorted(files, key=lambda f: f.path),
            splits=splits,
            statistics=writer.statistics.summary(),
            labels=describe.labels(),
            counts=counts,
            provenance=tally.provenance(sources),
            parents=[],
            licence=licence,
            citation=list(describe.CITATION),
            sources=[],
        )
        manifest = sealed(unsealed)
        (folder / MANIFEST).write_bytes(canonical_bytes(manifest))
    return manifest


class _ShardWriter:
    """Writes shard after shard; keeps what the rest of the dataset needs of their episodes."""

    def __init__(self, folder: Path, sources: Sources, train: frozenset[str]) -> None:
        (folder / "data").mkdir()
        self._folder = folder
        self._columns = COLUMNS[sources.kind]
        self._schema = arrow_schema(self._columns, sources.blocks)
        self._train = train
        self._outcomes = Counter[str]()
        self.statistics = ColumnStatistics(self._columns)
        self.episodes: list[dict[str, Any]] = []

    def write(self, shard: Shard, each: Callable[[], None]) -> File:
        """Write one file, calling `each` after every episode."""
        with table_writer(self._folder / shard.path, self._columns, self._schema) as table:
            for source in shard.sources:
                episode, frames = read_for_rows(source.path, first_frame=source.kind == "selection")
                rows = rows_of(episode)
                table.write(record_batch(rows, self._schema))
                if source.tower in self._train:
                    self.statistics.add(rows)
                self.episodes.append(vars(source) | {"frames": frames, "rows": len(rows["frame"])})
                self._outcomes[source.outcome] += 1
                each()
        return file_entry(self._folder, shard.path, table.rows)

    def summary(self) -> str:
        """How many episodes of each outcome were written so far."""
        return ", ".join(f"{count} {outcome}" for outcome, count in sorted(self._outcomes.items()))


def _write_episodes(folder: Path, episodes: list[dict[str, Any]]) -> File:
    schema = arrow_schema(EPISODE_COLUMNS, blocks=1)
    with table_writer(folder / EPISODES, EPISODE_COLUMNS, schema) as table:
        table.write(record_batch({n: np.array([e[n] for e in episodes]) for n in schema.names}, schema))
    return file_entry(folder, EPISODES, len(episodes))
