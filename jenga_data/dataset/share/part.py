"""A part of a dataset as a dataset of its own: its splits or episodes, with a manifest that names the whole."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import msgspec
import numpy as np
import pyarrow as pa

from jenga_data.dataset import tally
from jenga_data.dataset.manifest import (
    MANIFEST,
    SPLITS,
    File,
    Manifest,
    Parent,
    Splits,
    canonical_bytes,
    sealed,
)
from jenga_data.dataset.read import Dataset
from jenga_data.dataset.rows import Rows
from jenga_data.dataset.schema import COLUMNS, EPISODE_COLUMNS, EPISODES, FORMAT_VERSION, arrow_schema
from jenga_data.dataset.shards import Shard, plan
from jenga_data.dataset.sources import Source, Sources
from jenga_data.dataset.staging import file_entry
from jenga_data.dataset.statistics import ColumnStatistics
from jenga_data.dataset.tables import numpy_column, open_parquet, record_batch, table_writer
from jenga_data.errors import CheckFailed, JengaError


@dataclass(frozen=True)
class Part:
    """What is wanted of a dataset: the episodes of some splits (of all where there is none), and of them these."""

    splits: tuple[str, ...]
    episodes: tuple[str, ...]

    @property
    def words(self) -> str:
        """For the manifest."""
        splits = f"split {'+'.join(self.splits)}" if self.splits else ""
        return " and ".join(t for t in (splits, f"{len(self.episodes)} named episodes" if self.episodes else "") if t)

    def name(self, whole: str) -> str:
        """Of the part: it must not be mistaken for the whole, which has the same version."""
        suffix = "-".join(self.splits)
        if self.episodes:
            keys = "\n".join((*self.splits, *sorted(self.episodes)))
            suffix = f"part-{hashlib.sha256(keys.encode()).hexdigest()[:8]}"
        return f"{whole[: 63 - len(suffix)]}.{suffix}"


def part_of(split: str, episodes: Sequence[str]) -> Part:
    """Read what a person asks for; splits are put in order, so that the same part has one name.

    Raises:
        JengaError: there is no such split.
    """
    asked = split.split("+") if split else []
    if unknown := set(asked) - set(SPLITS):
        raise JengaError(f"no split {min(unknown)!r}; allowed: {', '.join(SPLITS)}, or a sum of them")
    return Part(tuple(s for s in SPLITS if s in asked), tuple(dict.fromkeys(episodes)))


def sources_of(episodes: dict[str, np.ndarray]) -> list[Source]:
    """The logs that a dataset was made from, in order, as its table of episodes tells of them.

    Raises:
        CheckFailed: the table's `versions` are not what a converter writes.
    """
    for text in set(episodes["versions"].tolist()):
        try:
            msgspec.json.decode(text, type=dict[str, str])
        except msgspec.DecodeError as error:
            raise CheckFailed(f"{EPISODES} has versions that are none ({error}): get the dataset elsewhere") from error
    names = [f.name for f in fields(Source) if f.name != "path"]
    values = zip(*(episodes[name].tolist() for name in names), strict=True)
    sources = [Source(path=Path(), **dict(zip(names, v, strict=True))) for v in values]
    return sorted(sources, key=lambda s: (s.seed, s.config, s.checkpoint, s.number, s.episode))


def choose(part: Part, manifest: Manifest, sources: Sequence[Source]) -> list[Source]:
    """The episodes of a part.

    Raises:
        JengaError: a named episode is not in the dataset, or not in the splits; or the part is empty.
    """
    towers = {t for s in part.splits or SPLITS for t in manifest.splits.towers(s)}
    chosen = [s for s in sources if s.tower in towers or not part.splits]
    if part.episodes:
        chosen = [s for s in chosen if s.episode in set(part.episodes)]
        if missing := set(part.episodes) - {s.episode for s in chosen}:
            inside = f"split {'+'.join(part.splits)} of " if part.splits else ""
            raise JengaError(
                f"no episode {min(missing)!r} in {inside}{manifest.identifier}, which has {len(sources)} episodes: "
                f"the keys are in its {EPISODES}"
            )
    if not chosen:
        raise JengaError(f"{part.words} of {manifest.identifier} holds no episode")
    return chosen


def files_of(manifest: Manifest, sources: Sequence[Source], chosen: Sequence[Source]) -> list[File]:
    """The files in which the rows of the chosen episodes are: a file is a function of its episodes.

    Where a dataset was laid out another way, all its files.
    """
    keys = {s.episode for s in chosen}
    shards = plan(sources)
    if {s.path for s in shards} != {f.path for f in manifest.data_files}:
        return manifest.data_files
    needed = {s.path for s in shards if any(source.episode in keys for source in s.sources)}
    return [f for f in manifest.data_files if f.path in needed]


def write_part(whole: Dataset, part: Part, chosen: Sequence[Source], files: Sequence[File], folder: Path) -> Manifest:
    """Write the dataset of the chosen episodes into an empty folder, in the converter's order and bytes.

    Args:
        whole: where of the data only `files` need to be there, with the right hashes.

    Raises:
        CheckFailed: the files do not hold the rows that the table of episodes promises.
        JengaError: the part has no rows.
    """
    manifest = whole.manifest
    columns, schema = COLUMNS[manifest.kind], arrow_schema(COLUMNS[manifest.kind], manifest.blocks)
    statistics = ColumnStatistics(columns)
    rows_of = _RowsOf(whole.folder, [f.path for f in files])
    shards = plan(chosen)
    (folder / "data").mkdir(parents=True)
    entries = []
    for shard in shards:
        with table_writer(folder / shard.path, columns, schema) as table:
            for source in shard.sources:
                for rows in rows_of(source.episode):
                    table.write(record_batch(rows, schema))
                    if source.tower in manifest.splits.train:
                        statistics.add(rows)
        entries.append(file_entry(folder, shard.path, table.rows))
    entries.append(_write_episodes(whole.folder, folder, shards))
    rows = sum(f.rows for f in entries if f.path != EPISODES)
    if not rows:
        raise JengaError(f"{part.words} of {manifest.identifier} holds no row")
    _check_promise(whole, chosen, rows)
    derived = _manifest(manifest, part, chosen, entries, rows, statistics)
    (folder / MANIFEST).write_bytes(canonical_bytes(derived))
    return derived


class _RowsOf:
    """Finds the rows of an episode in the files of the whole; keeps one file in memory."""

    def __init__(self, folder: Path, paths: Sequence[str]) -> None:
        self._folder = folder
        self._at: dict[str, tuple[str, int, int]] = {}
        self._open: tuple[str, pa.Table | None] = ("", None)
        for path in paths:
            with open_parquet(folder / path) as file:
                keys = np.asarray(numpy_column(file.read(columns=["episode"]).column(0)))
            starts = np.flatnonzero(np.r_[len(keys) > 0, keys[1:] != keys[:-1]])
            counts = np.diff(np.r_[starts, len(keys)])
            for start, count in zip(starts.tolist(), counts.tolist(), strict=True):
                self._at[str(keys[start])] = (path, start, count)

    def __call__(self, episode: str) -> Iterator[Rows]:
        """Its rows at once, or nothing where it has none."""
        if episode not in self._at:
            return
        path, start, count = self._at[episode]
        if self._open[0] != path:
            with open_parquet(self._folder / path) as file:
                self._open = (path, file.read().combine_chunks())
        table = self._open[1]
        assert table is not None
        rows = table.slice(start, count)
        yield {name: numpy_column(rows[name]) for name in rows.column_names}


def _write_episodes(whole: Path, folder: Path, shards: Sequence[Shard]) -> File:
    with open_parquet(whole / EPISODES) as file:
        table = file.read()
    at = {key: i for i, key in enumerate(table["episode"].to_pylist())}
    order = [at[source.episode] for shard in shards for source in shard.sources]
    schema = arrow_schema(EPISODE_COLUMNS, blocks=1)
    with table_writer(folder / EPISODES, EPISODE_COLUMNS, schema) as writer:
        chosen = table.take(order)
        writer.write(record_batch({n: numpy_column(chosen[n]) for n in schema.names}, schema))
    return file_entry(folder, EPISODES, len(order))


def _check_promise(whole: Dataset, chosen: Sequence[Source], rows: int) -> None:
    episodes = whole.episodes()
    promised = int(episodes["rows"][np.isin(episodes["episode"], [s.episode for s in chosen])].sum())
    if promised != rows:
        raise CheckFailed(
            f"{whole.manifest.identifier} promises {promised} rows of the wanted episodes and its files hold {rows}"
        )


def _manifest(
    whole: Manifest, part: Part, chosen: Sequence[Source], files: list[File], rows: int, statistics: ColumnStatistics
) -> Manifest:
    configs = {c: v for c, v in whole.provenance.configs.items() if c in {s.config for s in chosen}}
    sources = Sources(whole.kind, whole.blocks, list(chosen), configs)
    towers = {s.tower for s in chosen}
    sides = {s: [t for t in whole.splits.towers(s) if t in towers] for s in SPLITS}
    text = f"Part of {whole.identifier} (hash {whole.hash}): {part.words}."
    return sealed(
        msgspec.structs.replace(
            whole,
            name=part.name(whole.name),
            format_version=FORMAT_VERSION,
            description=f"{text} {whole.description}",
            files=sorted(files, key=lambda f: f.path),
            splits=Splits(rule=f"those of {whole.identifier}: {whole.splits.rule}", **sides),
            statistics=statistics.summary(),
            counts=tally.counts(sources, rows),
            provenance=tally.provenance(sources),
            parents=[Parent(whole.name, whole.version, whole.hash)],
            sources=[],
            hash="",
        )
    )
