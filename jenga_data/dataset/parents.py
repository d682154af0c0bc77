"""Datasets that a new version is made from: opened, held against each other, and what the new one inherits."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jenga_data.dataset.assemble import Draft
from jenga_data.dataset.episode_table import Table
from jenga_data.dataset.manifest import SPLITS, File, Label, Manifest, Parent, Provenance, Splits, check_identity
from jenga_data.dataset.read import Dataset, open_dataset
from jenga_data.dataset.schema import FORMAT_VERSION, format_of
from jenga_data.dataset.tables import numpy_column
from jenga_data.errors import CheckFailed, JengaError


@dataclass(frozen=True, eq=False)
class Opened:
    """A parent with its table of episodes, and the keys of the episodes in each of its files of rows, in order."""

    dataset: Dataset
    episodes: Table
    keys: dict[str, list[str]]

    @property
    def manifest(self) -> Manifest:
        return self.dataset.manifest

    @property
    def files(self) -> list[File]:
        return [file for file in self.manifest.data_files if file.path in self.keys]

    @property
    def identity(self) -> Parent:
        return Parent(self.manifest.name, self.manifest.version, self.manifest.hash)


@dataclass(frozen=True)
class Edited:
    """A new version, and how it was made. `taken` and `written` count its files of rows: those that a parent has too,
    and the others. `copies` counts episodes that were there already. `moved` has the sides of every tower that was on
    another side in a parent: there and here."""

    manifest: Manifest
    taken: int
    written: int
    copies: int
    moved: dict[str, tuple[str, str]]

    def as_dict(self) -> dict[str, Any]:
        """What the verbs print with --json, without the folder."""
        manifest = self.manifest
        return {
            "dataset": manifest.identifier,
            "hash": manifest.hash,
            "parents": [f"{parent.name}@{parent.version}" for parent in manifest.parents],
            "episodes": manifest.counts.episodes,
            "rows": manifest.counts.rows,
            "files": {"taken": self.taken, "written": self.written},
            "copies": self.copies,
            "moved": {tower: list(sides) for tower, sides in self.moved.items()},
        }


def open_parent(where: str | Path) -> Opened:
    """Open a dataset of the present format to make a new version of it.

    Raises:
        JengaError: there is none, or it is of an older format.
        CheckFailed: it is damaged.
    """
    dataset = open_dataset(where)
    return opened(dataset, dataset.manifest.data_files)


def opened(dataset: Dataset, files: Sequence[File]) -> Opened:
    """As a parent of which only `files` are needed.

    Raises:
        JengaError: it is of an older format.
        CheckFailed: it is damaged.
    """
    found = dataset.manifest.format_version
    if format_of(found) != format_of(FORMAT_VERSION):
        raise JengaError(
            f"{dataset.folder} has format version {found}; edits need {FORMAT_VERSION}: lift it with "
            f"`jenga dataset migrate {dataset.folder} --out NEW`"
        )
    episodes = dataset.episodes()
    keys = {file.path: _keys_in(dataset, file) for file in files}
    if unknown := {key for found in keys.values() for key in found} - set(episodes["episode"].tolist()):
        raise CheckFailed(
            f"{dataset.folder} has rows of episode {min(unknown)}, which is not in its table: "
            f"run `jenga dataset verify {dataset.folder}`"
        )
    return Opened(dataset, episodes, keys)


def _keys_in(dataset: Dataset, file: File) -> list[str]:
    with dataset.open_file(file) as source:
        column = np.asarray(numpy_column(source.read(columns=["episode"]).column(0)))
    return list(dict.fromkeys(column.tolist()))


def check_new(name: str, version: str, parents: Sequence[Opened]) -> None:
    """Refuse a name and version that a dataset made from the parents may not have.

    Raises:
        JengaError: it is malformed, or not above a parent's of the same name.
    """
    check_identity(name, version)
    for parent in parents:
        above = parent.manifest.version
        if name == parent.manifest.name and _numbers(version) <= _numbers(above):
            raise JengaError(f"version {version} is not above {above} of its parent {name}; choose a higher --version")


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(map(int, version.split(".")))


def inherited(
    parents: Sequence[Opened],
    name: str,
    version: str,
    splits: Splits,
    provenance: Provenance,
    invalid: int,
    *,
    licence: str | None = None,
    description: str | None = None,
) -> Draft:
    """What a new version has from its parents, which must agree.

    Raises:
        JengaError: their kinds, blocks, thresholds or licences differ.
    """
    manifests = [parent.manifest for parent in parents]
    kinds = _each(manifests, lambda m: f"{m.kind} of {m.blocks} blocks")
    if len(set(kinds.values())) > 1:
        raise JengaError(f"datasets of different kinds make no dataset ({_listed(kinds)}): keep them apart")
    first = manifests[0]
    for other in manifests[1:]:
        refuse_other_labels(first, other.identifier, other.labels)
    licences = _each(manifests, lambda m: m.licence)
    if licence is None and len(set(licences.values())) > 1:
        raise JengaError(f"the licences differ ({_listed(licences)}); name one that all allow with --licence")
    descriptions = {m.description for m in manifests}
    return Draft(
        name=name,
        version=version,
        kind=first.kind,
        blocks=first.blocks,
        splits=splits,
        provenance=provenance,
        invalid=invalid,
        licence=first.licence if licence is None else licence,
        description=description or (descriptions.pop() if len(descriptions) == 1 else ""),
        citation=tuple(dict.fromkeys(line for m in manifests for line in m.citation)),
        labels=tuple(first.labels),
        parents=tuple(parent.identity for parent in parents),
    )


def refuse_other_labels(manifest: Manifest, other: str, labels: Sequence[Label]) -> None:
    """Rows whose labels were decided by other thresholds do not go together.

    Raises:
        JengaError: a threshold differs.
    """
    own, found = ({label.name: label.thresholds for label in ls} for ls in (manifest.labels, labels))
    if odd := sorted(name for name in own.keys() | found.keys() if own.get(name) != found.get(name)):
        raise JengaError(
            f"label {odd[0]!r} has the thresholds {own.get(odd[0])} in {manifest.identifier} and {found.get(odd[0])} "
            f"in {other}: convert the logs of both with the same jenga"
        )


def moved_towers(parents: Sequence[Opened], splits: Splits) -> dict[str, tuple[str, str]]:
    """Towers that are on another side than in a parent: that side and the new one."""
    now = {tower: split for split in SPLITS for tower in splits.towers(split)}
    sides = [(t, side) for p in parents for side in SPLITS for t in p.manifest.splits.towers(side)]
    return {t: (side, now[t]) for t, side in sides if t in now and now[t] != side}


def _each(manifests: Sequence[Manifest], what: Any) -> dict[str, str]:
    return {manifest.identifier: what(manifest) for manifest in manifests}


def _listed(each: dict[str, str]) -> str:
    return "; ".join(f"{name}: {what}" for name, what in each.items())
