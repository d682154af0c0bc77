"""Evaluating the closed loop: the same towers and targets for every way to pull, read from the logs it leaves."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from jenga_control.cost import CostConfig
from jenga_control.extraction import CONTROLLERS, ClosedLoop
from jenga_control.mppi import mppi_preset
from jenga_data.collect.config import SEED_LIMIT, ExtractionConfig, episode_key
from jenga_data.collect.set_aside import refuse_missing
from jenga_data.collect.workers import run_episodes
from jenga_data.episode import EpisodeHeader, Result
from jenga_data.errors import JengaError
from jenga_data.log.reader import read_episode, read_header
from jenga_data.outcome import Outcome
from jenga_data.statistics import Proportion, paired_difference
from jenga_models.checkpoint import load

TIMED_DECISIONS = 20
EPISODE_TIMEOUT = 3600.0
"""Longest time for one closed loop [s], learned dynamics on a busy core included."""


def evaluate_extraction(
    model: Path | None,
    out: Path,
    controllers: Sequence[str] = ("full", "naive", "straight"),
    towers: int = 100,
    seed: int = SEED_LIMIT,
    workers: int = 2,
    preset: str = "best",
    config: ExtractionConfig | None = None,
) -> dict[str, Any]:
    """Pull the same random legal targets of `towers` towers with each controller; every rollout is logged in `out`.

    Every tower that was started is in the denominator. The report is that of the first controller, with the
    others under `baselines` and the paired difference to each.

    Raises:
        JengaError: no controller or one twice, one needs a model and none was given, or the folder holds
            something else.
        CheckFailed: a rollout had to be set aside.
    """
    if not controllers or len(set(controllers)) < len(controllers):
        given = ", ".join(controllers) or "none"
        raise JengaError(f"ways to pull: {given}; allowed: one or more of {', '.join(CONTROLLERS)}, each once")
    if seed < SEED_LIMIT:
        raise JengaError(f"seed is {seed}; evaluation uses seeds from {SEED_LIMIT} up, which no training data may have")
    loops = [_closed_loop(name, model, preset, config or ExtractionConfig()) for name in controllers]
    reports, rollouts = [], []
    for loop in loops:
        logs = out / loop.controller
        label = f"pulling, {loop.controller}"
        done = run_episodes(loop, loop.config, seed, range(towers), workers, logs, loop.actor, label, EPISODE_TIMEOUT)
        refuse_missing(logs, done.set_aside)  # a tower that is left out would spoil the comparison
        paths = [logs / f"{episode_key(loop.config, seed, number, loop.actor)}.mcap" for number in range(towers)]
        runs = [_ended(path) for path in paths]
        reports.append(_report(loop, runs, paths[0]))
        rollouts.append(runs)
    report, *others = reports
    successes = [np.array([result.verdict.outcome is Outcome.EXTRACTED for _, result in runs]) for runs in rollouts]
    blocks = np.array([header.blocks.tower for header, _ in rollouts[0]])
    for other, hits in zip(others, successes[1:], strict=True):
        other["paired"] = paired_difference(successes[0], hits, blocks)
    report["baselines"] = {loop.controller: other for loop, other in zip(loops[1:], others, strict=True)}
    return report


def _closed_loop(controller: str, model: Path | None, preset: str, config: ExtractionConfig) -> ClosedLoop:
    cost = CostConfig(objective="full" if controller == "full" else "naive")
    loop = ClosedLoop(config, controller, mppi_preset(preset), cost)
    if not cost.needs_dynamics:
        return loop
    if model is None:
        raise JengaError(
            "the objective 'full' needs a dynamics model: give one with --model, or choose --objective naive"
        )
    return replace(loop, model=model, model_hash=load(model).require("dynamics").hash)


def _ended(path: Path) -> tuple[EpisodeHeader, Result]:
    header, result = read_header(path)
    assert result is not None  # a rollout gets its name when it has ended
    return header, result


def _report(loop: ClosedLoop, runs: list[tuple[EpisodeHeader, Result]], first: Path) -> dict[str, Any]:
    verdicts = [result.verdict for _, result in runs]
    outcomes = Counter(verdict.outcome.value for verdict in verdicts)
    success = np.array([verdict.outcome is Outcome.EXTRACTED for verdict in verdicts])
    clean = success & ~np.array([verdict.dragged for verdict in verdicts])
    moved = [verdict.moved for verdict in verdicts if verdict.outcome is not Outcome.INVALID]
    causes = Counter(result.cause or result.verdict.outcome.value for _, result in runs if result.verdict.failure)
    return {
        "objective": loop.cost.objective if loop.controller != "straight" else f"straight pull, {loop.speed} m/s",
        "dynamics": "learned" if loop.cost.needs_dynamics else "none",
        "success": Proportion.of(success).as_dict(),
        "success_without_dragging": Proportion.of(clean).as_dict(),
        "outcomes": {outcome.value: outcomes[outcome.value] for outcome in Outcome},
        "causes": dict(sorted(causes.items())),
        "median_disturbance_mm": float(np.median(moved) * 1e3) if moved else None,
        "control_hz": _decision_rate(loop, first) if loop.controller != "straight" else None,
        "switches": {},
        "model": loop.actor.checkpoint,
        "logs": str(first.parent),
    }


def _decision_rate(loop: ClosedLoop, log: Path) -> float:
    """Decisions a second in this process, on the towers of a log, after one to warm up."""
    episode = read_episode(log)
    policy = loop.policy(np.random.default_rng(0))
    frames = episode.action_frame if len(episode.action_frame) else np.zeros(1, np.int64)
    policy.act(episode.tower_state(int(frames[0])), episode.header.target)
    began = perf_counter()
    for i in range(TIMED_DECISIONS):
        policy.act(episode.tower_state(int(frames[i % len(frames)])), episode.header.target)
    return TIMED_DECISIONS / (perf_counter() - began)
