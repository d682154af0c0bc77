"""Whether sleep changes outcomes: labels with and without it, next to those of runs that start a micrometre apart."""

from collections import Counter
from functools import partial
from typing import Any

import numpy as np

from jenga_data.calibrate import figures
from jenga_data.calibrate.run import Run
from jenga_data.calibrate.trial import described, judged_pull, nudged, tower_and_targets
from jenga_data.collect.config import SelectionConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.report import markdown_table
from jenga_data.statistics import Proportion, paired_difference

NUDGE = 1e-6
"""[m]"""


def with_and_without(config: SelectionConfig, seed: int, number: int) -> dict[str, Any]:
    """One pull with sleep, without, without but from a start 1 um away, and the first once more."""
    _, (stage,) = tower_and_targets(config, seed, number, 1)
    near = nudged(stage, NUDGE, episode_rng(seed, number, "nudge"))
    asleep, awake = (judged_pull(config, stage, seed, 0, sleep) for sleep in (True, False))
    return described(stage) | {
        "asleep": asleep,
        "awake": awake,
        "nudged": judged_pull(config, near, seed, 0, sleep=False),
        "repeats": judged_pull(config, stage, seed, 0) == asleep,
    }


def sleep_report(run: Run, config: SelectionConfig) -> dict[str, Any]:
    """Compare labels with and without sleep, one pull a tower."""
    arguments = {"config": config, "seed": run.seed}
    results = run.cases("sleep", [(with_and_without, arguments | {"number": n}) for n in range(run.towers)])
    label = {name: np.array([r[name]["outcome"] for r in results]) for name in ("asleep", "awake", "nudged")}
    same = {name: label["awake"] == label[name] for name in ("asleep", "nudged")}
    tower = np.array([r["tower"] for r in results])
    report = {
        "asleep_as_awake": Proportion.of(same["asleep"]).as_dict(),
        "nudged_as_awake": Proportion.of(same["nudged"]).as_dict(),
        "difference": paired_difference(same["asleep"], same["nudged"], tower),
        "repeats_exactly": Proportion.of(np.array([r["repeats"] for r in results], bool)).as_dict(),
        "outcomes": {name: dict(sorted(Counter(values.tolist()).items())) for name, values in label.items()},
        "towers": run.towers,
        "seed": run.seed,
    }
    rows = [
        ("with sleep as without", report["asleep_as_awake"]),
        ("started 1 um apart as without", report["nudged_as_awake"]),
        ("same numbers to the last bit when repeated", report["repeats_exactly"]),
    ]
    text = markdown_table(("Outcome of a pull", "Share"), rows)
    return run.write("sleep", report, text, partial(figures.shares, {str(name): share for name, share in rows}))
