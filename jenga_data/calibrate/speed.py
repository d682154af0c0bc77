"""How the outcome of a pull depends on its speed: the same towers and targets at every speed."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from jenga_data.calibrate import figures
from jenga_data.calibrate.run import Run
from jenga_data.calibrate.trial import described, judged_pull, tower_and_targets
from jenga_data.collect.config import SelectionConfig
from jenga_data.errors import JengaError
from jenga_data.report import markdown_table
from jenga_data.statistics import proportion_over_towers


def pulls_at_speeds(config: SelectionConfig, seed: int, number: int, speeds: list[float]) -> dict[str, Any]:
    """One legal target of one tower, pulled at each speed [m/s] from the same state."""
    _, (stage,) = tower_and_targets(config, seed, number, 1)
    results = [judged_pull(_at(config, speed), stage, seed, 0) for speed in speeds]
    return described(stage) | {"pulls": results}


def _at(config: SelectionConfig, speed: float) -> SelectionConfig:
    """The servo at another speed; it may take as long for the same way, and be as patient on it."""
    slower = config.speed / speed
    return replace(
        config, speed=speed, pull_seconds=config.pull_seconds * slower, patience=config.patience * max(1.0, slower)
    )


def speed_report(run: Run, config: SelectionConfig, speeds: Sequence[float]) -> dict[str, Any]:
    """Pull the same targets at several speeds [m/s].

    Raises:
        JengaError: no speed, or one that is not positive and finite.
    """
    if not speeds or not all(0 < speed < math.inf for speed in speeds):
        raise JengaError(
            f"speeds are {', '.join(map(str, speeds)) or 'none'}; allowed: one or more, all positive [m/s]"
        )
    speeds = sorted(set(speeds))
    arguments = {"config": config, "seed": run.seed, "speeds": speeds}
    results = run.cases("speed", [(pulls_at_speeds, arguments | {"number": n}) for n in range(run.towers)])
    tower = np.array([r["tower"] for r in results])
    by_speed = {}
    for i, value in enumerate(speeds):
        pulls = [r["pulls"][i] for r in results]
        by_speed[str(value)] = {
            "failure": proportion_over_towers(np.array([p["failure"] for p in pulls], bool), tower),
            "strict_failure": proportion_over_towers(np.array([p["strict_failure"] for p in pulls], bool), tower),
            "outcomes": dict(sorted(Counter(p["outcome"] for p in pulls).items())),
        }
    report = {"speeds": by_speed, "towers": run.towers, "seed": run.seed, "force_limit_n": config.force_limit}
    rows = [
        (v, s["failure"], s["strict_failure"], *(s["outcomes"].get(o, 0) for o in ("stuck", "collapsed")))
        for v, s in by_speed.items()
    ]
    text = markdown_table(("Speed [m/s]", "Failure", "Strict failure", "Stuck", "Collapsed"), rows)
    return run.write("speed", report, text, partial(figures.speed, by_speed))
