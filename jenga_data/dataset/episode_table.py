"""The table of episodes as numpy columns: joined, chosen from, put in order, counted and written."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from jenga_data.dataset.manifest import Counts, File
from jenga_data.dataset.schema import EPISODE_COLUMNS, EPISODES, arrow_schema
from jenga_data.dataset.staging import file_entry
from jenga_data.dataset.tables import record_batch, table_writer

Table = dict[str, np.ndarray]
"""The columns of `episodes.parquet` by name, one entry an episode."""

_ORDER = ("seed", "config", "checkpoint", "number", "episode")


def table_of(episodes: Sequence[Mapping[str, Any]]) -> Table:
    """Records with a value for every column, as columns."""
    if not episodes:
        return {c.name: np.zeros(0, np.str_ if c.dtype == "string" else c.dtype) for c in EPISODE_COLUMNS}
    return {c.name: np.array([e[c.name] for e in episodes]) for c in EPISODE_COLUMNS}


def joined(tables: Sequence[Table]) -> Table:
    """All entries of all tables."""
    return {c.name: np.concatenate([t[c.name] for t in tables]) for c in EPISODE_COLUMNS}


def chosen(table: Table, which: Bool[np.ndarray, " episode"]) -> Table:
    """The entries where `which` is true."""
    return {name: column[which] for name, column in table.items()}


def write_episodes(folder: Path, table: Table) -> File:
    """Write `episodes.parquet`. The order is a function of the episodes alone, however they came together."""
    order = np.lexsort([table[name] for name in reversed(_ORDER)])
    schema = arrow_schema(EPISODE_COLUMNS, blocks=1)
    with table_writer(folder / EPISODES, EPISODE_COLUMNS, schema) as writer:
        writer.write(record_batch({name: table[name][order] for name in schema.names}, schema))
    return file_entry(folder, EPISODES, len(order))


def count(table: Table, rows: int, invalid: int) -> Counts:
    """Episodes by outcome, round and cause."""
    return Counts(
        rows=rows,
        episodes=len(table["episode"]),
        towers=len(set(table["tower"].tolist())),
        invalid=invalid,
        dragged=int(table["dragged"].sum()),
        outcome=dict(Counter(table["outcome"].tolist())),
        round=dict(Counter(str(r) for r in table["round"].tolist())),
        cause=dict(Counter(c for c in table["cause"].tolist() if c)),
    )


def by_round(table: Table) -> dict[int, dict[str, int]]:
    """How many episodes of each round had each outcome."""
    rounds: dict[int, Counter[str]] = {}
    for number, outcome in zip(table["round"].tolist(), table["outcome"].tolist(), strict=True):
        rounds.setdefault(number, Counter())[outcome] += 1
    return {number: dict(sorted(rounds[number].items())) for number in sorted(rounds)}
