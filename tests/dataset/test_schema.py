import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jenga_data.dataset.manifest import load_manifest
from jenga_data.dataset.rows import Ragged
from jenga_data.dataset.schema import COLUMNS, EPISODE_COLUMNS, Column, arrow_schema
from jenga_data.dataset.tables import ROWS_A_GROUP, numpy_column, open_parquet, record_batch, table_writer
from jenga_data.errors import JengaError


@pytest.mark.parametrize("columns", [*COLUMNS.values(), EPISODE_COLUMNS])
def test_every_column_is_described_in_the_file(columns):
    for column, field in zip(columns, arrow_schema(columns, 6), strict=True):
        assert field.metadata.keys() == {b"description", b"unit", b"frame", b"shape"}
        assert len(field.metadata[b"description"]) > 3
        assert not field.nullable
        assert column.name == field.name


def test_the_manifest_describes_the_columns_of_the_files(dataset_folder):
    manifest = load_manifest(dataset_folder)
    schema = pq.read_schema(dataset_folder / manifest.data_files[0].path)
    for feature, field in zip(manifest.features, schema, strict=True):
        assert feature.name == field.name
        assert feature.unit.encode() == field.metadata[b"unit"]
        assert feature.description.encode() == field.metadata[b"description"]
    assert {f.name: f.shape for f in manifest.features}["block_pose"] == [6, 7]
    assert {f.name: f.shape for f in manifest.features}["edge_force"] == [None]


def test_files_open_in_plain_pyarrow_as_nested_lists(dataset_folder):
    for entry in load_manifest(dataset_folder).files:
        for field in pq.read_table(dataset_folder / entry.path).schema:
            kind = field.type
            while pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind):
                kind = kind.value_type
            assert pa.types.is_primitive(kind) or pa.types.is_string(kind)
            assert not isinstance(field.type, pa.BaseExtensionType)


def test_floats_are_split_into_byte_streams_and_compressed(dynamics):
    path = dynamics / load_manifest(dynamics).data_files[0].path
    group = pq.ParquetFile(path).metadata.row_group(0)
    leaves = {group.column(i).path_in_schema: group.column(i) for i in range(group.num_columns)}
    for column in COLUMNS["dynamics"]:
        leaf = leaves[column.parquet_path]
        assert leaf.compression == "ZSTD"
        assert ("BYTE_STREAM_SPLIT" in leaf.encodings) == (column.dtype == "float32")


def test_row_groups_are_bounded(tmp_path):
    columns = (Column("x", "float32", (2,), "", "", ""),)
    schema = arrow_schema(columns, 1)
    values = np.arange(2 * 5 * ROWS_A_GROUP, dtype=np.float32).reshape(-1, 2)
    with table_writer(tmp_path / "x.parquet", columns, schema) as table:
        for part in np.array_split(values, 100):
            table.write(record_batch({"x": part}, schema))
    with open_parquet(tmp_path / "x.parquet") as file:
        sizes = [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
        read = numpy_column(file.read()["x"])
    assert max(sizes) < 1.1 * ROWS_A_GROUP
    np.testing.assert_array_equal(np.asarray(read), values)


def test_reading_a_column_copies_nothing(dynamics):
    with open_parquet(dynamics / load_manifest(dynamics).data_files[0].path) as file:
        array = file.read(columns=["block_pose"]).column(0).chunk(0)
    column = numpy_column(array)
    assert isinstance(column, np.ndarray)
    assert column.ctypes.data == array.flatten().flatten().buffers()[1].address
    assert column.shape == (len(array), 6, 7)


def test_a_slice_of_a_list_column_starts_at_zero():
    column = numpy_column(pa.array([[1, 2], [], [3], [4, 5]], pa.list_(pa.int16())).slice(2))
    assert isinstance(column, Ragged)
    assert (column.offset.tolist(), column.values.tolist()) == ([0, 1, 3], [3, 4, 5])


def test_a_number_that_does_not_fit_is_refused():
    columns = (Column("round", "int16", (), "", "", ""),)
    with pytest.raises(JengaError, match="'round' cannot hold"):
        record_batch({"round": np.array([70_000])}, arrow_schema(columns, 1))
