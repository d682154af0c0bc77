"""Checks on what rows, episodes and manifest say of each other. Each yields one line for every thing that is wrong."""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from jenga_data.dataset.manifest import SPLITS, Manifest, Statistic
from jenga_data.dataset.read import Dataset
from jenga_data.dataset.schema import EPISODE_COLUMNS
from jenga_data.outcome import Outcome

Table = dict[str, np.ndarray]


def check_splits(manifest: Manifest, episodes: Table, blocks_of: dict[str, set[bytes]]) -> Iterator[str]:
    """Every tower of the data is on exactly one side, and no set of blocks hides under two names.

    Args:
        blocks_of: hashes of the sets of blocks that the rows of each tower have.
    """
    side = Counter(tower for split in SPLITS for tower in set(manifest.splits.towers(split)))
    for tower, times in side.items():
        if times > 1:
            yield f"leak: tower {tower} is on {times} sides"
    present = set(episodes["tower"].tolist())
    for tower in sorted(present - side.keys()):
        yield f"tower {tower} is in no split"
    for tower in sorted(side.keys() - present):
        yield f"tower {tower} is in a split and has no episode"
    for split in SPLITS:
        if not manifest.splits.towers(split) and len(manifest.parents) != 1:  # a part may lack a side of its whole
            yield f"split {split} is empty"
    for tower, sets in blocks_of.items():
        if len(sets) > 1:
            yield f"tower {tower} has {len(sets)} different sets of blocks"
    names = Counter(s for sets in blocks_of.values() for s in sets)
    for tower in sorted(t for t, sets in blocks_of.items() if any(names[s] > 1 for s in sets)):
        yield f"leak: the blocks of tower {tower} stand under another name too"


def check_frames(rows: Table) -> Iterator[str]:
    """The rows of an episode stand together, in the order of their frames."""
    episode, frame = rows["episode"], rows["frame"]
    starts = np.flatnonzero(np.r_[True, episode[1:] != episode[:-1]])
    again = [key for key, times in Counter(episode[starts].tolist()).items() if times > 1]
    if again:
        yield f"{len(again)} episodes have their rows apart, first {again[0]}"
    same = episode[1:] == episode[:-1]
    backwards = np.flatnonzero(same & (np.diff(frame) <= 0))
    if len(backwards):
        yield f"{len(backwards)} rows do not come after the one before, first row {backwards[0] + 1}"


def check_episodes(dataset: Dataset, rows: Table, episodes: Table) -> Iterator[str]:
    """Every row belongs to an episode of the table and repeats what that says; labels follow from each other."""
    keys, inverse = np.unique(episodes["episode"], return_index=True)
    if len(keys) < len(episodes["episode"]):
        yield "an episode is in the table twice"
    at = np.minimum(np.searchsorted(keys, rows["episode"]), len(keys) - 1)
    if unknown := set(rows["episode"][keys[at] != rows["episode"]].tolist()):
        yield f"rows of {len(unknown)} episodes that are not in the table, first {min(unknown)}"
        return
    entry = inverse[at]
    shared = {c.name for c in dataset.columns} & {c.name for c in EPISODE_COLUMNS}
    for name in sorted(shared):
        if (dataset.column(name) != episodes[name][entry]).any():
            yield f"{name} differs between rows and episodes"
    state_after = 1 if dataset.manifest.kind == "dynamics" else 0
    if (rows["frame"] + state_after >= episodes["frames"][entry]).any():
        yield "a row's frame lies beyond the end of its episode"
    if not (np.isfinite(episodes["moved"]).all() and (episodes["moved"] >= 0).all()):
        yield "moved is negative or not finite"
    if (episodes["control_step_ns"] <= 0).any() or (episodes["clear_frame"] >= episodes["frames"]).any():
        yield "control_step_ns is not positive, or clear_frame lies beyond the end of its episode"
    if (np.bincount(entry, minlength=len(episodes["rows"])) != episodes["rows"]).any():
        yield "an episode has not as many rows as the table says"
    failed = np.isin(episodes["outcome"], [o.value for o in Outcome if o.failure])
    if (failed != episodes["failure"]).any() or (episodes["strict_failure"] != failed | episodes["dragged"]).any():
        yield "failure or strict_failure does not follow from outcome and dragged"
    if dataset.manifest.kind == "dynamics":
        clear = episodes["clear_frame"][entry]
        if (dataset.column("target_clear") != (rows["frame"] >= clear) & (clear >= 0)).any():
            yield "target_clear does not follow from frame and clear_frame"


def check_counts(manifest: Manifest, rows: int, episodes: Table) -> Iterator[str]:
    """The manifest counts what there is."""
    count = manifest.counts
    found = {
        "rows": (count.rows, rows),
        "episodes": (count.episodes, len(episodes["episode"])),
        "towers": (count.towers, len(set(episodes["tower"].tolist()))),
        "dragged": (count.dragged, int(episodes["dragged"].sum())),
        "outcome": (count.outcome, dict(Counter(episodes["outcome"].tolist()))),
        "round": (count.round, dict(Counter(str(r) for r in episodes["round"].tolist()))),
        "cause": (count.cause, dict(Counter(c for c in episodes["cause"].tolist() if c))),
    }
    for name, (said, counted) in found.items():
        if said != counted:
            yield f"{name}: the manifest says {said}, the files hold {counted}"


def check_statistics(manifest: Manifest, found: dict[str, Statistic]) -> Iterator[str]:
    """The manifest's statistics are those of its training rows, to six digits."""
    if manifest.statistics.keys() != found.keys():
        yield f"statistics of other columns: {', '.join(sorted(manifest.statistics.keys() ^ found.keys()))}"
        return
    for name, own in found.items():
        said = manifest.statistics[name]
        scale = 1e-6 * np.maximum(np.abs(own.min), np.abs(own.max))
        for moment in ("mean", "std", "min", "max"):
            a, b = np.array(getattr(said, moment)), np.array(getattr(own, moment))
            if said.count != own.count or a.shape != b.shape or (np.abs(a - b) > scale).any():
                yield f"{moment} of {name} is not that of the training rows"
