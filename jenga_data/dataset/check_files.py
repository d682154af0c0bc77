"""Checks on the manifest and the files as wholes. Each yields one line for every thing that is wrong."""

import hashlib
from collections.abc import Iterator
from pathlib import Path

from jenga_data.dataset import describe
from jenga_data.dataset.manifest import DATA, MANIFEST, Manifest, canonical_bytes
from jenga_data.dataset.schema import EPISODE_COLUMNS, EPISODES, FORMAT_VERSION, arrow_schema, columns_of, format_of
from jenga_data.dataset.tables import open_parquet


def check_manifest(folder: Path, manifest: Manifest) -> Iterator[str]:
    """It is written in the one way, and describes the columns of its kind."""
    if (folder / MANIFEST).read_bytes() != canonical_bytes(manifest):
        yield f"{MANIFEST} is not in canonical form: its bytes were changed"
    found, expected = manifest.features, describe.features(manifest.kind, manifest.blocks, manifest.format_version)
    if not _present(manifest):  # an older format had its own words for the same columns
        found, expected = ([(f.name, f.dtype, f.shape) for f in features] for features in (found, expected))
    if found != expected:
        yield f"{MANIFEST} describes other features than a {manifest.kind} dataset has"


def check_hashes(folder: Path, manifest: Manifest) -> Iterator[str]:
    """Every file is there with its size and hash, and `data/` holds nothing else."""
    for entry in manifest.files:
        path = folder / entry.path
        if not path.is_file():
            yield f"{entry.path} is missing"
        elif (size := path.stat().st_size) != entry.bytes:
            yield f"{entry.path} has {size} bytes, not {entry.bytes}"
        else:
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
            if digest != entry.sha256:
                yield f"{entry.path} has SHA-256 {digest[:12]}..., not {entry.sha256[:12]}..."
    listed = {f.path for f in manifest.files}
    for path in sorted((folder / DATA).rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_file() and name not in listed:
            yield f"{name} is not in the manifest"


def check_schema(folder: Path, manifest: Manifest) -> Iterator[str]:
    """Every file has exactly the columns, with the descriptions, and the number of rows that it should."""
    for entry in manifest.files:
        columns = EPISODE_COLUMNS if entry.path == EPISODES else columns_of(manifest.kind, manifest.format_version)
        expected = arrow_schema(columns, manifest.blocks, manifest.format_version)
        with open_parquet(folder / entry.path) as file:
            if not file.schema_arrow.equals(expected, check_metadata=_present(manifest)):
                found = {f.name: f for f in file.schema_arrow}
                odd = [
                    f.name
                    for f in expected
                    if f.name not in found or not f.equals(found[f.name], check_metadata=_present(manifest))
                ]
                odd += sorted(found.keys() - set(expected.names))
                yield f"{entry.path} has other columns than it should: {', '.join(odd) or 'their order or metadata'}"
            if file.metadata.num_rows != entry.rows:
                yield f"{entry.path} has {file.metadata.num_rows} rows, the manifest says {entry.rows}"


def _present(manifest: Manifest) -> bool:
    return format_of(manifest.format_version) == format_of(FORMAT_VERSION)
