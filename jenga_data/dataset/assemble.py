"""The last step of every way to make a dataset: from files of rows and a table of episodes to a sealed manifest."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from jenga_data.dataset import describe
from jenga_data.dataset.episode_table import Table, count, write_episodes
from jenga_data.dataset.manifest import MANIFEST, Label, Manifest, Parent, Provenance, Splits, canonical_bytes, sealed
from jenga_data.dataset.schema import COLUMNS, FORMAT_VERSION
from jenga_data.dataset.statistics import ColumnStatistics
from jenga_data.dataset.write import Part
from jenga_data.errors import JengaError


@dataclass(frozen=True)
class Draft:
    """What a manifest says that does not follow from the files."""

    name: str
    version: str
    kind: str
    blocks: int
    splits: Splits
    provenance: Provenance
    invalid: int
    """Episodes whose physics broke: they are among the recipes and in no file."""
    licence: str = describe.LICENCE
    description: str = ""
    citation: tuple[str, ...] = describe.CITATION
    labels: tuple[Label, ...] = ()
    """Empty: those of this code."""
    parents: tuple[Parent, ...] = ()
    may_lack_training: bool = False
    """Whether there may be no row to train on: in a part of a dataset."""


def assemble(folder: Path, draft: Draft, parts: Sequence[Part], episodes: Table) -> Manifest:
    """Write the table of episodes and the manifest beside files of rows that lie in `folder` already.

    Raises:
        JengaError: there is no row, or none to train on.
    """
    statistics = ColumnStatistics(COLUMNS[draft.kind])
    parts = sorted(parts, key=lambda part: part.file.path)
    for part in parts:
        statistics.merge(part.statistics)
    rows = sum(part.file.rows for part in parts)
    if not statistics.rows and not (rows and draft.may_lack_training):
        raise JengaError(f"this gives {rows} rows, none of them to train on: collect more episodes")
    table = write_episodes(folder, episodes)
    unsealed = Manifest(
        name=draft.name,
        version=draft.version,
        format_version=FORMAT_VERSION,
        kind=draft.kind,
        description=draft.description or describe.DESCRIPTION[draft.kind],
        blocks=draft.blocks,
        features=describe.features(draft.kind, draft.blocks),
        files=sorted([*(part.file for part in parts), table], key=lambda f: f.path),
        splits=draft.splits,
        statistics=statistics.summary(),
        labels=list(draft.labels) or describe.labels(),
        counts=count(episodes, rows, draft.invalid),
        provenance=draft.provenance,
        parents=list(draft.parents),
        licence=draft.licence,
        citation=list(draft.citation),
        sources=[],
    )
    manifest = sealed(unsealed)
    (folder / MANIFEST).write_bytes(canonical_bytes(manifest))
    return manifest
