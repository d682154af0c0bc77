"""`jenga bench sim`: what an episode costs, and how much of that is physics."""

import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from jenga_data.bench.crowd import run_crowd
from jenga_data.bench.figures import figures
from jenga_data.bench.lockstep import lockstep
from jenga_data.bench.plot import step_plot
from jenga_data.bench.speed import Speed, speed_table
from jenga_data.bench.trace import EpisodeTrace, trace_episode
from jenga_data.collect.config import SelectionConfig, check_seed, recipe
from jenga_data.collect.rollout import provenance
from jenga_data.collect.workers import Rollout, run_one
from jenga_data.errors import JengaError
from jenga_data.progress import progress
from jenga_data.report import make_folder, markdown_table, write_report


def bench_sim(
    config: SelectionConfig, towers: int, seed: int, workers: int, out: Path, rollout: Rollout | None = None
) -> dict[str, Any]:
    """Run selection episodes 0 to `towers` - 1 and write `bench-sim.json`, `.md` and `.png` into `out`.

    Args:
        rollout: what the workers run, by default episodes of `config`.

    Returns:
        The report, and as `text` its tables.

    Raises:
        JengaError: a count or seed that is not allowed, a worker that died, a folder that cannot be written.
    """
    if towers < 1 or workers < 1:
        raise JengaError(f"towers is {towers} and workers is {workers}; both must be at least 1, such as 8 and 2")
    check_seed(seed)
    make_folder(out)
    load = os.getloadavg()[0]
    with TemporaryDirectory() as name, progress("measuring episodes", 4 * towers) as bar:
        folder = Path(name)
        traces, pairs = [], []
        for number in range(towers):
            traces.append(trace_episode(config, seed, number, folder))
            bar.advance(1)
            pairs.append(lockstep(config, seed, number, traces[-1]))
            bar.advance(1)
        crowd = run_crowd(rollout or partial(run_one, config), seed, range(towers), workers, folder, bar)
    speeds = figures(traces, pairs, crowd, config.physics.timestep_ns * 1e-9)
    report = {name: speed.as_dict() for name, speed in speeds.items()} | {
        "shares": shares(traces),
        "towers": towers,
        "seed": seed,
        "cores": os.cpu_count(),
        "load_before": load,
        "same_states": all(pair.same for pair in pairs),
        "config": recipe(config),
        "provenance": provenance(),
        "out": str(out),
    }
    text = tables(speeds, report)
    write_report(out, "bench-sim", report, text)
    step_plot(traces, config.physics.timestep_ns * 1e-9, out / "bench-sim.png")
    return report | {"text": text}


def shares(traces: Sequence[EpisodeTrace]) -> dict[str, float]:
    """Parts of an episode's CPU time: spawning, physics steps of pull and observation, log, and all else."""
    whole = sum(t.whole for t in traces)
    parts = {
        "spawn": sum(t.spawn for t in traces) / whole,
        "steps": sum(float(t.steps.seconds.sum()) for t in traces) / whole,
        "logging": sum(t.logging for t in traces) / whole,
    }
    return parts | {"rest": 1 - sum(parts.values())}


def tables(speeds: dict[str, Speed], report: dict[str, Any]) -> str:
    """The report in Markdown."""
    parts = [(name, f"{100 * share:.1f} %") for name, share in report["shares"].items()]
    setting = (
        f"{report['towers']} episodes, seed {report['seed']}, {report['workers']['workers']} workers on "
        f"{report['cores']} cores (load before: {report['load_before']:.1f}). Intervals: 95 %, over episodes. "
        "Ratios are what counts: other work on the machine changes times.\n"
    )
    part_table = markdown_table(("part of an episode", "CPU time"), parts)
    return "\n".join(["# jenga bench sim\n", setting, speed_table(speeds), part_table])
