"""Which episodes share a file, so that new logs leave the files of old ones as they are."""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby

from jenga_data.dataset.manifest import DATA
from jenga_data.dataset.sources import Source

EPISODES_A_SHARD = 128
"""At most so many episodes share a file: 2,000 selection episodes make 16 files."""


@dataclass(frozen=True)
class Shard:
    """The episodes of one file, in the order of their rows."""

    path: str
    sources: tuple[Source, ...]


def plan(sources: Sequence[Source]) -> list[Shard]:
    """Put episodes in files, in the order of the files' names.

    An episode's file is a function of the episode alone: its collection (config, model, seed) and its number divided
    by `EPISODES_A_SHARD`. The name ends in a hash of the keys in it, so that equal names hold equal episodes.
    """
    ordered = sorted(sources, key=lambda s: (_group(s), s.number, s.episode))
    return sorted((_shard(tuple(members)) for _, members in groupby(ordered, _group)), key=lambda s: s.path)


def _group(source: Source) -> tuple[int, str, str, int]:
    return source.seed, source.config, source.checkpoint, source.number // EPISODES_A_SHARD


def _shard(sources: tuple[Source, ...]) -> Shard:
    return Shard(shard_path(sources[0].seed, sources[0].number, [s.episode for s in sources]), sources)


def shard_path(seed: int, number: int, keys: Iterable[str]) -> str:
    """Path of the file that holds the episodes `keys`, the first of them with that seed and number."""
    digest = hashlib.sha256("\n".join(keys).encode()).hexdigest()[:12]
    return f"{DATA}s{seed:07d}-n{number // EPISODES_A_SHARD * EPISODES_A_SHARD:07d}-{digest}.parquet"
