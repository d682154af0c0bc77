"""Episodes on one worker and on several at once."""

from collections.abc import Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, perf_counter, process_time

import numpy as np
from jaxtyping import Float

from jenga_data.collect.workers import Rollout, run_and_log
from jenga_data.errors import JengaError
from jenga_data.pool import interrupts_held, new_pool, stop_workers
from jenga_data.progress import Bar


@dataclass(frozen=True, eq=False)
class Crowd:
    """Seconds of each episode, its start in a worker to its end there, by wall clock and by CPU time."""

    start_up: float
    """Until all workers were ready [s]."""
    alone: Float[np.ndarray, "episode 2"]
    together: Float[np.ndarray, "episode worker 2"]


def run_crowd(rollout: Rollout, seed: int, numbers: Sequence[int], workers: int, folder: Path, bar: Bar) -> Crowd:
    """Run each episode on one worker while the others idle, then on all of them at the same time.

    So all are busy for as long, no run waits for a straggler, and what else the machine does is spread over both.

    Raises:
        JengaError: a worker died.
    """
    # A pool of one process each: the executor's own queue would leave open which worker takes which task.
    pools = [new_pool(1) for _ in range(workers)]
    alone: list[tuple[float, float]] = []
    together: list[list[tuple[float, float]]] = []

    def start(worker: int, number: int) -> "Future[tuple[float, float]]":
        with interrupts_held():
            return pools[worker].submit(_timed_episode, rollout, seed, number, folder / f"worker-{worker}")

    try:
        began = monotonic()
        with interrupts_held():
            ready = [pool.submit(_get_ready, folder / f"worker-{worker}") for worker, pool in enumerate(pools)]
        for future in ready:
            future.result()
        start_up = monotonic() - began
        for number in numbers:
            alone.append(start(0, number).result())
            bar.advance(1)
            running = [start(worker, number) for worker in range(workers)]
            together.append([future.result() for future in running])
            bar.advance(1)
    except BrokenProcessPool:
        raise JengaError("a worker process died (out of memory, or killed); run the same command again") from None
    finally:
        for pool in pools:
            stop_workers(pool)
    return Crowd(start_up, np.array(alone), np.array(together))


def _get_ready(folder: Path) -> None:
    """Import what an episode needs, and make the worker's folder."""
    import jenga_data.collect.selection
    import jenga_data.log.writer  # noqa: F401  (imported so that no episode pays for it)

    folder.mkdir()


def _timed_episode(rollout: Rollout, seed: int, number: int, folder: Path) -> tuple[float, float]:
    wall, cpu = perf_counter(), process_time()
    run_and_log(rollout, seed, folder, number)
    return perf_counter() - wall, process_time() - cpu
