import shutil

import msgspec
import numpy as np
import pytest

from jenga_data.dataset.manifest import MANIFEST, canonical_bytes, load_manifest, sealed
from jenga_data.dataset.schema import EPISODES
from jenga_data.dataset.verify import CHECKS, verify


def failed(folder) -> dict[str, str]:
    """Detail of every check that did not pass."""
    return {name: check.detail for name, check in verify(folder).checks.items() if not check.ok}


def test_a_fresh_dataset_passes_every_check(dataset_folder):
    report = verify(dataset_folder)
    assert report.ok, failed(dataset_folder)
    assert tuple(report.checks) == CHECKS
    assert report.hash == load_manifest(dataset_folder).hash


def test_the_report_is_plain_json(selection):
    found = msgspec.json.decode(msgspec.json.encode(verify(selection).as_dict()))
    assert found["ok"] is True
    assert found["checks"]["splits"] == {"ok": True, "detail": "24 towers"}


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 0.999])
def test_one_flipped_bit_in_any_file_is_found_and_the_file_named(selection, tmp_path, share):
    for entry in [MANIFEST, *(f.path for f in load_manifest(selection).files)]:
        folder = tmp_path / entry.replace("/", "-")
        shutil.copytree(selection, folder)
        data = bytearray((folder / entry).read_bytes())
        data[int(share * len(data))] ^= 1
        (folder / entry).write_bytes(data)
        report = verify(folder)
        assert not report.ok
        assert entry in report.checks["manifest" if entry == MANIFEST else "files"].detail
        assert report.checks["edges"].detail.startswith("not run")


def test_a_manifest_written_another_way_is_found(selection, tmp_path):
    shutil.copytree(selection, tmp_path / "set")
    with (tmp_path / "set" / MANIFEST).open("ab") as file:
        file.write(b" ")
    assert "not in canonical form" in failed(tmp_path / "set")["manifest"]


def test_missing_and_extra_files_are_named(selection, tmp_path):
    shutil.copytree(selection, tmp_path / "set")
    path = load_manifest(selection).data_files[0].path
    (tmp_path / "set" / path).rename(tmp_path / "set" / "data" / "new.parquet")
    detail = failed(tmp_path / "set")["files"]
    assert f"{path} is missing" in detail
    assert "data/new.parquet is not in the manifest" in detail


def reseal(folder, out, **changes):
    shutil.copytree(folder, out)
    manifest = msgspec.structs.replace(load_manifest(folder), **changes)
    (out / MANIFEST).write_bytes(canonical_bytes(sealed(manifest)))
    return out


def test_a_tower_on_two_sides_is_a_leak(selection, tmp_path):
    splits = load_manifest(selection).splits
    leaky = msgspec.structs.replace(splits, train=[*splits.train, splits.test[0]])
    found = failed(reseal(selection, tmp_path / "set", splits=leaky))
    assert f"leak: tower {splits.test[0]} is on 2 sides" in found["splits"]


def test_a_tower_on_no_side_and_one_of_nowhere_are_found(selection, tmp_path):
    splits = load_manifest(selection).splits
    changed = msgspec.structs.replace(splits, train=[*splits.train[1:], "nowhere"])
    detail = failed(reseal(selection, tmp_path / "set", splits=changed))["splits"]
    assert f"tower {splits.train[0]} is in no split" in detail
    assert "tower nowhere is in a split and has no episode" in detail


def test_the_same_blocks_under_two_names_are_a_leak(selection, forge):
    def first_for_all(values):
        return np.broadcast_to(values[:1], values.shape)

    detail = failed(forge(selection, block_size=first_for_all, block_mass=first_for_all))["splits"]
    assert detail.startswith("leak: the blocks of tower")


def test_wrong_counts_are_found(selection, tmp_path):
    counts = msgspec.structs.replace(load_manifest(selection).counts, outcome={"stuck": 24}, dragged=0)
    detail = failed(reseal(selection, tmp_path / "set", counts=counts))["counts"]
    assert "outcome: the manifest says {'stuck': 24}" in detail
    assert "dragged" in detail


def test_features_of_another_kind_are_found(selection, dynamics, tmp_path):
    folder = reseal(selection, tmp_path / "set", features=load_manifest(dynamics).features)
    assert "other features" in failed(folder)["manifest"]


def test_a_file_with_other_columns_is_found(selection, dynamics, tmp_path):
    found = failed(reseal(selection, tmp_path / "set", kind="dynamics", features=load_manifest(dynamics).features))
    assert "next_pose" in found["schema"]


def scaled(factor):
    return lambda values: (values * factor).astype(values.dtype)


def put(value):
    """Write `value` in the middle of a column."""

    def change(values):
        values.reshape(-1)[values.size // 2] = value
        return values

    return change


def lifted(pose):
    """Block 4 of the first row, 1.3 mm higher: a little more than an edge may bridge."""
    pose[0, 4, 2] += 0.0013
    return pose


def nudged(values):
    """The first number of the first row a little larger."""
    values.reshape(-1)[0] += 1e-6
    return values


@pytest.mark.parametrize(
    ("columns", "check", "message"),
    [
        ({"next_pose": scaled(1.001)}, "ranges", "next_pose has quaternions whose length is not 1"),
        ({"block_twist": put(np.nan)}, "ranges", "block_twist is not finite"),
        ({"target": put(6)}, "ranges", "target goes from 1 to 6; allowed: 0 to 5"),
        ({"edge_lower": put(-1)}, "ranges", "edge_lower goes from -1"),
        ({"block_mass": put(0)}, "ranges", "block_mass goes from 0"),
        ({"edge_lower": put(5)}, "edges", "1 edges join blocks that do not lie on each other"),
        ({"block_pose": lifted}, "edges", "edges join blocks that do not lie on each other"),
        ({"edge_lower": put(5)}, "edges", "1 pairs of blocks that lie on each other have no edge"),
        ({"frame": put(1)}, "frames", "do not come after the one before"),
        ({"episode": put("extraction-0099")}, "frames", "have their rows apart"),
        ({"episode": put("extraction-0099")}, "episodes", "not in the table"),
        ({"round": put(9)}, "episodes", "round differs between rows and episodes"),
        ({"target_clear": put(True)}, "episodes", "target_clear does not follow"),
        ({"action": scaled(2)}, "statistics", "of action is not that of the training rows"),
        ({"tower": put("else")}, "splits", ""),
        ({"slot": lambda v: np.ones_like(v)}, "ranges", "rows have two blocks in one slot"),
        ({"next_pose": nudged}, "frames", "1 rows do not begin with the next_pose of the row before"),
        ({"next_twist": nudged}, "frames", "1 rows do not begin with the next_twist of the row before"),
        ({"frame": lambda v: v + 1}, "episodes", "a row's frame lies beyond the end of its episode"),
    ],
)
def test_rows_that_were_forged_are_found(dynamics, forge, columns, check, message):
    assert message in failed(forge(dynamics, **columns))[check]


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"failure": lambda values: np.r_[~values[:1], values[1:]]}, "failure or strict_failure does not follow"),
        ({"rows": scaled(2)}, "not as many rows"),
        ({"episode": lambda values: np.repeat(values[:1], len(values))}, "in the table twice"),
        ({"moved": lambda values: -values}, "moved is negative"),
        ({"moved": put(np.inf)}, "moved is negative or not finite"),
        ({"control_step_ns": scaled(0)}, "control_step_ns is not positive"),
        ({"clear_frame": put(5)}, "clear_frame lies beyond the end of its episode"),
    ],
)
def test_episodes_that_were_forged_are_found(dynamics, forge, columns, message):
    assert message in failed(forge(dynamics, EPISODES, **columns))["episodes"]


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"number": put(10**6)}, "1 episodes are of no recipe"),
        ({"seed": scaled(2)}, "episodes are of no recipe, first extraction-0000"),
        ({"checkpoint": lambda values: np.full(len(values), "abc")}, "episodes are of no recipe"),
        ({"log_sha256": put("0")}, "1 logs have no SHA-256"),
    ],
)
def test_episodes_of_no_recipe_are_found(dynamics, forge, columns, message):
    assert message in failed(forge(dynamics, EPISODES, **columns))["provenance"]


def test_a_config_that_was_changed_or_left_out_is_found(selection, tmp_path):
    provenance = load_manifest(selection).provenance
    (name,) = provenance.configs
    for number, (configs, message) in enumerate(
        (({name: {"rounds": [1, 2]}}, f"config '{name}' has another hash"), ({}, "use 1 configs that are not there"))
    ):
        changed = msgspec.structs.replace(provenance, configs=configs)
        assert message in failed(reseal(selection, tmp_path / str(number), provenance=changed))["provenance"]
