"""The logs that a dataset is made from: found in folders, hashed, and freed of copies."""

import hashlib
import logging
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from jenga_data.dataset.schema import DATASET_KIND
from jenga_data.dataset.spool import Spooled, spool_writer
from jenga_data.episode import EpisodeHeader, Result
from jenga_data.errors import JengaError
from jenga_data.log.excerpt import read_for_rows
from jenga_data.log.index import fingerprint
from jenga_data.log.output import PARTIAL
from jenga_data.log.reader import read_header
from jenga_data.log.records import one_line, open_log
from jenga_data.outcome import Outcome
from jenga_data.pool import run_every
from jenga_data.progress import progress

_LOG = logging.getLogger(__name__)
_PREDICTION = ".prediction.mcap"
_LOGS_A_TASK = 64
"""A worker takes a second to start; so many logs take less."""


@dataclass(frozen=True)
class Source:
    """One log, as far as it is kept in memory. From `episode` to `versions` the fields are columns of
    `episodes.parquet`."""

    path: Path
    episode: str
    kind: str
    seed: int
    number: int
    config: str
    checkpoint: str
    tower: str
    round: int
    target: int
    turn: int
    face: int
    failure: bool
    strict_failure: bool
    dragged: bool
    outcome: str
    moved: float
    cause: str
    clear_frame: int
    control_step_ns: int
    log_sha256: str
    log_bytes: int
    commit: str
    versions: str
    spooled: Spooled | None = None
    """Where the rows wait, if they were asked for and there are any."""


@dataclass(frozen=True)
class Sources:
    """All logs of a dataset, each once and in order; `configs` by their hash."""

    kind: str
    blocks: int
    logs: list[Source]
    configs: dict[str, dict[str, Any]]

    @property
    def valid(self) -> list[Source]:
        """The episodes that make rows: all but those whose physics broke."""
        return [s for s in self.logs if s.outcome != Outcome.INVALID]


def find_logs(folders: Sequence[Path]) -> list[Path]:
    """All finished logs below the folders, without the predictions that lie beside them.

    A file may be given in place of a folder.

    Raises:
        JengaError: a folder is missing, holds no log, or holds one that was never finished.
    """
    found: dict[Path, None] = {}
    for folder in folders:
        if not folder.exists():
            raise JengaError(f"no such folder: {folder}; collect episodes into it with `jenga collect`")
        partial = sorted(folder.rglob(f"*.mcap{PARTIAL}"))
        unfinished = [p for p in partial if not p.with_name(p.name.removesuffix(PARTIAL)).exists()]
        if unfinished:
            more = f" and {len(unfinished) - 1} more" if len(unfinished) > 1 else ""
            raise JengaError(
                f"{unfinished[0]}{more} never finished: run the same `jenga collect` again, or `jenga log recover`"
            )
        logs = [folder] if folder.is_file() else sorted(folder.rglob("*.mcap"))
        logs = [p for p in logs if not p.name.endswith(_PREDICTION)]
        if not logs:
            raise JengaError(f"no log (*.mcap) in {folder}; collect some with `jenga collect --out {folder}`")
        found |= dict.fromkeys(p.resolve() for p in logs)
    return list(found)


def read_sources(folders: Sequence[Path], workers: int = 1, spool: Path | None = None) -> Sources:
    """Look at every log below the folders.

    Byte-identical copies count once. The result does not depend on the order of folders and files, but for where rows
    wait.

    Args:
        spool: folder for the rows that the logs make; None: frames are neither read nor checked.

    Raises:
        JengaError: logs are damaged, unfinished, of different kinds or sizes, or contradict each other; or a worker
            died.
    """
    paths = find_logs(folders)
    by_key: dict[str, Source] = {}
    configs: dict[str, dict[str, Any]] = {}
    kinds: dict[tuple[str, int], Path] = {}
    for look in _looks(paths, workers, spool):
        configs |= look.configs
        for source, blocks in look.sources:
            other = by_key.setdefault(source.episode, source)
            if other.log_sha256 != source.log_sha256:
                raise JengaError(
                    f"two logs of episode {source.episode} differ: {other.path} and {source.path}; keep one"
                )
            kinds.setdefault((source.kind, blocks), source.path)
    if len(kinds) > 1:
        examples = "; ".join(f"{kind} of {blocks} blocks: {path}" for (kind, blocks), path in sorted(kinds.items()))
        raise JengaError(f"logs of different kinds make no dataset ({examples}): convert them apart")
    if len(by_key) < len(paths):
        _LOG.warning("%d of %d logs are copies of others and count once", len(paths) - len(by_key), len(paths))
    kind, blocks = next(iter(kinds))
    logs = sorted(by_key.values(), key=lambda s: (s.seed, s.config, s.checkpoint, s.number, s.episode))
    return Sources(DATASET_KIND[kind], blocks, logs, dict(sorted(configs.items())))


@dataclass(frozen=True)
class _Task:
    """Logs to look at, and the file for their rows if these are wanted: of logs like one that was looked at before."""

    paths: tuple[Path, ...]
    spool: Path | None
    kind: str
    blocks: int


@dataclass(frozen=True)
class _Look:
    """What some logs say: each with its number of blocks, and the configs by their hash."""

    sources: list[tuple[Source, int]]
    configs: dict[str, dict[str, Any]]


def _looks(paths: Sequence[Path], workers: int, spool: Path | None) -> list[_Look]:
    """Looks at all logs, in the order of `paths` for any number of workers."""
    first, _ = read_header(paths[0])
    like = first.kind, len(first.blocks)
    chunks = [tuple(paths[i : i + _LOGS_A_TASK]) for i in range(0, len(paths), _LOGS_A_TASK)]
    tasks = [_Task(chunk, spool and spool / f"{i}.arrow", *like) for i, chunk in enumerate(chunks)]
    found: dict[_Task, _Look] = {}
    with progress("read logs", len(paths)) as bar:
        for task, look in run_every(_look, tasks, max(1, min(workers, len(chunks) // 2))):
            found[task] = look
            bar.advance(len(task.paths))
    return [found[task] for task in tasks]


def _look(task: _Task) -> _Look:
    look = _Look([], {})
    with ExitStack() as stack:
        writer = None
        if task.spool is not None and task.kind in DATASET_KIND:
            writer = stack.enter_context(spool_writer(task.spool, DATASET_KIND[task.kind], task.blocks))
        for path in task.paths:
            with one_line(path), open_log(path) as stream:
                file = fingerprint(stream)
            if writer is None:
                header, result = read_header(path)
                excerpt = None
            else:
                read = read_for_rows(path, DATASET_KIND[task.kind] == "selection", file.intact)
                header, result, excerpt = read.header, read.result, read.excerpt
            like = (header.kind, len(header.blocks)) == (task.kind, task.blocks)
            spooled = writer.add(excerpt) if writer is not None and excerpt is not None and like else None
            source = _source(path, header, result, file.sha256, spooled)
            look.sources.append((source, len(header.blocks)))
            look.configs[source.config] = header.config
    return look


def _source(path: Path, header: EpisodeHeader, result: Result | None, sha256: str, spooled: Spooled | None) -> Source:
    if result is None:
        raise JengaError(f"{path} ends before its outcome: run `jenga log recover {path}`, or delete it")
    if header.kind not in DATASET_KIND:
        raise JengaError(f"{path} is of kind {header.kind!r}; allowed: {', '.join(DATASET_KIND)}")
    try:
        config = hashlib.sha256(msgspec.json.encode(header.config, order="deterministic")).hexdigest()[:16]
    except (OverflowError, RecursionError) as error:
        raise JengaError(f"{path} has a config that no manifest can hold: {error}") from error
    # Of the provenance only these: the machine and the time have no place in a dataset.
    versions = {k: v for k, v in header.provenance.items() if k.endswith("version")}
    commits = [v for k, v in sorted(header.provenance.items()) if k.endswith("commit")]
    verdict = result.verdict
    return Source(
        path=path,
        spooled=spooled,
        episode=header.key,
        kind=header.kind,
        seed=header.seed,
        number=header.number,
        config=config,
        checkpoint=header.checkpoint,
        tower=header.blocks.tower,
        round=header.round,
        target=header.target,
        turn=header.turn,
        face=header.face,
        failure=verdict.failure,
        strict_failure=verdict.strict_failure,
        dragged=verdict.dragged,
        outcome=str(verdict.outcome),
        moved=verdict.moved,
        cause=result.cause,
        clear_frame=verdict.clear_frame,
        control_step_ns=header.control_step_ns,
        log_sha256=sha256,
        log_bytes=path.stat().st_size,
        commit=" ".join(commits),
        versions=msgspec.json.encode(versions, order="deterministic").decode(),
    )
