"""The manifest: what a dataset says of itself, as strictly typed JSON beside its files."""

import hashlib
import re
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

import msgspec

from jenga_data.dataset.schema import DATASET_KIND, EPISODES, FORMAT_VERSION, format_of
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.limits import MAX_BLOCKS, MAX_COUNT, MAX_MANIFEST_BYTES

MANIFEST = "manifest.json"
DATA = "data/"
"""Folder of the files that hold rows."""

SPLITS = ("train", "validation", "test")

_NAME = r"^[a-z0-9][a-z0-9._-]{0,63}$"
_VERSION = r"^(0|[1-9][0-9]{0,8})\.(0|[1-9][0-9]{0,8})\.(0|[1-9][0-9]{0,8})$"
Name = Annotated[str, msgspec.Meta(pattern=_NAME)]
Version = Annotated[str, msgspec.Meta(pattern=_VERSION, max_length=32)]
Sha256 = Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}$")]
Count = Annotated[int, msgspec.Meta(ge=0, le=MAX_COUNT)]


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Unknown fields are refused: a reader that dropped them would compute another hash."""


class Feature(_Strict, frozen=True):
    """One column of `data/`. `shape` is that of a row, null where it differs from row to row."""

    name: str
    dtype: str
    shape: list[int | None]
    unit: str
    frame: str
    description: str


class File(_Strict, frozen=True):
    """One file of the dataset; `path` is relative to the manifest, with forward slashes."""

    path: str
    bytes: Count
    rows: Count
    sha256: Sha256


class Splits(_Strict, frozen=True):
    """Ids of the towers on each side, and the rule that put them there."""

    rule: str
    train: list[str]
    validation: list[str]
    test: list[str]

    def towers(self, split: str) -> list[str]:
        return {"train": self.train, "validation": self.validation, "test": self.test}[split]


class Statistic(_Strict, frozen=True):
    """Moments of one column, component by component along its last axis; `count` values went into each."""

    count: Count
    mean: list[float]
    std: list[float]
    min: list[float]
    max: list[float]


class Label(_Strict, frozen=True):
    """What a label means, and the thresholds that decide it (SI)."""

    name: str
    definition: str
    thresholds: dict[str, float]


class Counts(_Strict, frozen=True):
    """How much of what. `invalid` episodes were simulated and are in no file."""

    rows: Count
    episodes: Count
    towers: Count
    invalid: Count
    dragged: Count
    outcome: dict[str, int]
    round: dict[str, int]
    cause: dict[str, int]


class Recipe(_Strict, frozen=True):
    """Episodes that were made alike. `numbers` lists first and last number of every unbroken range."""

    config: str
    seed: int
    checkpoint: str
    numbers: list[tuple[int, int]]


class Provenance(_Strict, frozen=True):
    """Where the rows come from: recipes (invalid episodes included), configs by hash, and what wrote the logs."""

    recipes: list[Recipe]
    configs: dict[str, dict[str, Any]]
    commits: list[str]
    versions: dict[str, list[str]]
    converter: dict[str, str]


class Parent(_Strict, frozen=True):
    """A dataset that this one was made from."""

    name: Name
    version: Version
    hash: Sha256


class Manifest(_Strict, frozen=True):
    """Everything that is known of one version of a dataset. A dataset never changes: an edit is a new version."""

    name: Name
    version: Version
    format_version: Version
    kind: str
    description: str
    blocks: Annotated[int, msgspec.Meta(ge=1, le=MAX_BLOCKS)]
    features: list[Feature]
    files: list[File]
    splits: Splits
    statistics: dict[str, Statistic]
    """Of the training rows alone, so that nothing of the test towers leaks into what is normalised with them."""
    labels: list[Label]
    counts: Counts
    provenance: Provenance
    parents: list[Parent]
    licence: str
    citation: list[str]
    sources: list[str]
    """Where to get it: addresses, best first."""
    hash: Sha256 | Literal[""] = ""
    """`manifest_hash` of the rest, so that damage to the manifest itself shows."""

    @property
    def identifier(self) -> str:
        return f"{self.name}@{self.version}"

    @property
    def data_files(self) -> list[File]:
        """The files that hold rows, in the order of the rows."""
        return [f for f in self.files if f.path.startswith(DATA)]


def check_identity(name: str, version: str) -> None:
    """Refuse a name or version that no manifest may have.

    Raises:
        JengaError: it is none.
    """
    if not re.fullmatch(_NAME, name):
        raise JengaError(f"bad dataset name {name!r}: use up to 64 of a-z 0-9 . _ -, e.g. my-selection")
    if not re.fullmatch(_VERSION, version):
        raise JengaError(f"bad version {version!r}: use X.Y.Z, e.g. 1.0.0")


def canonical_bytes(manifest: Manifest) -> bytes:
    """The one way to write a manifest: fields in the order of the struct, keys of mappings sorted."""
    return msgspec.json.format(msgspec.json.encode(manifest, order="deterministic"), indent=2) + b"\n"


def manifest_hash(manifest: Manifest) -> str:
    """SHA-256 of the canonical bytes without `hash`. As it covers every file's hash, it names the whole dataset."""
    return hashlib.sha256(canonical_bytes(msgspec.structs.replace(manifest, hash=""))).hexdigest()


def sealed(manifest: Manifest) -> Manifest:
    """The manifest with its hash in it, as it is written to disk."""
    return msgspec.structs.replace(manifest, hash=manifest_hash(manifest))


def read_manifest_bytes(path: Path) -> bytes:
    """What stands in a `manifest.json`, of whatever format.

    Raises:
        JengaError: it is missing, or absurdly large.
    """
    try:
        if path.exists() and not path.is_file():  # a pipe would be waited for
            raise JengaError(f"{path} is no regular file; a dataset is a folder with a {MANIFEST}")
        if path.stat().st_size > MAX_MANIFEST_BYTES:
            raise JengaError(f"{path} has {path.stat().st_size} bytes; a manifest has at most {MAX_MANIFEST_BYTES}")
        return path.read_bytes()
    except OSError as error:
        raise JengaError(f"cannot read {path}: {error.strerror}; a dataset is a folder with a {MANIFEST}") from error


class _Format(msgspec.Struct):
    format_version: Version


def load_manifest(path: Path) -> Manifest:
    """Read and check `manifest.json` (or the one in the folder `path`), without touching the files it lists.

    Raises:
        JengaError: it is missing, no JSON, of another format, lacks a field, or lists a path outside its folder.
        CheckFailed: it was changed after it was sealed.
    """
    path = path / MANIFEST if path.is_dir() else path
    raw = read_manifest_bytes(path)
    try:
        _check_format(path, msgspec.json.decode(raw, type=_Format).format_version)
        manifest = msgspec.json.decode(raw, type=Manifest)
        own_hash = manifest_hash(manifest)
    except (msgspec.MsgspecError, UnicodeError, RecursionError, OverflowError) as error:
        raise JengaError(f"{path} is no valid manifest: {error}") from error
    if manifest.kind not in DATASET_KIND.values():
        raise JengaError(f"{path} is of kind {manifest.kind!r}; allowed: {', '.join(DATASET_KIND.values())}")
    if manifest.hash != own_hash:
        raise CheckFailed(f"{path} does not match its own hash: it was edited or damaged; get the dataset again")
    check_paths(path, manifest.files)
    return manifest


def _check_format(path: Path, found: str) -> None:
    major, minor = format_of(found)
    own_major, own_minor = format_of(FORMAT_VERSION)
    if major != own_major or minor > own_minor:
        newer = (major, minor) > (own_major, own_minor)
        way_out = "update jenga" if newer else f"lift it with `jenga dataset migrate {path.parent} --out NEW`"
        allowed = f"{own_major}.0 to {own_major}.{own_minor}"
        raise JengaError(f"{path} has format version {found}; this jenga reads {allowed}: {way_out}")


def check_paths(path: Path, files: list[File]) -> None:
    """A manifest from elsewhere must not make a reader look outside its folder.

    Raises:
        JengaError: the manifest at `path` lists what would, lists a file twice, or not those that a dataset needs.
    """
    seen = set()
    for file in files:
        parts = PurePosixPath(file.path).parts
        plain = file.path == "/".join(parts) and not file.path.startswith("/") and file.path.isprintable()
        if not plain or not parts or ".." in parts or any(c in file.path for c in "\\:"):
            raise JengaError(f"{path} lists {file.path!r}; allowed: plain paths inside the dataset's folder")
        for depth in range(1, len(parts) + 1):
            if path.parent.joinpath(*parts[:depth]).is_symlink():
                raise JengaError(f"{path} lists {file.path!r}, which is a symbolic link: copy the file itself there")
        if file.path in seen:
            raise JengaError(f"{path} lists {file.path!r} twice")
        seen.add(file.path)
    if EPISODES not in seen or not any(name.startswith(DATA) for name in seen):
        raise JengaError(f"{path} lists no {EPISODES} or nothing in {DATA}; a dataset has both")
