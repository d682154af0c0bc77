"""Files of a parent in a new version: taken over byte for byte, or written again without some episodes."""

import os
import shutil
from collections.abc import Collection
from pathlib import Path

import numpy as np

from jenga_data.dataset.episode_batches import episode_batches
from jenga_data.dataset.manifest import DATA, File
from jenga_data.dataset.parents import Opened
from jenga_data.dataset.schema import COLUMNS, arrow_schema
from jenga_data.dataset.shards import shard_path
from jenga_data.dataset.staging import file_entry
from jenga_data.dataset.tables import table_writer
from jenga_data.dataset.write import Part, refuse_name, training_statistics
from jenga_data.errors import CheckFailed


def take_episodes(parent: Opened, keep: Collection[str], folder: Path, train: frozenset[str]) -> tuple[list[Part], int]:
    """The rows of the episodes `keep` of a parent, in `folder`, and how many files were taken over as they are."""
    (folder / DATA).mkdir(parents=True, exist_ok=True)
    keep, parts, taken = frozenset(keep), [], 0
    for file in parent.files:
        keys = parent.keys[file.path]
        if keep.issuperset(keys):
            parts.append(take_over(parent, file, folder, train))
            taken += 1
        elif not keep.isdisjoint(keys):
            parts.append(write_again(parent, file, keep, folder, train))
    return parts, taken


def take_over(parent: Opened, file: File, folder: Path, train: frozenset[str]) -> Part:
    """The same file in `folder`: a hard link where the system makes one, else a copy.

    Raises:
        CheckFailed: it is not what the parent's manifest says.
    """
    source, target = parent.dataset.folder / file.path, folder / file.path
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source, target)
    except OSError:  # another file system, or one without links
        shutil.copyfile(source, target)
    _check(parent, file, folder)
    return Part(file, training_statistics(target, COLUMNS[parent.manifest.kind], train))


def write_again(parent: Opened, file: File, keep: Collection[str], folder: Path, train: frozenset[str]) -> Part:
    """A new file with the episodes `keep` of a parent's file, as their logs alone would have made it.

    Raises:
        JengaError: another file has the name that follows from these episodes.
        CheckFailed: the parent's file is not what its manifest says.
    """
    _check(parent, file, parent.dataset.folder)
    columns, keys = COLUMNS[parent.manifest.kind], [key for key in parent.keys[file.path] if key in keep]
    at = int(np.flatnonzero(parent.episodes["episode"] == keys[0])[0])
    path = shard_path(int(parent.episodes["seed"][at]), int(parent.episodes["number"][at]), keys)
    schema = arrow_schema(columns, parent.manifest.blocks)
    (folder / DATA).mkdir(exist_ok=True)
    refuse_name(folder, path)
    with table_writer(folder / path, columns, schema) as table, parent.dataset.open_file(file) as source:
        for key, batch in episode_batches(source):
            if key in keep:
                table.write(batch.cast(schema))
    return Part(file_entry(folder, path, table.rows), training_statistics(folder / path, columns, train))


def _check(parent: Opened, file: File, folder: Path) -> None:
    if file_entry(folder, file.path, file.rows) != file:
        where = parent.dataset.folder
        raise CheckFailed(f"{where / file.path} is not what its manifest says: run `jenga dataset verify {where}`")
