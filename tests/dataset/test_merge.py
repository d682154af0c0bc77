import os
import shutil
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from jenga_data.dataset.convert import convert
from jenga_data.dataset.manifest import MANIFEST, SPLITS, Manifest, canonical_bytes, load_manifest, sealed
from jenga_data.dataset.merge import merge
from jenga_data.dataset.read import open_dataset
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.outcome import Outcome

ONE, TWO = range(4), range(128, 133)
"""Numbers of two collections' parts that lie in different files."""


def together(made, tmp_path, *names: str) -> Manifest:
    """The dataset of the logs of several others, all converted at once."""
    return convert([tmp_path / f"{name}-logs" for name in names], tmp_path / "all", "all", "1.0.0")


def bare(manifest: Manifest) -> dict:
    """All that a manifest says of its content."""
    plain = msgspec.to_builtins(manifest)
    return {k: v for k, v in plain.items() if k not in ("name", "version", "hash", "parents")}


@pytest.mark.parametrize("kind", ["selection", "extraction"])
def test_merging_is_converting_all_logs_together(made, whole, tmp_path, kind):
    a, b = made("a", [*ONE, 9], kind, invalid=[9]), made("b", TWO, kind)
    edited = merge([a, b], tmp_path / "out", "all", "1.0.0")
    assert bare(edited.manifest) == bare(together(made, tmp_path, "a", "b"))  # the hash of every file among it
    assert (edited.taken, edited.written, edited.copies) == (2, 0, 0)
    assert edited.manifest.counts.invalid == 1
    assert whole(tmp_path / "out")


def test_the_parents_are_named_with_their_hashes(made, tmp_path):
    folders = [made("a", ONE), made("b", TWO)]
    parents = merge(folders, tmp_path / "out", "all", "1.0.0").manifest.parents
    manifests = [load_manifest(folder) for folder in folders]
    assert [(p.name, p.version, p.hash) for p in parents] == [(m.name, m.version, m.hash) for m in manifests]


def test_datasets_that_share_a_range_of_numbers_keep_their_files(made, rows_in, whole, tmp_path):
    a, b = made("a", range(0, 10, 2)), made("b", range(1, 10, 2))
    edited = merge([a, b], tmp_path / "out", "all", "1.0.0")
    together(made, tmp_path, "a", "b")
    assert (edited.taken, edited.written) == (2, 0)
    assert rows_in(tmp_path / "out").equals(rows_in(tmp_path / "all"))
    assert whole(tmp_path / "out")


def test_files_are_taken_over_by_link_where_that_is_possible(made, tmp_path):
    a, b = made("a", ONE), made("b", TWO)
    merge([a, b], tmp_path / "out", "all", "1.0.0")
    for folder in (a, b):
        (path,) = (folder / "data").iterdir()
        assert (tmp_path / "out" / "data" / path.name).samefile(path)


def test_files_are_copied_where_there_are_no_links(made, whole, tmp_path, monkeypatch):
    def no_link(*_: object) -> None:
        raise OSError(18, "Invalid cross-device link")

    a, b = made("a", ONE), made("b", TWO)
    monkeypatch.setattr(os, "link", no_link)
    edited = merge([a, b], tmp_path / "out", "all", "1.0.0")
    assert edited.taken == 2
    assert whole(tmp_path / "out")
    for path in (a / "data").iterdir():
        assert not (tmp_path / "out" / "data" / path.name).samefile(path)


@pytest.mark.parametrize(("second", "written", "copies"), [(range(8), 0, 4), (range(2, 8), 1, 2), (range(3), 0, 3)])
def test_episodes_of_several_parents_count_once(made, rows_in, whole, tmp_path, second, written, copies):
    a, b = made("a", ONE), made("b", second)
    before = {path: path.read_bytes() for folder in (a, b) for path in folder.rglob("*.*")}
    edited = merge([a, b], tmp_path / "out", "all", "1.0.0")
    together(made, tmp_path, "a", "b")
    assert (edited.written, edited.copies) == (written, copies)
    assert rows_in(tmp_path / "out").equals(rows_in(tmp_path / "all"))
    assert (tmp_path / "out" / "episodes.parquet").read_bytes() == (tmp_path / "all" / "episodes.parquet").read_bytes()
    assert whole(tmp_path / "out")
    assert {path: path.read_bytes() for path in before} == before


def test_the_order_of_the_parents_changes_nothing_but_their_list(made, tmp_path):
    a, b = made("a", range(6)), made("b", range(3, 9))
    first = merge([a, b], tmp_path / "first", "all", "1.0.0").manifest
    second = merge([b, a], tmp_path / "second", "all", "1.0.0").manifest
    assert first.parents == second.parents[::-1]
    assert bare(first) == bare(second)


def test_broken_episodes_of_several_parents_count_once(made, tmp_path):
    a, b = made("a", [*ONE, 9, 10], invalid=[9, 10]), made("b", [*TWO, 10, 11], invalid=[10, 11])
    manifest = merge([a, b], tmp_path / "out", "all", "1.0.0").manifest
    assert manifest.counts.invalid == 3
    assert [r.numbers for r in manifest.provenance.recipes] == [[(0, 3), (9, 11), (128, 132)]]


def test_episodes_without_rows_stay_in_the_table(episode_of, write, made, whole, tmp_path):
    none = np.zeros((0, 3))
    a = made("a", ONE, "extraction")
    empty = replace(episode_of("extraction", 128), action_frame=np.zeros(0, np.int64), action=none, action_reached=none)
    write(empty, tmp_path / "b-logs")
    b = made("b", range(129, 133), "extraction")
    merge([a, b], tmp_path / "out", "all", "1.0.0")
    assert "extraction-0128" in open_dataset(tmp_path / "out").episodes()["episode"]
    assert whole(tmp_path / "out")


def test_towers_that_change_sides_are_said(made, tmp_path):
    a, b = made("a", range(3)), made("b", range(128, 136))
    edited = merge([a, b], tmp_path / "out", "all", "1.0.0")
    then, now = load_manifest(a).splits, edited.manifest.splits
    moved = [tower for side in SPLITS for tower in set(then.towers(side)) - set(now.towers(side))]
    assert moved
    assert sorted(edited.moved) == sorted(moved)
    for tower, (before, after) in edited.moved.items():
        assert tower in then.towers(before)
        assert tower in now.towers(after)


def refusal(folders, tmp_path, name: str = "all", version: str = "2.0.0") -> str:
    """The message of a merge that is refused; nothing is left of it."""
    before = set(tmp_path.iterdir())
    with pytest.raises(JengaError) as caught:
        merge(folders, tmp_path / "out", name, version)
    assert set(tmp_path.iterdir()) == before
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_contradictory_episodes_are_refused(made, episode_of, write, tmp_path):
    a = made("a", ONE)
    write(episode_of("selection", 2, Outcome.COLLAPSED if 2 % 3 != 2 else Outcome.STUCK), tmp_path / "b-logs")
    b = made("b", TWO)
    message = refusal([a, b], tmp_path)
    assert "episode selection-0002 differs in log_sha256 between a@1.0.0 and b@1.0.0" in message


def test_an_episode_that_is_broken_in_one_parent_is_refused(made, tmp_path):
    a, b = made("a", ONE), made("b", [*TWO, 3], invalid=[3])
    assert "number 3 of seed 7 is an episode of a@1.0.0 and one with broken physics" in refusal([a, b], tmp_path)


def test_kinds_are_not_mixed(made, tmp_path):
    message = refusal([made("a", ONE), made("b", ONE, "extraction")], tmp_path)
    assert "a@1.0.0: selection of 6 blocks; b@1.0.0: dynamics of 6 blocks" in message


def test_a_licence_that_all_allow_is_asked_for(made, tmp_path):
    a, b = made("a", ONE, licence="CC0-1.0"), made("b", TWO)
    assert "a@1.0.0: CC0-1.0; b@1.0.0: CC-BY-4.0" in refusal([a, b], tmp_path)
    assert merge([a, b], tmp_path / "out", "all", "1.0.0", licence="CC-BY-4.0").manifest.licence == "CC-BY-4.0"


def test_labels_of_other_thresholds_are_not_mixed(made, tmp_path):
    a, b = made("a", ONE), made("b", TWO)
    manifest = load_manifest(b)
    labels = [msgspec.structs.replace(la, thresholds=dict.fromkeys(la.thresholds, 0.5)) for la in manifest.labels]
    (b / MANIFEST).write_bytes(canonical_bytes(sealed(msgspec.structs.replace(manifest, labels=labels))))
    assert "label 'collapsed' has the thresholds {'drop': 0.0075} in a@1.0.0 and {'drop': 0.5}" in refusal(
        [a, b], tmp_path
    )


@pytest.mark.parametrize("overlap", [False, True])
def test_a_damaged_parent_is_refused(made, tmp_path, overlap):
    a, b = made("a", range(6)), made("b", range(3, 8) if overlap else TWO)
    (path,) = (b / "data").iterdir()
    data = bytearray(path.read_bytes())
    data[200] ^= 1
    path.write_bytes(data)
    with pytest.raises(CheckFailed, match="is not what its manifest says"):
        merge([a, b], tmp_path / "out", "all", "1.0.0")
    assert not (tmp_path / "out").exists()


def test_one_dataset_is_no_merge_and_its_own_version_is_taken(made, tmp_path):
    a, b = made("a", ONE), made("b", TWO)
    shutil.copytree(a, tmp_path / "copy")
    assert "1 different datasets were given" in refusal([a, tmp_path / "copy"], tmp_path)
    assert "version 1.0.0 is not above 1.0.0 of its parent a" in refusal([a, b], tmp_path, "a", "1.0.0")


def test_absurd_recipes_are_refused(made, tmp_path):
    a, b = made("a", ONE), made("b", TWO)
    manifest = load_manifest(b)
    recipes = [msgspec.structs.replace(manifest.provenance.recipes[0], numbers=[(0, 10**15)])]
    forged = msgspec.structs.replace(manifest, provenance=msgspec.structs.replace(manifest.provenance, recipes=recipes))
    (b / MANIFEST).write_bytes(canonical_bytes(sealed(forged)))
    assert "recipes of 1000000000000001 episodes" in refusal([a, b], tmp_path)


def test_a_link_is_never_written_through(made, tmp_path):
    """A parent that names a file after episodes which another file of the merge will be named after."""
    a, b = made("a", range(8)), made("b", range(4, 11))
    left = made("left", range(8, 11))  # what remains of b beside a
    name = next((left / "data").iterdir()).name
    manifest = load_manifest(a)
    (old,) = manifest.data_files
    (a / old.path).rename(a / "data" / name)
    files = [msgspec.structs.replace(f, path=f"data/{name}") if f == old else f for f in manifest.files]
    (a / MANIFEST).write_bytes(canonical_bytes(sealed(msgspec.structs.replace(manifest, files=files))))
    before = (a / "data" / name).read_bytes()
    assert f"misuses the name data/{name}" in refusal([a, b], tmp_path)
    assert (a / "data" / name).read_bytes() == before
