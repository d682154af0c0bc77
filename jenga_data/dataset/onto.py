"""Logs are added to a dataset: its files stay as they are, new episodes go into files of their own."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from jenga_data.dataset import describe
from jenga_data.dataset.assemble import assemble
from jenga_data.dataset.convert import check_workers
from jenga_data.dataset.episode_table import joined, table_of
from jenga_data.dataset.manifest import DATA
from jenga_data.dataset.parents import (
    Edited,
    Opened,
    check_new,
    inherited,
    moved_towers,
    open_parent,
    refuse_other_labels,
)
from jenga_data.dataset.provenance import invalid_numbers, joined_provenance, provenance
from jenga_data.dataset.shards import plan
from jenga_data.dataset.sources import Source, Sources, read_sources
from jenga_data.dataset.split import split_towers
from jenga_data.dataset.spool import spool_folder
from jenga_data.dataset.staging import new_folder, refuse_existing
from jenga_data.dataset.take import take_over
from jenga_data.dataset.write import write_shards
from jenga_data.errors import JengaError
from jenga_data.outcome import Outcome


def convert_onto(
    onto: str | Path,
    logs: Sequence[Path],
    out: Path,
    name: str,
    version: str,
    *,
    licence: str | None = None,
    workers: int = 1,
) -> Edited:
    """Make NAME@VERSION of a dataset and all logs below the folders `logs` that it does not hold yet.

    The rows are those that all logs together would give, in another order where a collection went on within one
    file's range of numbers: what is new goes into another file, no old one is written again.

    Args:
        onto: folder or NAME@X.Y.Z of the dataset.
        licence: of the new version; None: that of the dataset.
        workers: processes that read logs; their number changes nothing but the time.

    Raises:
        JengaError: no log is new, they do not fit the dataset or contradict it, or `out` exists or cannot be written.
        CheckFailed: the dataset or a log is damaged.
    """
    check_workers(workers)
    refuse_existing(out)
    parent = open_parent(onto)
    check_new(name, version, [parent])
    refuse_other_labels(parent.manifest, "this jenga", describe.labels())
    found = read_sources(logs, workers)
    new = _new(parent, found)
    towers = [*parent.episodes["tower"].tolist(), *(s.tower for s in new.valid)]
    splits = split_towers(towers)
    draft = inherited(
        [parent],
        name,
        version,
        splits,
        joined_provenance([parent.manifest.provenance, provenance(new)]),
        parent.manifest.counts.invalid + len(new.logs) - len(new.valid),
        licence=licence,
    )
    train = frozenset(splits.train)
    with new_folder(out) as folder:
        (folder / DATA).mkdir()
        old = [take_over(parent, file, folder, train) for file in parent.files]
        with spool_folder(folder) as spool:
            rows = read_sources([log.path for log in new.logs], workers, spool)
            parts = write_shards(folder, new.kind, new.blocks, plan(rows.valid), train, workers)
        added = table_of([e for part in parts for e in part.episodes])
        manifest = assemble(folder, draft, [*old, *parts], joined([parent.episodes, added]))
    copies = len(found.logs) - len(new.logs)
    return Edited(manifest, len(old), len(parts), copies, moved_towers([parent], splits))


def _new(parent: Opened, found: Sources) -> Sources:
    """The logs that the dataset does not hold.

    Raises:
        JengaError: there are none, they are of another kind or size, or one contradicts the dataset.
    """
    manifest = parent.manifest
    if (found.kind, found.blocks) != (manifest.kind, manifest.blocks):
        raise JengaError(
            f"the logs make {found.kind} of {found.blocks} blocks, {manifest.identifier} is {manifest.kind} of "
            f"{manifest.blocks} blocks: convert them apart"
        )
    hashes = dict(zip(parent.episodes["episode"].tolist(), parent.episodes["log_sha256"].tolist(), strict=True))
    invalid = invalid_numbers(manifest.provenance, parent.episodes)
    new = []
    for log in found.logs:
        counted = log.number in invalid.get((log.seed, log.config, log.checkpoint), ())
        if log.episode in hashes or counted:
            _refuse_contradiction(parent, log, hashes.get(log.episode))
        else:
            new.append(log)
    if not new:
        raise JengaError(f"{manifest.identifier} holds all {len(found.logs)} logs already: nothing to add")
    used = {log.config for log in new}
    return replace(found, logs=new, configs={key: config for key, config in found.configs.items() if key in used})


def _refuse_contradiction(parent: Opened, log: Source, known: str | None) -> None:
    """An episode that is in the dataset must be from the same log, one whose physics broke must have broken again."""
    if known is None and log.outcome == Outcome.INVALID:
        return
    if log.log_sha256 != known:
        what = "another log" if known else "one with broken physics"
        raise JengaError(
            f"{log.path} is episode {log.episode}, which {parent.manifest.identifier} has of {what}: "
            "leave the log out, or convert all logs again"
        )
