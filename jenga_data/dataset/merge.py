"""Several datasets become one: their files as they are, equal episodes once."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jenga_data.dataset.assemble import assemble
from jenga_data.dataset.episode_table import Table, chosen, joined
from jenga_data.dataset.manifest import DATA, File
from jenga_data.dataset.parents import Edited, Opened, check_new, inherited, moved_towers, open_parent
from jenga_data.dataset.provenance import joined_invalid, joined_provenance
from jenga_data.dataset.split import split_towers
from jenga_data.dataset.staging import new_folder, refuse_existing
from jenga_data.dataset.take import take_over, write_again
from jenga_data.errors import JengaError


def merge(
    wheres: Sequence[str | Path],
    out: Path,
    name: str,
    version: str,
    *,
    licence: str | None = None,
    description: str | None = None,
) -> Edited:
    """Make NAME@VERSION of all episodes of several datasets, given by folder or NAME@X.Y.Z, in the new folder `out`.

    An episode that several parents have counts once. A file is written again only if some of its episodes lie in a
    larger file too, and not all. The order of the parents changes nothing but the list of them.

    Args:
        licence: of the new version; needed where those of the parents differ.
        description: of the new version; by default that of the parents if it is the same.

    Raises:
        JengaError: fewer than two different datasets, they do not fit together or contradict each other, or `out`
            exists or cannot be written.
        CheckFailed: a parent is damaged.
    """
    refuse_existing(out)
    opened = {parent.manifest.hash: parent for parent in map(open_parent, wheres)}
    parents = list(opened.values())
    if len(parents) < 2:
        raise JengaError(f"{len(parents)} different datasets were given; merge needs at least 2: name them all")
    check_new(name, version, parents)
    episodes = _episodes_once(parents)
    splits = split_towers(episodes["tower"].tolist())
    draft = inherited(
        parents,
        name,
        version,
        splits,
        joined_provenance([parent.manifest.provenance for parent in parents]),
        joined_invalid([(parent.manifest, parent.episodes) for parent in parents]),
        licence=licence,
        description=description,
    )
    train = frozenset(splits.train)
    with new_folder(out) as folder:
        (folder / DATA).mkdir()
        parts, taken = [], 0
        for parent, file, keep, whole in _plan(parents):
            taken += whole
            part = take_over(parent, file, folder, train) if whole else write_again(parent, file, keep, folder, train)
            parts.append(part)
        manifest = assemble(folder, draft, parts, episodes)
    copies = sum(len(parent.episodes["episode"]) for parent in parents) - manifest.counts.episodes
    return Edited(manifest, taken, len(parts) - taken, copies, moved_towers(parents, splits))


def _episodes_once(parents: Sequence[Opened]) -> Table:
    """The tables of all parents, each episode once.

    Raises:
        JengaError: two parents say different things of one episode.
    """
    table = joined([parent.episodes for parent in parents])
    owner = np.repeat(np.arange(len(parents)), [len(parent.episodes["episode"]) for parent in parents])
    _, first, inverse = np.unique(table["episode"], return_index=True, return_inverse=True)
    for column in ("log_sha256", *(name for name in table if name != "log_sha256")):
        values, own = table[column], table[column][first[inverse]]
        differ = np.flatnonzero((values != own) & ~((values != values) & (own != own)))  # NaN is like NaN
        if len(differ):
            at, before = int(differ[0]), int(first[inverse[differ[0]]])
            names = [parents[int(owner[i])].manifest.identifier for i in (before, at)]
            raise JengaError(
                f"episode {table['episode'][at]} differs in {column} between {names[0]} and {names[1]}: "
                "drop it from one of them with `jenga dataset drop`"
            )
    return chosen(table, np.isin(np.arange(len(owner)), first))


def _plan(parents: Sequence[Opened]) -> list[tuple[Opened, File, frozenset[str], bool]]:
    """Which episodes of which files make the new dataset, and whether the file can stay as it is.

    Where files overlap the larger one stays whole. Of two files of one name with different episodes, which only
    another program would write, the second gets a new name.
    """
    files = [(parent, file) for parent in parents for file in parent.files]
    files.sort(key=lambda pair: (-len(pair[0].keys[pair[1].path]), pair[1].path, pair[1].sha256))
    there: set[str] = set()
    paths: set[str] = set()
    planned = []
    for parent, file in files:
        keys = parent.keys[file.path]
        fresh = frozenset(keys) - there
        if (keys and not fresh) or (not keys and file.path in paths):
            continue
        planned.append((parent, file, fresh, len(fresh) == len(keys) and file.path not in paths))
        there |= fresh
        paths.add(file.path)
    return planned
