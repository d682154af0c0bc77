"""Logs in, a dataset out: byte-identical for the same logs in any order, a few episodes in memory at a time."""

from collections.abc import Sequence
from pathlib import Path

from jenga_data.dataset import describe
from jenga_data.dataset.assemble import Draft, assemble
from jenga_data.dataset.episode_table import table_of
from jenga_data.dataset.manifest import Manifest, check_identity
from jenga_data.dataset.provenance import provenance
from jenga_data.dataset.shards import plan
from jenga_data.dataset.sources import read_sources
from jenga_data.dataset.split import split_towers
from jenga_data.dataset.spool import spool_folder
from jenga_data.dataset.staging import new_folder
from jenga_data.dataset.write import write_shards
from jenga_data.errors import JengaError


def convert(
    logs: Sequence[Path],
    out: Path,
    name: str,
    version: str,
    *,
    licence: str = describe.LICENCE,
    description: str = "",
    workers: int = 1,
) -> Manifest:
    """Make the dataset NAME@VERSION in the new folder `out` from all logs below the folders `logs`.

    The kind follows from the logs. Episodes whose physics broke are counted in the manifest and in no file.

    Args:
        workers: processes that read logs; their number changes nothing but the time.

    Raises:
        JengaError: `out` exists or cannot be written, or the logs are damaged, unfinished, mixed or too few.
    """
    check_identity(name, version)
    check_workers(workers)
    with new_folder(out) as folder:
        with spool_folder(folder) as spool:
            sources = read_sources(logs, workers, spool)
            draft = Draft(
                name=name,
                version=version,
                kind=sources.kind,
                blocks=sources.blocks,
                splits=split_towers(s.tower for s in sources.valid),
                provenance=provenance(sources),
                invalid=len(sources.logs) - len(sources.valid),
                licence=licence,
                description=description,
            )
            train = frozenset(draft.splits.train)
            parts = write_shards(folder, sources.kind, sources.blocks, plan(sources.valid), train, workers)
        return assemble(folder, draft, parts, table_of([e for part in parts for e in part.episodes]))


def check_workers(workers: int) -> None:
    """Refuse what is no number of processes.

    Raises:
        JengaError: it is none.
    """
    if workers < 1:
        raise JengaError(f"workers is {workers}; allowed: 1 or more")
