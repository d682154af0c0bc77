"""Collecting many episodes with worker processes: resumable, and the same files for any number of workers."""

import errno
import math
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import monotonic

import msgspec
from filelock import FileLock, Timeout

from jenga_data.collect.config import (
    NOBODY,
    Actor,
    CollectConfig,
    SelectionConfig,
    check_seed,
    config_from_dict,
    episode_key,
    recipe,
)
from jenga_data.collect.rollout import OpenLog
from jenga_data.collect.set_aside import Bug, Patience, SetAside, set_aside, take_back
from jenga_data.episode import Result
from jenga_data.errors import JengaError
from jenga_data.outcome import Outcome
from jenga_data.pool import Lost, run_all
from jenga_data.progress import progress

RECIPE = "collection.json"
"""What is collected in a folder: config and seed. Episodes of another recipe are refused."""
EPISODE_TIMEOUT = 600.0
"""Longest time for one episode [s]: thirty times what one takes on an idle core."""


@dataclass(frozen=True)
class CollectSummary:
    """What a folder holds after a run. `resumed` of the episodes were there before; those `set_aside` are not."""

    episodes: int
    outcomes: dict[str, int]
    causes: dict[str, int]
    resumed: int
    seconds: float
    out: str
    set_aside: tuple[SetAside, ...] = ()


def collect(
    config: CollectConfig,
    seed: int,
    numbers: Sequence[int],
    workers: int,
    out: Path,
    timeout: float = EPISODE_TIMEOUT,
) -> CollectSummary:
    """Run the episodes of these numbers and log each as `OUT/<key>.mcap`; those that are there are kept.

    Args:
        timeout: longest time for one episode [s], with more than one worker.

    Raises:
        JengaError: the folder holds another recipe, is in use, or cannot be written; a seed or count not allowed.
    """
    check_seed(seed)
    return run_episodes(partial(run_one, config), config, seed, numbers, workers, out, timeout=timeout)


def run_one(config: CollectConfig, seed: int, number: int, open_log: OpenLog) -> Result:
    """Run the rollout that `config` describes."""
    from jenga_data.collect.extraction import run_extraction
    from jenga_data.collect.selection import run_selection

    if isinstance(config, SelectionConfig):
        return run_selection(config, seed, number, open_log)
    return run_extraction(config, seed, number, open_log)


Rollout = Callable[[int, int, OpenLog], Result]
"""Runs episode (seed, number) into a log."""


def run_episodes(
    rollout: Rollout,
    config: CollectConfig,
    seed: int,
    numbers: Sequence[int],
    workers: int,
    out: Path,
    actor: Actor = NOBODY,
    label: str = "",
    timeout: float = math.inf,
) -> CollectSummary:
    """Run a rollout for each number that `out` does not hold yet, in worker processes.

    An episode that has a bug, or whose worker dies or takes longer than `timeout` [s] twice, is set aside with its
    reason and the rest go on. What was set aside before is tried again.

    Raises:
        JengaError: as `collect`.
        CheckFailed: one episode after the other had to be set aside.
    """
    if len(numbers) < 1 or workers < 1:
        raise JengaError(f"episodes is {len(numbers)} and workers is {workers}; both must be at least 1")
    if not timeout > 0:
        raise JengaError(f"the time for one episode is {timeout:g} s; allowed: more than 0, such as 600")
    began = monotonic()
    with claimed(out, config, seed, actor):
        paths = {n: out / f"{episode_key(config, seed, n, actor)}.mcap" for n in numbers}
        missing = [n for n, path in paths.items() if not path.exists()]
        tally, given_up, patience = _Tally(), list[SetAside](), Patience(out)
        for number in paths.keys() - set(missing):
            tally.add(*_ending(paths[number]))
            take_back(paths[number])
        with progress(label or f"collecting {config.kind}", len(paths)) as bar:
            bar.advance(len(paths) - len(missing), tally.note())
            for number, end in run_all(partial(_attempt, rollout, seed, out), missing, workers, timeout):
                if isinstance(end, Lost | Bug):
                    given_up.append(set_aside(paths[number], seed, number, end))
                    patience.failed(given_up)
                else:
                    tally.add(*end)
                    take_back(paths[number])
                    patience.succeeded()
                bar.advance(1, tally.note() + (f" set aside {len(given_up)}" if given_up else ""))
    return CollectSummary(
        episodes=len(paths) - len(given_up),
        outcomes={o.value: tally.outcomes[o.value] for o in Outcome},
        causes=dict(sorted(tally.causes.items())),
        resumed=len(paths) - len(missing),
        seconds=round(monotonic() - began, 3),
        out=str(out),
        set_aside=tuple(sorted(given_up, key=lambda found: found.number)),
    )


class _Tally:
    def __init__(self) -> None:
        self.outcomes: Counter[str] = Counter()
        self.causes: Counter[str] = Counter()

    def add(self, outcome: str, cause: str) -> None:
        self.outcomes[outcome] += 1
        if cause:
            self.causes[cause] += 1

    def note(self) -> str:
        return " ".join(f"{name} {count}" for name, count in sorted(self.outcomes.items()))


def _attempt(rollout: Rollout, seed: int, out: Path, number: int) -> tuple[str, str] | Bug:
    """What a worker does: one episode, or the bug in it. What a person or a full disk caused ends the run."""
    try:
        return run_and_log(rollout, seed, out, number)
    except (JengaError, OSError):
        raise
    except Exception as error:  # a bug in one episode shall not cost the others; it is shown at the end
        return Bug.of(error)


def run_and_log(rollout: Rollout, seed: int, out: Path, number: int) -> tuple[str, str]:
    """One episode into `OUT/<key>.mcap`: its outcome and cause.

    A process that is stopped leaves a .partial file, which the next run writes anew.
    """
    from jenga_data.log.writer import EpisodeWriter

    result = rollout(seed, number, lambda header, xml: EpisodeWriter(out / f"{header.key}.mcap", header, xml))
    return result.verdict.outcome.value, result.cause


def _ending(path: Path) -> tuple[str, str]:
    from jenga_data.log.reader import read_header

    _, result = read_header(path)
    if result is None:
        raise JengaError(f"{path} has no outcome; move it away and run the same command again")
    return result.verdict.outcome.value, result.cause


@contextmanager
def claimed(out: Path, config: CollectConfig, seed: int, actor: Actor) -> Iterator[None]:
    """Hold the folder for this process, and check that what it holds comes from the same recipe."""
    wanted = {"config": recipe(config, actor), "seed": seed, "checkpoint": actor.checkpoint}
    try:
        out.mkdir(parents=True, exist_ok=True)
        lock = FileLock(out / ".lock")
        with lock.acquire(timeout=0):
            _check_recipe(out / RECIPE, wanted)
            yield
    except Timeout:
        raise JengaError(f"another process collects into {out}; wait for it or choose another --out") from None
    except OSError as error:
        why = "the disk is full" if error.errno == errno.ENOSPC else os.strerror(error.errno or 0)
        raise JengaError(f"cannot write to {out}: {why}; finished episodes are kept") from None


def _check_recipe(path: Path, wanted: dict[str, object]) -> None:
    if path.exists():
        try:
            found = msgspec.json.decode(path.read_bytes())
            config_from_dict(found["config"])
        except (msgspec.DecodeError, KeyError, TypeError):
            raise JengaError(f"{path} is no recipe of a collection; choose another --out") from None
        except JengaError as error:
            raise JengaError(f"{path}: {error}; choose another --out") from None
        if found != msgspec.json.decode(msgspec.json.encode(wanted)):  # JSON has lists where a config has tuples
            raise JengaError(
                f"{path.parent} holds episodes of another configuration or seed (see {path.name}); choose another --out"
            )
        return
    partial_path = path.with_suffix(".json.partial")  # of a run that was stopped just then
    others = [p.name for p in path.parent.iterdir() if p.name not in (".lock", partial_path.name)]
    if others:
        raise JengaError(f"{path.parent} exists and is no collection (it holds {others[0]}); choose another --out")
    partial_path.write_bytes(msgspec.json.format(msgspec.json.encode(wanted, order="deterministic")))
    partial_path.rename(path)
