"""Datasets that were spoiled in every way: refused in one line, in bounded time. $JENGA_FUZZ_INPUTS sets how many.

A dataset whose manifest was not forged along never gets as far as Arrow: its hashes are compared first. One whose
manifest was forged does, in a process of its own, with bounded memory, as nothing guarantees that Arrow survives it.
"""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import forged_datasets
import jaxtyping
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mutations import ABSURD, edits, fuzz, inputs, refused, spoiled

from jenga_data.dataset.manifest import MANIFEST, Manifest, canonical_bytes, load_manifest, sealed
from jenga_data.dataset.read import open_dataset
from jenga_data.dataset.schema import COLUMNS, EPISODES
from jenga_data.dataset.verify import verify


@pytest.fixture(scope="module", autouse=True)
def as_in_production() -> Iterator[None]:
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture(scope="module")
def victim(dynamics: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset to spoil, again and again."""
    folder = tmp_path_factory.mktemp("victim") / "dataset"
    shutil.copytree(dynamics, folder)
    return folder


def read_all(folder: Path) -> tuple[str, bool]:
    """What reading every column says against a dataset, and whether `verify` passes."""

    def read() -> None:
        dataset = open_dataset(folder)
        for column in COLUMNS[dataset.manifest.kind]:
            if not column.ragged:
                dataset.column(column.name)
        dataset.edges()
        for rows in ("all", "train+test"):
            dataset.rows(rows)
        dataset.episodes()

    said = refused(read)
    passed = [False]
    assert not refused(lambda: passed.__setitem__(0, verify(folder).ok))
    return said, passed[0]


@fuzz(0.05)
@given(which=st.integers(0, 1), how=edits())
def test_spoiled_parquet_files_are_refused_by_their_hash(victim, which, how):
    manifest = load_manifest(victim)
    name = EPISODES if which else manifest.data_files[0].path
    whole = (victim / name).read_bytes()
    try:
        (victim / name).write_bytes(bad := spoiled(whole, how))
        said, passed = read_all(victim)
        assert (not said and passed) if bad == whole else ("hash" in said or "is not whole" in said) and not passed
    finally:
        (victim / name).write_bytes(whole)


@fuzz(0.07)
@given(how=edits())
def test_spoiled_manifests(victim, how):
    whole = (victim / MANIFEST).read_bytes()
    try:
        (victim / MANIFEST).write_bytes(bad := spoiled(whole, how))
        said, passed = read_all(victim)
        assert bad == whole or not passed
        assert said or msgspec.json.decode(bad) == msgspec.json.decode(whole)
    finally:
        (victim / MANIFEST).write_bytes(whole)


_ODD = st.one_of(
    st.sampled_from([*ABSURD, -1, 1e300, None, "", "x" * 5000, "../../x", "/etc/passwd", "data/../../x", [], {}]),
    st.text(max_size=8),
)


def paths_in(plain: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where every value of nested JSON stands."""
    yield path
    inner = plain.items() if isinstance(plain, dict) else enumerate(plain) if isinstance(plain, list) else ()
    for key, value in inner:
        yield from paths_in(value, (*path, key))


@fuzz(0.05)
@given(where=st.integers(0, 10**6), odd=_ODD, seal=st.booleans())
def test_forged_manifests(victim, where, odd, seal):
    whole = (victim / MANIFEST).read_bytes()
    plain = json.loads(whole)
    places = [path for path in paths_in(plain) if path]
    *way, last = places[where % len(places)]
    inner = plain
    for key in way:
        inner = inner[key]
    inner[last] = odd
    bad = json.dumps(plain).encode()
    if seal:
        try:
            bad = canonical_bytes(sealed(msgspec.json.decode(bad, type=Manifest)))
        except (msgspec.MsgspecError, OverflowError):
            seal = False
    try:
        (victim / MANIFEST).write_bytes(bad)
        read_all(victim)
    finally:
        (victim / MANIFEST).write_bytes(whole)


@pytest.mark.parametrize("nested", [100, 100_000])
def test_a_deeply_nested_manifest_is_refused(victim, nested):
    whole = (victim / MANIFEST).read_bytes()
    deep = b'{"a":' * nested + b"1" + b"}" * nested
    try:
        (victim / MANIFEST).write_bytes(whole.replace(b'"configs": {', b'"configs": {"x": ' + deep + b",", 1))
        said, passed = read_all(victim)
        assert said
        assert not passed
    finally:
        (victim / MANIFEST).write_bytes(whole)


def test_forged_parquet_files_do_no_harm_beyond_their_process(victim, tmp_path):
    """Right hashes over spoiled bytes: everything is decoded. No traceback, no hang, at most 1.5 GiB."""
    count, start = inputs(0.03), 0
    command = [sys.executable, forged_datasets.__file__, str(victim), str(tmp_path / "forged"), str(count)]
    while start < count:
        done = subprocess.run([*command, str(start)], capture_output=True, text=True, timeout=600, check=False)
        tried = [int(line) for line in done.stdout.split()]
        assert done.returncode <= 0, f"input {tried[-1:]}: {done.stderr[-3000:]}"
        if done.returncode == 0:
            return
        start = tried[-1] + 1  # Arrow crashed: it may, in a process of its own
