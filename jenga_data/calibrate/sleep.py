"""Whether sleep changes outcomes: labels with and without it, next to those of runs that start a micrometre apart."""

from typing import Any

from jenga_data.calibrate.trial import described, judged_pull, nudged, tower_and_targets
from jenga_data.collect.config import SelectionConfig
from jenga_data.collect.draws import episode_rng

NUDGE = 1e-6
"""[m]"""


def with_and_without(config: SelectionConfig, seed: int, number: int) -> dict[str, Any]:
    """One pull with sleep, without, without but from a start 1 um away, and the first two once more."""
    _, (stage,) = tower_and_targets(config, seed, number, 1)
    near = nudged(stage, NUDGE, episode_rng(seed, number, "nudge"))
    asleep, awake = (judged_pull(config, stage, seed, 0, sleep) for sleep in (True, False))
    return described(stage) | {
        "asleep": asleep,
        "awake": awake,
        "nudged": judged_pull(config, near, seed, 0, sleep=False),
        "repeats": judged_pull(config, stage, seed, 0) == asleep,
    }
