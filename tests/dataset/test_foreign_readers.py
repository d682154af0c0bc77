"""People without this project read a dataset in one line: the lines of README.md."""

import warnings
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from jenga_data.dataset.read import open_dataset


def imported(name: str) -> ModuleType:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pytest.importorskip(name, reason=f"{name} is not installed: pip install 'jenga[test]'")


def assert_same(poses: np.ndarray, towers: list[str], folder: Path) -> None:
    dataset = open_dataset(folder)
    assert towers == dataset.column("tower").tolist()
    np.testing.assert_array_equal(np.asarray(poses, np.float32), dataset.column("block_pose"))


def test_duckdb(dataset_folder):
    duckdb = imported("duckdb")
    found = duckdb.sql(f"SELECT block_pose, tower FROM '{dataset_folder}/data/*.parquet'").fetchall()
    assert_same(np.array([row[0] for row in found]), [row[1] for row in found], dataset_folder)


def test_polars(dataset_folder):
    polars = imported("polars")
    rows = polars.read_parquet(f"{dataset_folder}/data/*.parquet")
    assert_same(rows["block_pose"].to_numpy(), rows["tower"].to_list(), dataset_folder)


@pytest.mark.filterwarnings("ignore")
def test_pandas(dataset_folder):
    pandas = imported("pandas")
    rows = pandas.read_parquet(f"{dataset_folder}/data")
    poses = np.array([np.stack(list(pose)) for pose in rows["block_pose"]])
    assert_same(poses, rows["tower"].tolist(), dataset_folder)


@pytest.mark.filterwarnings("ignore")
def test_datasets(dataset_folder, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_DATASETS_OFFLINE", "1")
    datasets = imported("datasets")
    rows = datasets.load_dataset(
        "parquet", data_files=f"{dataset_folder}/data/*.parquet", split="train", cache_dir=str(tmp_path / "cache")
    )
    assert_same(np.array(list(rows["block_pose"])), list(rows["tower"]), dataset_folder)
