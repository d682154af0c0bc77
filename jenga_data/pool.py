"""Work for several processes: an ordered way to start them, to replace one that died or hangs, and to stop."""

import ctypes
import math
import os
import signal
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import connection, get_context, parent_process, resource_tracker
from multiprocessing.process import BaseProcess
from threading import Thread
from time import monotonic, sleep
from typing import Generic, TypeVar

from jenga_data.errors import CheckFailed

Item = TypeVar("Item")
Out = TypeVar("Out")

TRIES = 2
"""How often an item is begun whose worker dies or hangs: a death is often the machine's doing, not the item's."""
_PR_SET_PDEATHSIG = 1
"""From Linux's sys/prctl.h."""


@dataclass(frozen=True)
class Failure:
    """How one try at an item ended: the reason in words, and when [s after it was begun]."""

    reason: str
    seconds: float


@dataclass(frozen=True)
class Lost:
    """An item that was given up, and how each of its `TRIES` ended."""

    tries: tuple[Failure, ...]


@dataclass
class _Task(Generic[Item, Out]):
    """An item that a worker has, in a pool of that one process."""

    item: Item
    failures: tuple[Failure, ...]
    pool: ProcessPoolExecutor
    process: BaseProcess
    future: Future[Out]
    began: float

    def failed(self, reason: str) -> tuple[Failure, ...]:
        return (*self.failures, Failure(reason, round(monotonic() - self.began, 3)))


def run_all(
    work: Callable[[Item], Out], items: Iterable[Item], workers: int, timeout: float = math.inf
) -> Iterator[tuple[Item, Out | Lost]]:
    """Each item with what `work` makes of it, as they are done.

    One worker is this process itself, which nobody replaces. With more, a worker that dies, or has an item for longer
    than `timeout` [s], is replaced; its item is tried once more, after all others, and then given up as `Lost`. What
    `work` raises is raised here and ends the work.
    """
    if workers == 1:
        for item in items:
            yield item, work(item)
        return
    # A pool of one process each. In a larger one (also in pebble and loky) workers share a queue and its lock: a death
    # breaks it for all, and with it the items of the others.
    fresh, again = iter(items), deque[tuple[Item, tuple[Failure, ...]]]()
    pools: list[ProcessPoolExecutor] = []
    running: list[_Task[Item, Out]] = []
    try:
        while True:
            while len(running) < workers and (due := _next(fresh, again)) is not None:
                running.append(_start(work, *due, pools, busy=[task.pool for task in running]))
            if not running:
                return
            wait([task.future for task in running], _patience(running, timeout), FIRST_COMPLETED)
            for task in [t for t in running if t.future.done() or monotonic() - t.began >= timeout]:
                running.remove(task)
                if (failures := _failures(task, timeout)) is None:
                    yield task.item, task.future.result()
                    continue
                stop_workers(task.pool)
                pools.remove(task.pool)
                if len(failures) < TRIES:
                    again.append((task.item, failures))
                else:
                    yield task.item, Lost(failures)
    finally:
        for pool in pools:
            stop_workers(pool)


def run_every(
    work: Callable[[Item], Out], items: Iterable[Item], workers: int, kept: str = ""
) -> Iterator[tuple[Item, Out]]:
    """As `run_all`, for who needs every item. `kept` says what is not lost if one cannot be had.

    Raises:
        CheckFailed: an item was given up.
    """
    for item, out in run_all(work, items, workers):
        if isinstance(out, Lost):
            raise CheckFailed(f"a task was given up: {out.tries[-1].reason}; {kept}run the same command again")
        yield item, out


def _next(
    fresh: Iterator[Item], again: deque[tuple[Item, tuple[Failure, ...]]]
) -> tuple[Item, tuple[Failure, ...]] | None:
    for item in fresh:
        return item, ()
    return again.popleft() if again else None


def _start(
    work: Callable[[Item], Out],
    item: Item,
    failures: tuple[Failure, ...],
    pools: list[ProcessPoolExecutor],
    busy: list[ProcessPoolExecutor],
) -> _Task[Item, Out]:
    """Hand an item to a worker of `pools` that is not busy, or to a new one, which joins them."""
    with interrupts_held():  # so that no pool is left out of the list
        while True:
            pool = next((pool for pool in pools if pool not in busy), None)
            if pool is None:
                pools.append(pool := new_pool(1))
            try:
                future = pool.submit(work, item)
            except BrokenProcessPool:  # it died while it had nothing to do
                stop_workers(pool)
                pools.remove(pool)
                continue
            (process,) = (pool._processes or {}).values()
            return _Task(item, failures, pool, process, future, monotonic())


def _patience(running: list[_Task[Item, Out]], timeout: float) -> float | None:
    if math.isinf(timeout):
        return None
    return max(min(task.began for task in running) + timeout - monotonic(), 0.0)


def _failures(task: _Task[Item, Out], timeout: float) -> tuple[Failure, ...] | None:
    """How all tries at an item ended, None where the work came to its own end."""
    if not task.future.done():
        return task.failed(f"no end after {timeout:g} s")
    if isinstance(task.future.exception(), BrokenProcessPool):
        return task.failed(f"its worker process died ({_death_of(task.process)})")
    return None


def _death_of(process: BaseProcess) -> str:
    end = monotonic() + 10.0
    while (code := process.exitcode) is None and monotonic() < end:
        sleep(0.01)  # no join: the executor's thread waits for it too, and only one of the two is told
    if code is not None and code < 0:
        name = signal.Signals(-code).name
        return f"{name}: out of memory, or killed" if name == "SIGKILL" else name
    return f"exit code {code}"


def new_pool(workers: int) -> ProcessPoolExecutor:
    """Fresh processes that end when this one does, however it ends: an orphan would go on writing what the next run
    writes too."""
    return ProcessPoolExecutor(workers, get_context("spawn"), _end_with_parent)


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    if sys.platform == "linux":
        # At once, also in the middle of a long call of a library that lets no other thread run.
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)

    def watch() -> None:
        connection.wait([parent.sentinel])
        os._exit(1)

    Thread(target=watch, daemon=True).start()


def stop_workers(pool: ProcessPoolExecutor) -> None:
    """End the workers at once, whatever they are at."""
    processes = list((pool._processes or {}).values())
    pool.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.kill()  # not SIGTERM: a process that is stopped does not hear it
    for process in processes:
        process.join()


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Ctrl-C reaches every process of the terminal; the parent alone decides what it means.

    A worker that starts here inherits the blocked signal, so that it is deaf while it still imports.
    """
    resource_tracker.ensure_running()  # when it starts it lets through again what is blocked here
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


__all__ = [
    "BrokenProcessPool",
    "Failure",
    "Lost",
    "interrupts_held",
    "new_pool",
    "run_all",
    "run_every",
    "stop_workers",
]
