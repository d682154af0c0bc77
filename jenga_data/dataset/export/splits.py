"""One Parquet file a split: tools that know splits know them as files, while ours hold episodes of several."""

from pathlib import Path

import numpy as np

from jenga_data.dataset.manifest import SPLITS, File
from jenga_data.dataset.read import Dataset
from jenga_data.dataset.schema import COLUMNS, EPISODES, arrow_schema
from jenga_data.dataset.staging import file_entry
from jenga_data.dataset.tables import numpy_column, open_parquet, record_batch, table_writer


def write_splits(dataset: Dataset, folder: Path) -> dict[str, File]:
    """Write `data/SPLIT.parquet` of every split that has rows, and a copy of `episodes.parquet`.

    Rows keep their order and columns; the same dataset gives the same bytes. One row group is in memory at a time.

    Returns:
        The files that were written by the name of the split, the table of episodes under "episodes".

    Raises:
        CheckFailed: a file is damaged.
    """
    (folder / "data").mkdir()
    found = {split: _write_split(dataset, folder, split) for split in SPLITS if len(dataset.rows(split))}
    (folder / EPISODES).write_bytes((dataset.folder / EPISODES).read_bytes())
    return found | {"episodes": file_entry(folder, EPISODES, dataset.manifest.counts.episodes)}


def _write_split(dataset: Dataset, folder: Path, split: str) -> File:
    manifest, path = dataset.manifest, f"data/{split}.parquet"
    schema = arrow_schema(COLUMNS[manifest.kind], manifest.blocks)
    towers = manifest.splits.towers(split)
    with table_writer(folder / path, COLUMNS[manifest.kind], schema) as table:
        for entry in manifest.data_files:
            with open_parquet(dataset.folder / entry.path) as file:
                for group in range(file.num_row_groups):
                    found = file.read_row_group(group)
                    rows = {name: numpy_column(found[name]) for name in found.column_names}
                    chosen = np.isin(np.asarray(rows["tower"]), towers)
                    if chosen.any():
                        table.write(record_batch({n: column[chosen] for n, column in rows.items()}, schema))
    return file_entry(folder, path, table.rows)
