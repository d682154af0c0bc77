"""Work for several processes: an ordered way to start them, to hear of one that died, and to stop."""

import os
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import connection, get_context, parent_process
from threading import Thread
from typing import TypeVar

Item = TypeVar("Item")
Out = TypeVar("Out")


def run_all(work: Callable[[Item], Out], items: Iterable[Item], workers: int) -> Iterator[tuple[Item, Out]]:
    """Each item with what `work` makes of it, as they are done; one worker is this process itself.

    At most two items a worker are in the queue, so that an interrupt leaves little to wait for.

    Raises:
        BrokenProcessPool: a worker died.
    """
    if workers == 1:
        for item in items:
            yield item, work(item)
        return
    pool = new_pool(workers)
    queue, running = iter(items), dict[Future[Out], Item]()
    try:
        while True:
            for item in queue:
                with interrupts_held():
                    running[pool.submit(work, item)] = item
                if len(running) >= 2 * workers:
                    break
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                yield running.pop(future), future.result()
    finally:
        stop_workers(pool)


def new_pool(workers: int) -> ProcessPoolExecutor:
    """Fresh processes that end when this one does, however it ends: an orphan would go on writing what the next run
    writes too."""
    return ProcessPoolExecutor(workers, get_context("spawn"), _end_with_parent)


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        connection.wait([parent.sentinel])
        os._exit(1)

    Thread(target=watch, daemon=True).start()


def stop_workers(pool: ProcessPoolExecutor) -> None:
    """End the workers at once, whatever they are at."""
    processes = list((pool._processes or {}).values())
    pool.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.terminate()
    for process in processes:
        process.join()


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Ctrl-C reaches every process of the terminal; the parent alone decides what it means.

    A worker that starts here inherits the blocked signal, so that it is deaf while it still imports.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


__all__ = ["BrokenProcessPool", "interrupts_held", "new_pool", "run_all", "stop_workers"]
