"""From format 1.0 to 1.1, which has the column `block_wedge`, and poses, velocities and forces in steps."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa

from jenga_data.dataset import describe
from jenga_data.dataset.manifest import MANIFEST, Manifest
from jenga_data.dataset.rows import Ragged, Rows, in_steps
from jenga_data.dataset.schema import (
    EPISODE_COLUMNS,
    EPISODES,
    FORCE_STEP,
    POSE_STEP,
    TWIST_STEP,
    arrow_schema,
    columns_of,
)
from jenga_data.dataset.staging import file_entry
from jenga_data.dataset.statistics import ColumnStatistics
from jenga_data.dataset.tables import numpy_column, open_parquet, record_batch, table_writer
from jenga_data.dataset.write import training_statistics
from jenga_data.errors import CheckFailed, JengaError

_TO = "1.1.0"
_WEDGE = "block_wedge"
_STEP = {
    "block_pose": POSE_STEP,
    "next_pose": POSE_STEP,
    "block_twist": TWIST_STEP,
    "next_twist": TWIST_STEP,
    "edge_force": FORCE_STEP,
}


def add_wedge(old: Path, plain: dict[str, Any], new: Path) -> dict[str, Any]:
    """Every block gets the wedge 0, which is that of a box; what comes in steps is rounded to them.

    Raises:
        CheckFailed: a file has not the columns of format 1.0.
        JengaError: the config of a collection had wedge-shaped blocks: their wedges are in its logs alone.
    """
    try:
        manifest = msgspec.convert(plain, Manifest)  # whose fields are the same in both formats
    except msgspec.ValidationError as error:
        raise JengaError(f"{old / MANIFEST} is no valid manifest: {error}") from error
    for key, config in manifest.provenance.configs.items():
        spawn = config.get("spawn")
        if isinstance(spawn, dict) and spawn.get("wedge"):
            raise JengaError(
                f"{old} has wedge-shaped blocks (config {key}), whose wedges format 1.0 did not keep: convert its logs "
                "again with `jenga convert`"
            )
    files = []
    for file in manifest.files:
        (new / file.path).parent.mkdir(parents=True, exist_ok=True)
        columns = EPISODE_COLUMNS if file.path == EPISODES else columns_of(manifest.kind, _TO)
        schema = arrow_schema(columns, manifest.blocks, _TO)
        before = pa.schema([field for field in schema if field.name != _WEDGE])
        with table_writer(new / file.path, columns, schema) as writer, open_parquet(old / file.path) as source:
            if not source.schema_arrow.equals(before):
                raise CheckFailed(f"{old / file.path} has other columns: run `jenga dataset verify {old}`")
            for group in range(source.num_row_groups):
                for batch in source.read_row_group(group).combine_chunks().to_batches():
                    writer.write(_lifted(batch, schema))
        files.append(file_entry(new, file.path, file.rows))
    statistics = ColumnStatistics(columns_of(manifest.kind, _TO))
    for file in manifest.data_files:
        path, columns = new / file.path, columns_of(manifest.kind, _TO)
        statistics.merge(training_statistics(path, columns, frozenset(manifest.splits.train)))
    lifted = msgspec.structs.replace(
        manifest,
        files=files,
        features=describe.features(manifest.kind, manifest.blocks, _TO),
        statistics=statistics.summary(),
    )
    return msgspec.to_builtins(lifted)


def _lifted(batch: pa.RecordBatch, schema: pa.Schema) -> pa.RecordBatch:
    rows: Rows = {name: numpy_column(batch[name]) for name in batch.schema.names}
    for name in rows.keys() & _STEP.keys():
        column, step = rows[name], _STEP[name]
        ragged = isinstance(column, Ragged)
        rows[name] = Ragged(column.offset, in_steps(column.values, step)) if ragged else in_steps(column, step)
    if _WEDGE in schema.names:
        rows[_WEDGE] = np.zeros((batch.num_rows, schema.field(_WEDGE).type.list_size))
    return record_batch(rows, schema)
