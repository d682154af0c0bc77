import os
from typing import Any

import msgspec
import pytest

from jenga_data.dataset.manifest import MANIFEST, canonical_bytes, load_manifest, manifest_hash, sealed
from jenga_data.dataset.schema import FORMAT_VERSION
from jenga_data.errors import CheckFailed, JengaError


@pytest.fixture
def raw(selection) -> dict[str, Any]:
    """The manifest as plain JSON, to be bent."""
    return msgspec.json.decode((selection / MANIFEST).read_bytes())


def refusal(tmp_path, content: bytes) -> str:
    (tmp_path / MANIFEST).write_bytes(content)
    with pytest.raises(JengaError) as caught:
        load_manifest(tmp_path)
    assert MANIFEST in str(caught.value)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_writing_and_reading_is_the_identity(dataset_folder):
    manifest = load_manifest(dataset_folder)
    assert canonical_bytes(manifest) == (dataset_folder / MANIFEST).read_bytes()
    assert sealed(manifest) == manifest


def test_the_hash_covers_every_field(selection):
    manifest = load_manifest(selection)
    for field in msgspec.structs.fields(manifest):
        if field.name != "hash":
            other = msgspec.structs.replace(manifest, **{field.name: ["another"]})
            assert manifest_hash(other) != manifest.hash, field.name


def test_it_says_what_the_labels_mean_and_how_to_cite(dynamics):
    manifest = load_manifest(dynamics)
    assert {label.name: label.thresholds for label in manifest.labels}["collapsed"] == {"drop": 0.0075}
    assert any("2505.09377" in line for line in manifest.citation)
    assert manifest.licence


def test_no_manifest_is_refused(tmp_path):
    with pytest.raises(JengaError, match=r"cannot read .*manifest.json"):
        load_manifest(tmp_path / MANIFEST)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"null", b"\xff\xfe", b"[" * 100_000, b'{"format_version": 1}'])
def test_what_is_no_manifest_is_refused(tmp_path, content):
    assert "no valid manifest" in refusal(tmp_path, content)


@pytest.mark.parametrize("version", ["2.0.0", "0.9.0", "1.3.0", "10.0.0"])
def test_another_format_is_refused_with_the_way_out(tmp_path, raw, version):
    message = refusal(tmp_path, msgspec.json.encode(raw | {"format_version": version}))
    assert version in message
    assert ("jenga dataset migrate" if version == "0.9.0" else "update jenga") in message
    assert FORMAT_VERSION == "1.2.0"


@pytest.mark.parametrize("field", ["name", "kind", "files", "splits", "counts", "provenance", "licence", "citation"])
def test_a_missing_field_is_named(tmp_path, raw, field):
    del raw[field]
    assert f"`{field}`" in refusal(tmp_path, msgspec.json.encode(raw))


def test_an_unknown_field_is_named(tmp_path, raw):
    assert "`extra`" in refusal(tmp_path, msgspec.json.encode(raw | {"extra": 1}))


@pytest.mark.parametrize(("field", "value"), [("name", "A B"), ("version", "1"), ("blocks", 0), ("blocks", 10**9)])
def test_values_out_of_range_are_named(tmp_path, raw, field, value):
    assert f"$.{field}" in refusal(tmp_path, msgspec.json.encode(raw | {field: value}))


def test_an_edited_manifest_is_refused(tmp_path, raw):
    (tmp_path / MANIFEST).write_bytes(msgspec.json.encode(raw | {"licence": "mine"}))
    with pytest.raises(CheckFailed, match="does not match its own hash"):
        load_manifest(tmp_path)


def with_path(manifest, path: str) -> bytes:
    """A manifest that is sealed properly and lists `path`."""
    file = msgspec.structs.replace(manifest.files[0], path=path)
    return canonical_bytes(sealed(msgspec.structs.replace(manifest, files=[*manifest.files, file])))


@pytest.mark.parametrize(
    "path",
    [
        "../x",
        "data/../../x",
        "/etc/passwd",
        "data//x",
        "./x",
        "data/./x",
        "",
        ".",
        "C:x",
        "a\\b",
        "x\n",
        "x\0",
        "data/",
    ],
)
def test_paths_that_leave_the_folder_are_refused(tmp_path, selection, path):
    message = refusal(tmp_path, with_path(load_manifest(selection), path))
    assert "allowed: plain paths inside" in message


@pytest.mark.parametrize("link", ["data", "data/x.parquet"])
def test_symbolic_links_are_refused(tmp_path, selection, link):
    folder = tmp_path / "set"
    folder.mkdir()
    (tmp_path / "outside").mkdir()
    if "/" in link:
        (folder / "data").mkdir()
    (folder / link).symlink_to(tmp_path / "outside")
    assert "symbolic link" in refusal(folder, with_path(load_manifest(selection), "data/x.parquet"))


def test_a_file_is_listed_once_and_the_needed_ones_are(tmp_path, selection):
    manifest = load_manifest(selection)
    assert "twice" in refusal(tmp_path, with_path(manifest, manifest.files[0].path))
    without = msgspec.structs.replace(manifest, files=[f for f in manifest.files if f.path.startswith("data/")])
    assert "lists no episodes.parquet" in refusal(tmp_path, canonical_bytes(sealed(without)))


# --- from elsewhere ------------------------------------------------------------------------------------------------


def test_a_format_version_of_thousands_of_digits_is_refused(tmp_path):
    """Python reads no number of more than 4,300 digits."""
    (tmp_path / MANIFEST).write_text('{"format_version": "1.' + "9" * 5000 + '.0"}')
    with pytest.raises(JengaError, match="is no valid manifest"):
        load_manifest(tmp_path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_manifest_that_is_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / MANIFEST)
    with pytest.raises(JengaError, match="is no regular file"):
        load_manifest(tmp_path)
