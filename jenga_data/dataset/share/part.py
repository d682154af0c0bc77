"""A part of a dataset as a dataset of its own: its splits or episodes, with a manifest that names the whole."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import msgspec
import numpy as np

from jenga_data.dataset.assemble import assemble
from jenga_data.dataset.episode_table import chosen as episodes_where
from jenga_data.dataset.manifest import SPLITS, File, Manifest, Splits
from jenga_data.dataset.parents import inherited, opened
from jenga_data.dataset.provenance import remaining_provenance
from jenga_data.dataset.read import Dataset
from jenga_data.dataset.schema import EPISODES
from jenga_data.dataset.shards import plan
from jenga_data.dataset.sources import Source
from jenga_data.dataset.take import take_episodes
from jenga_data.errors import CheckFailed, JengaError


@dataclass(frozen=True)
class Part:
    """What is wanted of a dataset: the episodes of some splits (of all where there is none), and of them these."""

    splits: tuple[str, ...]
    episodes: tuple[str, ...]

    @property
    def words(self) -> str:
        """For the manifest."""
        splits = f"split {'+'.join(self.splits)}" if self.splits else ""
        return " and ".join(t for t in (splits, f"{len(self.episodes)} named episodes" if self.episodes else "") if t)

    def name(self, whole: str) -> str:
        """Of the part: it must not be mistaken for the whole, which has the same version."""
        suffix = "-".join(self.splits)
        if self.episodes:
            keys = "\n".join((*self.splits, *sorted(self.episodes)))
            suffix = f"part-{hashlib.sha256(keys.encode()).hexdigest()[:8]}"
        return f"{whole[: 63 - len(suffix)]}.{suffix}"


def part_of(split: str, episodes: Sequence[str]) -> Part:
    """Read what a person asks for; splits are put in order, so that the same part has one name.

    Raises:
        JengaError: there is no such split.
    """
    asked = split.split("+") if split else []
    if unknown := set(asked) - set(SPLITS):
        raise JengaError(f"no split {min(unknown)!r}; allowed: {', '.join(SPLITS)}, or a sum of them")
    return Part(tuple(s for s in SPLITS if s in asked), tuple(dict.fromkeys(episodes)))


def sources_of(episodes: dict[str, np.ndarray]) -> list[Source]:
    """The logs that a dataset was made from, in order, as its table of episodes tells of them.

    Raises:
        CheckFailed: the table's `versions` are not what a converter writes.
    """
    for text in set(episodes["versions"].tolist()):
        try:
            msgspec.json.decode(text, type=dict[str, str])
        except msgspec.DecodeError as error:
            raise CheckFailed(f"{EPISODES} has versions that are none ({error}): get the dataset elsewhere") from error
    names = [f.name for f in fields(Source) if f.name not in ("path", "spooled")]
    values = zip(*(episodes[name].tolist() for name in names), strict=True)
    sources = [Source(path=Path(), **dict(zip(names, v, strict=True))) for v in values]
    return sorted(sources, key=lambda s: (s.seed, s.config, s.checkpoint, s.number, s.episode))


def choose(part: Part, manifest: Manifest, sources: Sequence[Source]) -> list[Source]:
    """The episodes of a part.

    Raises:
        JengaError: a named episode is not in the dataset, or not in the splits; or the part is empty.
    """
    towers = {t for s in part.splits or SPLITS for t in manifest.splits.towers(s)}
    chosen = [s for s in sources if s.tower in towers or not part.splits]
    if part.episodes:
        chosen = [s for s in chosen if s.episode in set(part.episodes)]
        if missing := set(part.episodes) - {s.episode for s in chosen}:
            inside = f"split {'+'.join(part.splits)} of " if part.splits else ""
            raise JengaError(
                f"no episode {min(missing)!r} in {inside}{manifest.identifier}, which has {len(sources)} episodes: "
                f"the keys are in its {EPISODES}"
            )
    if not chosen:
        raise JengaError(f"{part.words} of {manifest.identifier} holds no episode")
    return chosen


def files_of(manifest: Manifest, sources: Sequence[Source], chosen: Sequence[Source]) -> list[File]:
    """The files in which the rows of the chosen episodes are: a file is a function of its episodes.

    Where a dataset was laid out another way, all its files.
    """
    keys = {s.episode for s in chosen}
    shards = plan(sources)
    if {s.path for s in shards} != {f.path for f in manifest.data_files}:
        return manifest.data_files
    needed = {s.path for s in shards if any(source.episode in keys for source in s.sources)}
    return [f for f in manifest.data_files if f.path in needed]


def write_part(whole: Dataset, part: Part, chosen: Sequence[Source], files: Sequence[File], folder: Path) -> Manifest:
    """Write the dataset of the chosen episodes into an empty folder, in the converter's order and bytes.

    Args:
        whole: where of the data only `files` need to be there, with the right hashes.

    Raises:
        CheckFailed: the files do not hold the rows that the table of episodes promises.
        JengaError: the part has no rows, or the whole is of an older format.
    """
    manifest, parent = whole.manifest, opened(whole, files)
    table = episodes_where(parent.episodes, np.isin(parent.episodes["episode"], [s.episode for s in chosen]))
    splits = _splits(manifest, {s.tower for s in chosen})
    provenance = remaining_provenance(manifest.provenance, parent.episodes, table)
    invalid = manifest.counts.invalid
    draft = replace(
        inherited([parent], part.name(manifest.name), manifest.version, splits, provenance, invalid),
        description=f"Part of {manifest.identifier} (hash {manifest.hash}): {part.words}. {manifest.description}",
        may_lack_training=True,
    )
    parts, _ = take_episodes(parent, table["episode"].tolist(), folder, frozenset(splits.train))
    promised, found = int(table["rows"].sum()), sum(p.file.rows for p in parts)
    if promised != found:
        raise CheckFailed(
            f"{manifest.identifier} promises {promised} rows of the wanted episodes and its files hold {found}"
        )
    return assemble(folder, draft, parts, table)


def _splits(whole: Manifest, towers: set[str]) -> Splits:
    sides = {s: [t for t in whole.splits.towers(s) if t in towers] for s in SPLITS}
    return Splits(rule=f"those of {whole.identifier}: {whole.splits.rule}", **sides)
