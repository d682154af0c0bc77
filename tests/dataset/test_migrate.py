"""`format_1_0` holds two datasets that the code of format 1.0.0 wrote: they stay as they are for ever."""

import shutil
from pathlib import Path

import msgspec
import numpy as np
import pyarrow as pa
import pytest

from jenga_data.dataset import migrate as module
from jenga_data.dataset.convert import convert
from jenga_data.dataset.diff import diff
from jenga_data.dataset.manifest import MANIFEST, canonical_bytes, load_manifest, sealed
from jenga_data.dataset.merge import merge
from jenga_data.dataset.migrate import Step, migrate
from jenga_data.dataset.read import open_dataset
from jenga_data.dataset.schema import FORMAT_VERSION
from jenga_data.errors import CheckFailed, JengaError

OLD = Path(__file__).with_name("format_1_0")


@pytest.fixture
def old(tmp_path: Path) -> Path:
    return Path(shutil.copytree(OLD / "dynamics", tmp_path / "dynamics"))


STEP = {
    "block_pose": 2.0**-23,
    "next_pose": 2.0**-23,
    "block_twist": 2.0**-20,
    "next_twist": 2.0**-20,
    "edge_force": 2.0**-14,
}


def _numbers(column: pa.ChunkedArray) -> np.ndarray:
    flat = column.combine_chunks()
    while not pa.types.is_floating(flat.type):
        flat = flat.flatten()
    return flat.to_numpy().astype(float)


def content(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize("kind", ["selection", "dynamics"])
def test_the_older_format_is_read_as_it_is(kind, whole):
    dataset = open_dataset(OLD / kind)
    assert dataset.manifest.format_version == "1.0.0"
    assert dataset.column("block_mass").shape == (len(dataset), 6)
    assert len(dataset.episodes()["episode"]) == dataset.manifest.counts.episodes
    with pytest.raises(JengaError, match="no column 'block_wedge'"):
        dataset.column("block_wedge")
    assert whole(OLD / kind)


def test_pulls_whose_motion_was_not_kept_have_to_be_converted_again(tmp_path):
    old = Path(shutil.copytree(OLD / "selection", tmp_path / "selection"))
    assert "without `block_moved`, which only their logs can say: convert them again" in refusal(old, tmp_path / "new")


def test_a_lifted_dataset_keeps_every_promise_and_every_row(old, whole, rows_in, tmp_path):
    before = content(old)
    manifest = migrate(old, tmp_path / "new")
    assert (manifest.format_version, manifest.version) == (FORMAT_VERSION, "1.0.1")
    assert [(p.version, p.hash) for p in manifest.parents] == [("1.0.0", load_manifest(old).hash)]
    assert whole(tmp_path / "new")
    found = diff(old, tmp_path / "new")
    assert found.only == ([], [])
    assert {name for columns in found.differ.values() for name in columns} <= STEP.keys()
    before_lift, lifted = rows_in(old), rows_in(tmp_path / "new")
    for name in STEP.keys() & set(lifted.column_names):
        a, b = (_numbers(table[name]) for table in (before_lift, lifted))
        assert np.abs(a - b).max() <= STEP[name] / 2
        np.testing.assert_array_equal(b % STEP[name], 0)
    assert not open_dataset(tmp_path / "new").column("block_wedge").any()
    assert content(old) == before
    assert {p.name for p in (tmp_path / "new").iterdir()} == {"data", "episodes.parquet", MANIFEST}


def test_lifting_is_converting_the_logs_again(old, episode_of, write, rows_in, tmp_path):
    """The logs of the old datasets can still be made. What was rounded to 32 bit before may be a step away."""
    from jenga_data.outcome import Outcome

    for number in range(5):
        broken = Outcome.INVALID if number == 4 else None
        write(episode_of("extraction", number, broken, tower=number % 4), tmp_path / "logs")
    lifted = migrate(old, tmp_path / "new")
    fresh = convert([tmp_path / "logs"], tmp_path / "fresh", lifted.name, "1.0.0")
    assert [(f.path, f.rows) for f in lifted.data_files] == [(f.path, f.rows) for f in fresh.data_files]
    ours, theirs = rows_in(tmp_path / "new"), rows_in(tmp_path / "fresh")
    assert ours.drop_columns(list(STEP.keys() & set(ours.column_names))).equals(
        theirs.drop_columns(list(STEP.keys() & set(theirs.column_names)))
    )
    for name in STEP.keys() & set(ours.column_names):
        assert np.abs(_numbers(ours[name]) - _numbers(theirs[name])).max() <= STEP[name]


def test_edits_ask_for_the_lift_and_work_after_it(made, whole, tmp_path):
    other = made("other", range(128, 132), kind="extraction")
    with pytest.raises(JengaError, match=rf"jenga dataset migrate {OLD / 'dynamics'} --out NEW"):
        merge([OLD / "dynamics", other], tmp_path / "out", "all", "1.0.0")
    migrate(OLD / "dynamics", tmp_path / "new")
    merge([tmp_path / "new", other], tmp_path / "out", "all", "1.0.0")
    assert whole(tmp_path / "out")


def test_wedges_that_were_not_kept_are_not_invented(old, tmp_path):
    manifest = load_manifest(old)
    (key,) = manifest.provenance.configs
    provenance = msgspec.structs.replace(manifest.provenance, configs={key: {"spawn": {"wedge": True}}})
    (old / MANIFEST).write_bytes(canonical_bytes(sealed(msgspec.structs.replace(manifest, provenance=provenance))))
    assert f"wedge-shaped blocks (config {key})" in refusal(old, tmp_path / "new")


def refusal(old: Path, out: Path, error: type[JengaError] = JengaError, **options: str) -> str:
    with pytest.raises(error) as caught:
        migrate(old, out, **options)
    assert not out.exists()
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_what_needs_no_lift_or_has_none_is_refused(selection, old, tmp_path):
    assert "the present one: nothing to migrate" in refusal(selection, tmp_path / "new")
    assert "version 1.0.0 is not above 1.0.0" in refusal(old, tmp_path / "new", version="1.0.0")
    assert "bad version '2'" in refusal(old, tmp_path / "new", version="2")
    for version, way_out in (("0.9.0", "jenga convert"), ("7.0.0", "update jenga")):
        rewrite(old, format_version=version)
        message = refusal(old, tmp_path / "new")
        assert f"has format version {version}; migrate knows the way from 1.0, 1.1: " in message
        assert way_out in message


def rewrite(folder: Path, **fields: object) -> None:
    """Change a manifest of whatever format, and seal it in the way of all formats."""
    import hashlib

    plain = msgspec.json.decode((folder / MANIFEST).read_bytes()) | fields | {"hash": ""}
    data = msgspec.json.format(msgspec.json.encode(plain), indent=2) + b"\n"
    plain["hash"] = hashlib.sha256(data).hexdigest()
    (folder / MANIFEST).write_bytes(msgspec.json.format(msgspec.json.encode(plain), indent=2) + b"\n")


def test_an_older_major_format_is_lifted_over_all_steps(old, whole, tmp_path, monkeypatch):
    """A reader refuses it and names the command, which knows more formats than the reader."""
    rewrite(old, format_version="0.3.0", licence_name="CC0-1.0", **{"licence": None})
    with pytest.raises(JengaError, match=rf"format version 0\.3\.0.*jenga dataset migrate {old} --out NEW"):
        open_dataset(old)

    def name_the_licence(folder: Path, plain: dict, new: Path) -> dict:
        shutil.copytree(folder, new, dirs_exist_ok=True)
        return {k: v for k, v in plain.items() if k != "licence_name"} | {"licence": plain["licence_name"]}

    monkeypatch.setitem(module.STEPS, (0, 3), Step("1.0.0", name_the_licence))
    manifest = migrate(old, tmp_path / "new")
    assert (manifest.licence, manifest.format_version) == ("CC0-1.0", FORMAT_VERSION)
    assert whole(tmp_path / "new")


def test_damage_is_not_carried_over(old, tmp_path):
    path = old / load_manifest(old).data_files[0].path
    data = bytearray(path.read_bytes())
    data[200] ^= 1
    path.write_bytes(data)
    assert "is not what its manifest says" in refusal(old, tmp_path / "new", CheckFailed)
    manifest = (old / MANIFEST).read_bytes()
    (old / MANIFEST).write_bytes(manifest.replace(b"CC-BY-4.0", b"CC-BY-9.0"))
    assert "does not match its own hash" in refusal(old, tmp_path / "new", CheckFailed)


@pytest.mark.parametrize("data", [b"", b"{}", b"[]", b"\xff", b'{"format_version": "1.0.0"}', b"[" * 100_000])
def test_what_is_no_manifest_is_refused(tmp_path, data):
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / MANIFEST).write_bytes(data)
    assert "no valid manifest" in refusal(tmp_path / "old", tmp_path / "new")


def test_paths_that_lead_elsewhere_are_refused(old, tmp_path):
    files = msgspec.to_builtins(load_manifest(old).files)
    rewrite(old, files=[*files, files[0] | {"path": "../x"}])
    assert "allowed: plain paths inside" in refusal(old, tmp_path / "new")


def test_new_datasets_keep_their_wedges(episode_of, write, whole, tmp_path):
    from dataclasses import replace

    from jenga_data.blocks import sample_blocks

    wedges = {}
    for number in range(3):
        blocks = sample_blocks("measured", np.random.default_rng(number), 6, wedge=True)
        wedges[blocks.tower] = blocks.wedge
        episode = episode_of("selection", number)
        write(replace(episode, header=replace(episode.header, blocks=blocks)), tmp_path / "logs")
    convert([tmp_path / "logs"], tmp_path / "new", "wedges", "1.0.0")
    dataset = open_dataset(tmp_path / "new")
    for tower, wedge in zip(dataset.column("tower"), dataset.column("block_wedge"), strict=True):
        np.testing.assert_array_equal(wedge, wedges[str(tower)].astype(np.float32))
    assert whole(tmp_path / "new")
