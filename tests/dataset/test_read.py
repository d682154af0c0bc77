import shutil

import numpy as np
import pytest

from jenga_data.dataset.convert import convert
from jenga_data.dataset.locate import SEARCH_PATH
from jenga_data.dataset.manifest import MANIFEST, SPLITS, load_manifest
from jenga_data.dataset.read import open_dataset
from jenga_data.dataset.rows import in_steps
from jenga_data.dataset.schema import COLUMNS, POSE_STEP, TWIST_STEP
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.graph import support_edges
from jenga_data.log.reader import read_episode

STEPS = {"block_pose": POSE_STEP, "next_pose": POSE_STEP, "block_twist": TWIST_STEP, "next_twist": TWIST_STEP}


def test_rows_hold_what_the_logs_hold(dynamics, extraction_logs):
    dataset = open_dataset(dynamics)
    key, frame = dataset.column("episode"), dataset.column("frame")
    columns = {c.name: dataset.column(c.name) for c in COLUMNS["dynamics"] if not c.ragged}
    edges = dataset.edges()
    for row in range(len(dataset)):
        episode = read_episode(extraction_logs / f"{key[row]}.mcap")
        here = int(frame[row])
        expected = {
            "block_pose": episode.pose[here],
            "block_twist": episode.twist[here],
            "next_pose": episode.pose[here + 1],
            "next_twist": episode.twist[here + 1],
            "block_size": episode.header.blocks.size,
            "block_mass": episode.header.blocks.mass,
            "level": episode.header.layout.level,
            "slot": episode.header.layout.slot,
            "action": episode.action[here],
            "action_reached": episode.action_reached[here],
            "left_force": episode.gripper.left_force[4 * here + 1 : 4 * here + 5].mean(0),
            "right_force": episode.gripper.right_force[4 * here + 1 : 4 * here + 5].mean(0),
        }
        for name, value in expected.items():
            found, step = columns[name][row], STEPS.get(name)
            if step is None:
                np.testing.assert_array_equal(found, value.astype(found.dtype), err_msg=name)
            else:
                np.testing.assert_allclose(found.astype(float), value, rtol=0, atol=step / 2, err_msg=name)
                assert not (found.astype(float) % step).any(), name
        part = slice(edges.offset[row], edges.offset[row + 1])
        from_log = support_edges(in_steps(episode.pose[here], POSE_STEP), episode.header.blocks.size)
        np.testing.assert_array_equal([edges.upper[part], edges.lower[part]], from_log)
        assert columns["tower"][row] == episode.header.blocks.tower
        assert columns["round"][row] == episode.header.round
    assert edges.offset[-1] == len(edges.upper) == len(edges.lower) == len(edges.force)
    assert (edges.force != 0).any()


def test_types_are_as_the_features_say(dataset_folder):
    dataset = open_dataset(dataset_folder)
    for feature in dataset.manifest.features:
        if feature.shape != [None]:
            column = dataset.column(feature.name)
            assert column.shape == (len(dataset), *feature.shape)
            assert feature.dtype == "string" or column.dtype == feature.dtype


def test_columns_are_read_only_in_one_file_and_in_several(selection, two_seeds, tmp_path):
    convert(two_seeds, tmp_path / "set", "a", "1.0.0")
    for folder in (selection, tmp_path / "set"):
        assert not open_dataset(folder).column("block_pose").flags.writeable


def test_rows_of_several_files_follow_each_other(two_seeds, tmp_path):
    convert(two_seeds, tmp_path / "set", "a", "1.0.0")
    dataset = open_dataset(tmp_path / "set")
    assert dataset.column("episode").tolist() == [f"selection-{n:04d}" for n in (0, 2, 4, 6, 1, 3, 5, 7)]
    edges = dataset.edges()
    pose, size = dataset.column("block_pose").astype(float), dataset.column("block_size").astype(float)
    for row in range(8):
        part = slice(edges.offset[row], edges.offset[row + 1])
        np.testing.assert_array_equal([edges.upper[part], edges.lower[part]], support_edges(pose[row], size[row]))


def test_splits_share_out_all_rows_by_tower(dataset_folder):
    dataset = open_dataset(dataset_folder)
    rows = [dataset.rows(split) for split in SPLITS]
    np.testing.assert_array_equal(np.sort(np.concatenate(rows)), dataset.rows("all"))
    tower = dataset.column("tower")
    assert not set(tower[rows[0]]) & set(tower[rows[2]])
    np.testing.assert_array_equal(dataset.rows("train+validation"), np.sort(np.concatenate(rows[:2])))
    assert all(len(r) for r in rows)


def test_unknown_splits_and_columns_name_the_known_ones(selection):
    dataset = open_dataset(selection)
    with pytest.raises(JengaError, match="no split 'dev'; allowed: train, validation, test"):
        dataset.rows("dev")
    with pytest.raises(JengaError, match=r"no column 'posture'.*block_pose"):
        dataset.column("posture")


def test_a_dataset_is_found_by_folder_manifest_and_name(selection, tmp_path, monkeypatch):
    shutil.copytree(selection, tmp_path / "datasets_manifest" / "anything")
    monkeypatch.chdir(tmp_path)
    found = [open_dataset(where) for where in (selection, selection / MANIFEST, "test-selection@1.0.0")]
    assert {dataset.hash for dataset in found} == {load_manifest(selection).hash}
    assert found[2].folder == tmp_path / "datasets_manifest" / "anything"


def test_the_search_path_is_searched_first_and_deeper(selection, dynamics, tmp_path, monkeypatch):
    shutil.copytree(selection, tmp_path / "a" / "test-selection" / "1.0.0")
    shutil.copytree(dynamics, tmp_path / "b" / "d")
    (tmp_path / "b" / "broken").mkdir()
    (tmp_path / "b" / "broken" / MANIFEST).write_text("{")
    monkeypatch.setenv(SEARCH_PATH, f"{tmp_path / 'a'}:{tmp_path / 'b'}")
    assert open_dataset("test-selection@1.0.0").folder == tmp_path / "a" / "test-selection" / "1.0.0"
    assert open_dataset("test-dynamics@1.0.0").folder == tmp_path / "b" / "d"
    with pytest.raises(JengaError, match=r"'test-selection@9.9.9'; known: .*test-dynamics@1.0.0, test-selection@1.0.0"):
        open_dataset("test-selection@9.9.9")


def test_a_file_that_is_missing_or_short_is_named(selection, tmp_path):
    shutil.copytree(selection, tmp_path / "set")
    path = tmp_path / "set" / load_manifest(selection).data_files[0].path
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(CheckFailed, match=rf"{path.name} has \d+ bytes, not \d+"):
        open_dataset(tmp_path / "set")
    path.unlink()
    with pytest.raises(CheckFailed, match=f"{path.name} is missing"):
        open_dataset(tmp_path / "set")


def test_a_damaged_file_is_one_line_when_it_is_read(selection, tmp_path):
    shutil.copytree(selection, tmp_path / "set")
    path = tmp_path / "set" / load_manifest(selection).data_files[0].path
    path.write_bytes(b"x" * path.stat().st_size)
    with pytest.raises(CheckFailed, match=f"cannot read .*{path.name}.*jenga dataset verify") as caught:
        open_dataset(tmp_path / "set").column("tower")
    assert "\n" not in str(caught.value)
