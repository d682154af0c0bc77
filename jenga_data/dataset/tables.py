"""The border between numpy columns and Parquet files: byte-stable writing, zero-copy reading."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from jenga_data.dataset.rows import Ragged, Rows
from jenga_data.dataset.schema import Column
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.limits import MAX_GROUP_BYTES, MAX_NAME, MAX_ROW_BYTES, MAX_THRIFT_CONTAINER, MAX_THRIFT_STRING

ROWS_A_GROUP = 1024
"""A row group is written as soon as so many rows have come together (7 MB of a 54-block dynamics dataset)."""


def record_batch(rows: Rows, schema: pa.Schema) -> pa.RecordBatch:
    """Columns in the order and types of `schema`; every column of the schema must be there.

    Raises:
        JengaError: a value does not fit the type of its column.
    """
    if rows.keys() != set(schema.names):
        raise ValueError(f"columns differ from the schema: {sorted(rows.keys() ^ set(schema.names))}")
    arrays = []
    for field in schema:
        try:
            arrays.append(_to_arrow(rows[field.name], field.type))
        except (pa.ArrowInvalid, OverflowError) as error:
            raise JengaError(f"column {field.name!r} cannot hold what the logs say: {error}") from error
    return pa.RecordBatch.from_arrays(arrays, schema=schema)


def _to_arrow(values: np.ndarray | Ragged, kind: pa.DataType) -> pa.Array:
    if isinstance(values, Ragged):
        assert isinstance(kind, pa.ListType)
        offset = pa.array(values.offset, pa.int32())
        return pa.ListArray.from_arrays(offset, _leaf(values.values, kind.value_type), type=kind)
    nested = [kind]
    while isinstance(nested[-1], pa.FixedSizeListType):
        nested.append(nested[-1].value_type)
    shape = tuple(t.list_size for t in nested[:-1])
    if values.shape[1:] != shape:
        raise ValueError(f"a column of shape {values.shape[1:]} where the schema has {shape}")
    array = _leaf(values.reshape(-1), nested[-1])
    for outer in reversed(nested[:-1]):
        array = pa.FixedSizeListArray.from_arrays(array, type=outer)
    return array


def _leaf(values: np.ndarray, kind: pa.DataType) -> pa.Array:
    """Floats are rounded to 32 bit; a number that an integer type cannot hold is an error."""
    if pa.types.is_floating(kind):
        with np.errstate(over="ignore"):  # an absurd value becomes infinite, which `verify` names
            return pa.array(values.astype(np.float32), kind)
    return pa.array(values, kind)


@contextmanager
def table_writer(path: Path, columns: Sequence[Column], schema: pa.Schema) -> Iterator["TableWriter"]:
    """Open a Parquet file to stream rows into. The same rows in the same batches give the same bytes.

    Floats are split into byte streams before zstd: their high bytes repeat from row to row and their low bytes do
    not. Content-defined chunks keep equal stretches of two versions of a file equal, for storage that deduplicates.
    """
    # The stubs know only the two options' boolean form; the documentation has lists of columns.
    floats: Any = [c.parquet_path for c in columns if c.dtype == "float32"]
    others: Any = [c.parquet_path for c in columns if c.dtype != "float32"]
    with pq.ParquetWriter(
        path,
        schema,
        compression="zstd",
        compression_level=9,
        use_dictionary=others,
        use_byte_stream_split=floats,
        use_content_defined_chunking=True,
        write_page_index=True,
    ) as writer:
        table = TableWriter(writer)
        yield table
        table.flush()


class TableWriter:
    """Collects batches into row groups of bounded size, so that memory does not grow with the file."""

    def __init__(self, writer: pq.ParquetWriter) -> None:
        self._writer = writer
        self._waiting: list[pa.RecordBatch] = []
        self.rows = 0

    def write(self, batch: pa.RecordBatch) -> None:
        self._waiting.append(batch)
        self.rows += batch.num_rows
        if sum(b.num_rows for b in self._waiting) >= ROWS_A_GROUP:
            self.flush()

    def flush(self) -> None:
        table = pa.Table.from_batches(self._waiting, schema=self._writer.schema)
        if table.num_rows:
            self._writer.write_table(table.combine_chunks(), row_group_size=table.num_rows)
        self._waiting = []


@contextmanager
def open_parquet(path: Path, metadata: pq.FileMetaData | None = None) -> Iterator[pq.ParquetFile]:
    """Open a memory-mapped Parquet file for reading; its `metadata` need not be read a second time.

    Raises:
        CheckFailed: the file is damaged, no Parquet file, or claims to unpack to more than is allowed.
    """
    try:
        with pq.ParquetFile(
            path,
            memory_map=True,
            metadata=metadata,
            thrift_string_size_limit=MAX_THRIFT_STRING,
            thrift_container_size_limit=MAX_THRIFT_CONTAINER,
        ) as file:
            if metadata is None:
                _check_claims(file.metadata)
            yield file
    except (pa.ArrowException, OSError, UnicodeError) as error:
        reason = (str(error).splitlines() or ["it cannot be decoded"])[0][: 2 * MAX_NAME]
        raise CheckFailed(f"cannot read {path}: {reason}: run `jenga dataset verify` on its folder") from error


def _check_claims(metadata: pq.FileMetaData) -> None:
    """Arrow allocates what a file claims to unpack to. A claim may still be a lie: see `Dataset`.

    Raises:
        OSError: a claim exceeds `jenga_data.limits`, or makes no sense.
    """
    rows = 0
    for number in range(metadata.num_row_groups):
        group = metadata.row_group(number)
        claims = [group.column(i).total_uncompressed_size for i in range(group.num_columns)]
        if (
            not 0 <= sum(claims) <= min(MAX_GROUP_BYTES, MAX_ROW_BYTES * (1 + max(group.num_rows, 0)))
            or min(claims) < 0
        ):
            raise OSError(f"row group {number} claims to unpack to {sum(claims)} bytes")
        rows += group.num_rows
    if rows != metadata.num_rows:
        raise OSError(f"it claims {metadata.num_rows} rows and has {rows}")


def numpy_column(array: pa.Array | pa.ChunkedArray) -> np.ndarray | Ragged:
    """One column as numpy, without a copy where it lies in one piece (numbers and fixed-size lists of them do)."""
    if isinstance(array, pa.ChunkedArray):
        array = array.combine_chunks() if array.num_chunks != 1 else array.chunk(0)
    if isinstance(array, pa.ListArray):
        offset = array.offsets.to_numpy().astype(np.int64)
        values = numpy_column(array.flatten())
        assert isinstance(values, np.ndarray)
        return Ragged(offset - offset[0], values)
    shape = [len(array)]
    while isinstance(array, pa.FixedSizeListArray):
        shape.append(array.type.list_size)
        array = array.flatten()
    if pa.types.is_string(array.type):
        return array.to_numpy(zero_copy_only=False).astype(str)
    return array.to_numpy(zero_copy_only=not pa.types.is_boolean(array.type)).reshape(shape)
