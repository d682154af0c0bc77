"""Pulling a part of a dataset: some splits, some episodes."""

import shutil

import msgspec
import numpy as np
import pytest

from jenga_data.dataset.manifest import MANIFEST, SPLITS, canonical_bytes, load_manifest, sealed
from jenga_data.dataset.read import open_dataset
from jenga_data.dataset.schema import EPISODES
from jenga_data.dataset.share.pull import pull
from jenga_data.dataset.share.push import push
from jenga_data.dataset.verify import verify
from jenga_data.errors import CheckFailed, JengaError


@pytest.mark.parametrize("split", ["train", "validation+test", "test+train"])
def test_a_part_is_a_dataset_of_its_own(dataset_folder, tmp_path, split):
    address = str(tmp_path / "there")
    push(dataset_folder, address)
    done = pull(address, tmp_path / "part", split)
    report = verify(tmp_path / "part")
    assert report.ok, report.as_dict()
    whole, part = open_dataset(dataset_folder), open_dataset(tmp_path / "part")
    parent = part.manifest.parents[0]
    assert (parent.name, parent.version, parent.hash) == (whole.manifest.name, whole.manifest.version, whole.hash)
    assert f"split {'+'.join(s for s in SPLITS if s in split)}" in part.manifest.description
    assert part.manifest.name != whole.manifest.name
    assert (done.rows, done.episodes) == (len(part), len(part.episodes()["episode"]))
    rows = whole.rows(split)
    for name in ("block_pose", "tower", "episode", "frame"):
        np.testing.assert_array_equal(part.column(name), whole.column(name)[rows])
    wanted = np.isin(np.repeat(np.arange(len(whole)), np.diff(whole.edges().offset)), rows)
    np.testing.assert_array_equal(part.edges().force, whole.edges().force[wanted])


def test_a_part_that_is_all_has_the_files_of_the_whole(dataset_folder, tmp_path):
    push(dataset_folder, str(tmp_path / "there"))
    pull(str(tmp_path / "there"), tmp_path / "part", "+".join(SPLITS))
    whole, part = load_manifest(dataset_folder), load_manifest(tmp_path / "part")
    assert part.files == whole.files
    assert part.statistics == whole.statistics
    assert msgspec.structs.replace(part.counts, invalid=whole.counts.invalid) == whole.counts


def test_a_dataset_of_another_layout_has_its_parts_too(selection, tmp_path):
    manifest = load_manifest(selection)
    shutil.copytree(selection, tmp_path / "there")
    old = manifest.data_files[0]
    (tmp_path / "there" / old.path).rename(tmp_path / "there" / "data" / "all.parquet")
    renamed = [msgspec.structs.replace(f, path="data/all.parquet") if f == old else f for f in manifest.files]
    (tmp_path / "there" / MANIFEST).write_bytes(
        canonical_bytes(sealed(msgspec.structs.replace(manifest, files=renamed)))
    )
    pull(str(tmp_path / "there"), tmp_path / "part", "test")
    assert verify(tmp_path / "part").ok


def test_parts_that_do_not_exist_are_refused(selection, tmp_path):
    there = str(tmp_path / "there")
    push(selection, there)
    whole = open_dataset(selection)
    trained = str(whole.column("episode")[whole.rows("train")[0]])
    with pytest.raises(JengaError, match="no split 'half'; allowed: train, validation, test"):
        pull(there, tmp_path / "part", "half")
    with pytest.raises(JengaError, match=r"no episode 'nobody' in test-selection@1.0.0, which has 24 episodes"):
        pull(there, tmp_path / "part", episodes=["nobody"])
    with pytest.raises(JengaError, match=f"no episode '{trained}' in split test of"):
        pull(there, tmp_path / "part", "test", [trained])


def test_a_part_whose_table_promises_other_rows_is_refused(dynamics, tmp_path, forge):
    whole = open_dataset(dynamics)
    trained = str(whole.column("episode")[whole.rows("train")[0]])
    promising = forge(dynamics, EPISODES, rows=lambda rows: rows + (whole.episodes()["episode"] == trained))
    push(promising, str(tmp_path / "there"))
    with pytest.raises(CheckFailed, match=r"promises 5 rows of the wanted episodes and its files hold 4"):
        pull(str(tmp_path / "there"), tmp_path / "part", episodes=[trained])
    assert not (tmp_path / "part").exists()
