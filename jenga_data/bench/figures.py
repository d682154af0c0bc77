"""The figures of `jenga bench sim`, from what was measured."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from jenga_data.bench.crowd import Crowd
from jenga_data.bench.lockstep import Lockstep
from jenga_data.bench.speed import Speed
from jenga_data.bench.trace import EpisodeTrace
from jenga_data.sim.traced import Steps
from jenga_data.statistics import ratio_bootstrap, tower_bootstrap

EPISODES = 2000
"""Size of a dataset, for which times are told..."""
MINUTES = 100.0
"""...and which they must not exceed."""
AWAKE_LIMIT = 1.05
LOGGING_LIMIT = 0.05
WORKER_SHARE = 0.95
"""Each of several workers must give so much of one alone: two give 1.9 times as much."""


def figures(traces: Sequence[EpisodeTrace], pairs: Sequence[Lockstep], crowd: Crowd, step: float) -> dict[str, Speed]:
    """Every figure of the report; `step` is a physics step [s]."""
    return {
        "awake_step": _awake_step(pairs),
        "logging": logging_share(traces),
        "workers": _workers(crowd, 0, "wall clock"),
        "workers_cpu": _workers(crowd, 1, "CPU time, as if nothing else ran"),
        "selection_episodes": _episodes(crowd, 0, "wall clock"),
        "selection_episodes_cpu": _episodes(crowd, 1, "CPU time, as if nothing else ran"),
        "step_at_rest": _step([t.rest for t in traces], step, "awake, nothing done to the tower"),
        "step_while_pulling": _step([t.steps.part(t.steps_of("pull")) for t in traces], step, "while pulling"),
        "realtime": _realtime(traces, step),
        "spawn": _spawn(traces),
    }


def _awake_step(pairs: Sequence[Lockstep]) -> Speed:
    own, bare = (np.concatenate([getattr(pair, name) for pair in pairs]) for name in ("own", "bare"))
    tower = np.repeat(np.arange(len(pairs)), [len(pair.own) for pair in pairs])

    def ratio(rows: Int[np.ndarray, " row"]) -> float:
        return float(np.median(own[rows]) / np.median(bare[rows]))

    return Speed(
        "a step of an episode, beside a bare mj_step (medians)",
        value=1e3 * float(np.median(own)),
        unit="ms",
        reference=1e3 * float(np.median(bare)),
        n=len(pairs),
        ratio_ci95=tower_bootstrap(ratio, tower),
        limit=AWAKE_LIMIT,
        more={"steps": len(own), "overhead_us": 1e6 * float(np.median(own - bare))},
    )


def logging_share(traces: Sequence[EpisodeTrace]) -> Speed:
    log, whole = np.array([(t.logging, t.whole) for t in traces]).T
    return Speed(
        "the log's part of an episode, beside its whole",
        value=1e3 * float(log.mean()),
        unit="ms",
        reference=1e3 * float(whole.mean()),
        n=len(traces),
        ratio_ci95=ratio_bootstrap(log, whole, np.arange(len(traces))),
        limit=LOGGING_LIMIT,
        more={"percent": 100 * float(log.sum() / whole.sum())},
    )


def _workers(crowd: Crowd, clock: int, name: str) -> Speed:
    alone, together = crowd.alone[:, clock], crowd.together[:, :, clock].mean(1)
    workers = crowd.together.shape[1]
    return Speed(
        f"episodes of {workers} workers, beside one; {name}",
        value=60 * workers / float(together.mean()),
        unit="episodes/min",
        reference=60 / float(alone.mean()),
        n=len(alone),
        ratio_ci95=ratio_bootstrap(workers * alone, together, np.arange(len(alone))),
        limit=WORKER_SHARE * workers,
        at_least=True,
        more={"workers": workers, "start_up_seconds": crowd.start_up},
    )


def _episodes(crowd: Crowd, clock: int, name: str) -> Speed:
    seconds = crowd.together[:, :, clock].mean(1)
    workers = crowd.together.shape[1]
    minutes = EPISODES / workers / 60
    interval = ratio_bootstrap(seconds * minutes, np.ones(len(seconds)), np.arange(len(seconds)))
    return Speed(
        f"{EPISODES:,} episodes on {workers} workers, {name}",
        value=minutes * float(seconds.mean()),
        unit="min",
        reference=MINUTES,
        n=len(seconds),
        ci95=interval,
        limit=1.0,
        more={"seconds_an_episode": float(seconds.mean()), "episodes": EPISODES},
    )


def _step(steps: Sequence[Steps], step: float, name: str) -> Speed:
    seconds = np.concatenate([s.seconds for s in steps])
    tower = np.repeat(np.arange(len(steps)), [len(s.seconds) for s in steps])
    return Speed(
        f"a step {name}, beside the time it simulates (means)",
        value=1e3 * float(seconds.mean()),
        unit="ms",
        reference=1e3 * step,
        n=len(steps),
        ci95=ratio_bootstrap(1e3 * seconds, np.ones(len(seconds)), tower),
        more={"newton_iterations": float(np.concatenate([s.iterations for s in steps]).mean()), "steps": len(seconds)},
    )


def _realtime(traces: Sequence[EpisodeTrace], step: float) -> Speed:
    simulated, spent = np.array([(len(t.steps.seconds) * step, t.whole) for t in traces]).T
    return Speed(
        "simulated beside CPU time of a whole episode",
        value=float(simulated.sum() / spent.sum()),
        unit="s/s",
        reference=1.0,
        n=len(traces),
        ci95=ratio_bootstrap(simulated, spent, np.arange(len(traces))),
    )


def _spawn(traces: Sequence[EpisodeTrace]) -> Speed:
    spawn, whole = np.array([(t.spawn, t.whole) for t in traces]).T
    return Speed(
        "growing a tower and seeing it stand, beside the whole episode",
        value=float(spawn.mean()),
        unit="s",
        reference=float(whole.mean()),
        n=len(traces),
        ratio_ci95=ratio_bootstrap(spawn, whole, np.arange(len(traces))),
    )
