"""How the outcome of a pull depends on its speed: the same towers and targets at every speed."""

from dataclasses import replace
from typing import Any

from jenga_data.calibrate.trial import described, judged_pull, tower_and_targets
from jenga_data.collect.config import SelectionConfig


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
