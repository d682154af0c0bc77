"""A dataset of an older format becomes one of the present format, step by step, without its logs."""

import hashlib
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from jenga_data.dataset.locate import locate
from jenga_data.dataset.manifest import (
    MANIFEST,
    File,
    Manifest,
    Name,
    Parent,
    Sha256,
    Version,
    canonical_bytes,
    check_identity,
    check_paths,
    read_manifest_bytes,
    sealed,
)
from jenga_data.dataset.migrate_1_0 import add_wedge
from jenga_data.dataset.migrate_1_1 import only_transitions
from jenga_data.dataset.schema import FORMAT_VERSION, format_of
from jenga_data.dataset.staging import file_entry, new_folder, refuse_existing
from jenga_data.errors import CheckFailed, JengaError

Plain = dict[str, Any]
"""A manifest as plain JSON: of an older format none of this code's types need fit."""


@dataclass(frozen=True)
class Step:
    """From one format to the next. `lift(old, manifest, new)` writes the files of the dataset in the folder `old` into
    the empty folder `new`, and returns the manifest that they have then, but for its hash."""

    to: str
    lift: Callable[[Path, Plain, Path], Plain]


STEPS: dict[tuple[int, int], Step] = {(1, 0): Step("1.1.0", add_wedge), (1, 1): Step("1.2.0", only_transitions)}
"""By the format (major, minor) that a step starts from. A new format adds one here and changes none."""


def migrate(where: str | Path, out: Path, version: str | None = None) -> Manifest:
    """Lift a dataset to the present format in the new folder `out`, and make it the parent of what is there then.

    Args:
        where: its folder, or NAME@X.Y.Z where this code can still read it.
        version: of the new dataset; by default the next patch version.

    Raises:
        JengaError: it has the present format or one that no step starts from, or `out` exists or cannot be written.
        CheckFailed: it is damaged.
    """
    refuse_existing(out)
    folder = locate(where)
    plain, parent = _read(folder)
    steps = list(_way(folder, plain["format_version"]))
    version = version or _next_patch(parent.version)
    check_identity(parent.name, version)
    if tuple(map(int, version.split("."))) <= tuple(map(int, parent.version.split("."))):
        raise JengaError(f"version {version} is not above {parent.version}; choose a higher --version")
    with new_folder(out) as new:
        stage = folder
        for number, step in enumerate(steps):
            last, stage = stage, new / f"step-{number}"
            stage.mkdir()
            plain = step.lift(last, plain, stage) | {"format_version": step.to}
        for path in stage.iterdir():
            path.rename(new / path.name)
        for number in range(len(steps)):
            shutil.rmtree(new / f"step-{number}")
        del plain["hash"]
        lifted = plain | {"version": version, "parents": [msgspec.to_builtins(parent)], "sources": []}
        manifest = sealed(msgspec.convert(lifted, Manifest))
        (new / MANIFEST).write_bytes(canonical_bytes(manifest))
    return manifest


def _read(folder: Path) -> tuple[Plain, Parent]:
    """The manifest, after every file and the manifest itself have been found to be what they say."""
    path = folder / MANIFEST
    raw = read_manifest_bytes(path)
    try:
        plain = msgspec.json.decode(raw, type=dict[str, Any])
        said = msgspec.convert(plain, _Said)
        files = msgspec.convert(plain["files"], list[File])
    except (msgspec.DecodeError, msgspec.ValidationError, UnicodeDecodeError, RecursionError) as error:
        raise JengaError(f"{path} is no valid manifest: {error}") from error
    own = msgspec.json.format(msgspec.json.encode(plain | {"hash": ""}), indent=2) + b"\n"
    if hashlib.sha256(own).hexdigest() != said.hash:
        raise CheckFailed(f"{path} does not match its own hash: it was edited or damaged; get the dataset again")
    check_paths(path, files)
    for file in files:
        if not (folder / file.path).is_file() or file_entry(folder, file.path, file.rows) != file:
            raise CheckFailed(f"{folder / file.path} is not what its manifest says: get the dataset again")
    return plain, Parent(said.name, said.version, said.hash)


class _Said(msgspec.Struct):
    """What a manifest of every format has."""

    name: Name
    version: Version
    format_version: Version
    hash: Sha256
    files: list[Any]


def _way(folder: Path, found: str) -> Iterator[Step]:
    """The steps from a format to the present one."""
    if format_of(found) == format_of(FORMAT_VERSION):
        raise JengaError(f"{folder} has format version {found}, the present one: nothing to migrate")
    at = format_of(found)
    while at != format_of(FORMAT_VERSION):
        if at not in STEPS:
            known = ", ".join(f"{major}.{minor}" for major, minor in sorted(STEPS))
            way_out = "update jenga" if at > format_of(FORMAT_VERSION) else "convert its logs with `jenga convert`"
            raise JengaError(f"{folder} has format version {found}; migrate knows the way from {known}: {way_out}")
        yield STEPS[at]
        at = format_of(STEPS[at].to)


def _next_patch(version: str) -> str:
    major, minor, patch = map(int, version.split("."))
    return f"{major}.{minor}.{patch + 1}"
