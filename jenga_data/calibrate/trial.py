"""Pulls for a calibration: many from the same tower, judged but not logged."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from jenga_data.collect.config import SelectionConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.recording import Recorder
from jenga_data.collect.selection import pull
from jenga_data.collect.stage import Stage, standing_tower
from jenga_data.episode import Action, Frame, GripperSample, Phase, Result
from jenga_data.tower import TowerState


class Unlogged:
    """A recorder that keeps nothing."""

    def frame(self, frame: Frame) -> None:
        pass

    def action(self, action: Action) -> None:
        pass

    def gripper(self, sample: GripperSample) -> None:
        pass

    def phase(self, phase: Phase) -> None:
        pass

    def finish(self, result: Result) -> None:
        pass


@contextmanager
def unlogged(_: str) -> Iterator[Recorder]:
    """In place of a log, for `selection.pull`."""
    yield Unlogged()


def tower_and_targets(config: SelectionConfig, seed: int, number: int, count: int) -> tuple[TowerState, list[Stage]]:
    """A standing tower of a random round, and `count` of its legal targets with their faces (fewer if it has fewer)."""
    spawn = config.spawn
    round_number = int(episode_rng(seed, number, "round").integers(spawn.first_round, spawn.last_round + 1))
    rng, name = episode_rng(seed, number, "tower"), f"seed {seed}, number {number}"
    state, tries = standing_tower(spawn, config.physics, round_number, rng, name=name)
    choice = episode_rng(seed, number, "target")
    legal = state.layout.legal_targets()
    targets = choice.choice(legal, min(count, len(legal)), replace=False)
    return state, [Stage.of(state, int(target), int(choice.integers(2)), tries) for target in targets]


def judged_pull(config: SelectionConfig, stage: Stage, seed: int, repeat: int, sleep: bool = True) -> dict[str, Any]:
    """The verdict of one pull as plain values; `repeat` decides the noise. `moved` [m] is None for an invalid one."""
    noise = episode_rng(seed, repeat, f"noise {stage.target}")
    verdict = pull(config, stage, noise, unlogged, sleep, aftermath=0.0).verdict
    return {
        "outcome": verdict.outcome.value,
        "failure": verdict.failure,
        "strict_failure": verdict.strict_failure,
        "moved": None if math.isnan(verdict.moved) else verdict.moved,
    }


def nudged(stage: Stage, distance: float, rng: np.random.Generator) -> Stage:
    """The stage with every block displaced by a normal deviate of `distance` [m] along each axis."""
    pose = stage.state.pose.copy()
    pose[:, :3] += rng.normal(0.0, distance, (len(pose), 3))
    return replace(stage, state=replace(stage.state, pose=pose))


def described(stage: Stage) -> dict[str, Any]:
    """What a report groups pulls by."""
    place = stage.layout.place(stage.target)
    return {"tower": stage.blocks.tower, "round": stage.layout.round, "level": place.level, "slot": place.slot}
