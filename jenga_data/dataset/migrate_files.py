"""Every file of a dataset written again in another format, and the manifest that fits."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa

from jenga_data.dataset import describe
from jenga_data.dataset.manifest import MANIFEST, Manifest
from jenga_data.dataset.rows import Rows
from jenga_data.dataset.schema import EPISODE_COLUMNS, EPISODES, arrow_schema, columns_of
from jenga_data.dataset.staging import file_entry
from jenga_data.dataset.statistics import ColumnStatistics
from jenga_data.dataset.tables import numpy_column, open_parquet, record_batch, table_writer
from jenga_data.dataset.write import training_statistics
from jenga_data.errors import CheckFailed, JengaError

Lift = Callable[[Rows, pa.Schema], Rows]
"""The columns of some rows in the next format, whose schema is given."""


def manifest_of(old: Path, plain: dict[str, Any]) -> Manifest:
    """The manifest, where its fields are the same in both formats.

    Raises:
        JengaError: they are not those of a manifest.
    """
    try:
        return msgspec.convert(plain, Manifest)
    except msgspec.ValidationError as error:
        raise JengaError(f"{old / MANIFEST} is no valid manifest: {error}") from error


def rewritten(old: Path, manifest: Manifest, new: Path, to: str, brings: str, lift: Lift) -> dict[str, Any]:
    """Write all files of the dataset in `old` into `new` as `lift` changes them; returns the manifest without hash.

    Args:
        to: the format that they have then.
        brings: the column that is new in it; empty if there is none.

    Raises:
        CheckFailed: a file has not the columns of the format before.
    """
    files = []
    for file in manifest.files:
        (new / file.path).parent.mkdir(parents=True, exist_ok=True)
        columns = EPISODE_COLUMNS if file.path == EPISODES else columns_of(manifest.kind, to)
        schema = arrow_schema(columns, manifest.blocks, to)
        before = pa.schema([field for field in schema if field.name != brings])
        with table_writer(new / file.path, columns, schema) as writer, open_parquet(old / file.path) as source:
            if not source.schema_arrow.equals(before):
                raise CheckFailed(f"{old / file.path} has other columns: run `jenga dataset verify {old}`")
            for group in range(source.num_row_groups):
                for batch in source.read_row_group(group).combine_chunks().to_batches():
                    rows: Rows = {name: numpy_column(batch[name]) for name in batch.schema.names}
                    writer.write(record_batch(lift(rows, schema), schema))
        files.append(file_entry(new, file.path, file.rows))
    statistics = ColumnStatistics(columns_of(manifest.kind, to))
    for file in manifest.data_files:
        path, columns = new / file.path, columns_of(manifest.kind, to)
        statistics.merge(training_statistics(path, columns, frozenset(manifest.splits.train)))
    lifted = msgspec.structs.replace(
        manifest,
        files=files,
        features=describe.features(manifest.kind, manifest.blocks, to),
        statistics=statistics.summary(),
    )
    return msgspec.to_builtins(lifted)
