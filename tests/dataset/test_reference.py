"""The reference data that come with a clone: whole, as promised, and with logs that they were made from."""

from pathlib import Path

import numpy as np
import pytest

from jenga_data.dataset.locate import FOLDER
from jenga_data.dataset.manifest import MANIFEST, load_manifest
from jenga_data.dataset.read import open_dataset
from jenga_data.dataset.reference import DYNAMICS, SELECTION
from jenga_data.dataset.verify import verify
from jenga_data.log.files import file_sha256

ROOT = Path(__file__).parents[2] / FOLDER
DATASETS = sorted(path.parent for path in ROOT.glob(f"*/*/{MANIFEST}"))
LOGS = sorted((ROOT / "samples").glob("*.mcap"))
MOST_BYTES = 60_000_000

pytestmark = pytest.mark.skipif(not DATASETS, reason="this checkout came without its data")


@pytest.mark.parametrize("folder", DATASETS, ids=lambda folder: "-".join(folder.parts[-2:]))
def test_a_reference_dataset_is_whole(folder):
    report = verify(folder)
    assert report.ok, report.checks
    assert load_manifest(folder).name == folder.parent.name
    assert load_manifest(folder).version == folder.name


def test_it_is_the_paper_s_selection_data():
    """2,000 (J, b, f), one a tower, of rounds 1 to 15, 4:1."""
    dataset = open_dataset(SELECTION)
    assert len(dataset) == len(set(dataset.column("tower"))) == 2000
    assert set(dataset.column("round")) == set(range(1, 16))
    assert 0.3 <= dataset.column("failure").mean() <= 0.6
    assert len(dataset.rows("test")) == pytest.approx(400, abs=40)
    assert not np.intersect1d(dataset.rows("test"), dataset.rows("train+validation")).size


def test_it_is_the_paper_s_dynamics_data_by_the_whole_robot():
    """12,000 (J_t, b, a_t, J_t+1), of rounds 1 to 15, with slow pulls and fast ones."""
    dataset = open_dataset(DYNAMICS)
    assert len(dataset) >= 12_000
    assert set(dataset.column("round")) == set(range(1, 16))
    configs = dataset.manifest.provenance.configs.values()
    assert all(config["body"] == "robot" for config in configs)
    # Of each pull the greatest step [m]: from below 0.1 m/s to above 0.3 m/s.
    episode = dataset.column("episode")
    step = np.linalg.norm(dataset.column("action"), axis=1)
    fastest = [step[episode == key].max() for key in np.unique(episode)]
    assert np.percentile(fastest, 10) < 0.1 * 0.032
    assert np.percentile(fastest, 90) > 0.3 * 0.032
    assert np.abs(dataset.column("block_twist")).max() > 0
    assert not np.intersect1d(dataset.column("tower"), open_dataset(SELECTION).column("tower")).size


def test_all_of_it_is_small_enough_to_clone():
    assert sum(path.stat().st_size for path in ROOT.rglob("*") if path.is_file()) < MOST_BYTES


def test_every_sample_is_a_log_of_a_reference_dataset():
    known = {digest for folder in DATASETS for digest in open_dataset(folder).episodes()["log_sha256"]}
    assert len(LOGS) >= 12
    assert {file_sha256(path) for path in LOGS} <= known
