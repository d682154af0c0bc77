"""`jenga bench control`: decisions a second of our loop, of the loop that composes graphs, and of the simulator."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
import torch

from jenga_control.extraction.closed_loop import MPPIPolicy
from jenga_control.extraction.simulator import Simulated
from jenga_control.planning.composed import Composed
from jenga_control.planning.cost import CostConfig
from jenga_control.planning.dynamics import Dynamics, Learned
from jenga_control.planning.mppi import MPPIConfig, mppi_preset
from jenga_data.bench.speed import Speed, speed_table
from jenga_data.collect.branches import Trunk
from jenga_data.collect.config import SEED_LIMIT, ExtractionConfig
from jenga_data.collect.extraction import View
from jenga_data.errors import JengaError
from jenga_data.report import number
from jenga_models.predict import LearnedDynamics

DECISIONS_A_SECOND = 30.0
"""The paper's control frequency on its hardware, and what two CPU cores are to reach."""
COMPOSED_RATIO, SIMULATOR_RATIO = 5.0, 200.0
OURS, COMPOSED = 20, 2
"""Decisions that are timed on each tower, after one to warm up."""


@dataclass(frozen=True)
class Spent:
    """What a decision takes [s]: by the clock, and in CPU time of all threads, which other work hardly changes."""

    wall: float
    cpu: float

    def times(self, factor: float) -> "Spent":
        return Spent(self.wall * factor, self.cpu * factor)


@dataclass(frozen=True)
class Rates:
    """A decision on one tower at its grasp."""

    ours: Spent
    composed: Spent | None
    simulator: Spent
    edges_a_graph: float


class _Stopwatch:
    """Times decisions about one tower at its grasp."""

    def __init__(self, view: View, search: MPPIConfig) -> None:
        self._view, self._search = view, search
        self._state, self._target = view.recording.world.tower_state(), view.recording.target

    def rates(self, model: LearnedDynamics, simulator_samples: int, threads: int) -> Rates:
        composed = Composed(model)
        ours = self._seconds(Learned(model), OURS)
        try:
            slow = self._seconds(composed, COMPOSED)
        except JengaError:  # a model that takes no single steps
            slow = None
        more = self._search.samples / simulator_samples
        simulated = self._seconds(Simulated(threads), 1, simulator_samples).times(more)
        composed.start(self._state, self._target)
        graph = composed.compose(self._state.pose[None], np.zeros((1, 3)))
        return Rates(ours, slow, simulated, graph.edge_index.shape[1])

    def _seconds(self, dynamics: Dynamics, count: int, samples: int = 0) -> Spent:
        """A decision's time, over `count` of them after one to warm up; a single one is timed at once."""
        search = replace(self._search, samples=samples or self._search.samples)
        policy = MPPIPolicy(search, CostConfig(), dynamics, np.random.default_rng(0))
        policy.enter(self._view)
        if count > 1:
            policy.act(self._state, self._target)
        wall, cpu = perf_counter(), process_time()
        for _ in range(count):
            policy.act(self._state, self._target)
        return Spent(perf_counter() - wall, process_time() - cpu).times(1 / count)


def bench_control(
    model: Path,
    towers: int = 2,
    threads: int = 2,
    simulator_samples: int = 4,
    preset: str = "best",
    device: str = "cpu",
    config: ExtractionConfig | None = None,
) -> dict[str, Any]:
    """Decisions a second at the grasp of new towers, with all samples and steps of the preset's search.

    The simulator is given `simulator_samples` samples; its time is taken to grow with their number.

    Raises:
        JengaError: the checkpoint cannot be read or predicts no dynamics, or none of the towers was grasped.
    """
    if towers < 1 or threads < 1 or simulator_samples < 1:
        raise JengaError(
            f"towers is {towers}, threads is {threads}, simulator-samples is {simulator_samples}; allowed: 1 or more"
        )
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        opened = LearnedDynamics(model, device)
        config = config or ExtractionConfig(body="gripper")
        trunks = (Trunk(config, SEED_LIMIT, number) for number in range(towers))
        rates = [
            _Stopwatch(trunk.view, mppi_preset(preset)).rates(opened, simulator_samples, threads)
            for trunk in trunks
            if trunk.grasped
        ]
    finally:
        torch.set_num_threads(before)
    if not rates:
        raise JengaError(f"none of {towers} towers was grasped; give more --towers")
    return _report(rates, opened, mppi_preset(preset), threads, device, simulator_samples)


def _report(
    rates: Sequence[Rates], model: LearnedDynamics, search: MPPIConfig, threads: int, device: str, samples: int
) -> dict[str, Any]:
    spent = {
        name: [found for rate in rates if (found := getattr(rate, name)) is not None]
        for name in ("ours", "composed", "simulator")
    }
    mean = {name: float(np.mean([one.wall for one in found])) for name, found in spent.items() if found}
    ours, simulator = mean["ours"], mean["simulator"]
    where = f"{device}, {threads} threads"
    speeds = {
        "decisions": _speed(f"our loop, {where}, beside the paper's", ours, 1 / DECISIONS_A_SECOND, len(rates), 1.0),
        "against_simulator": _speed(
            "our loop beside the simulator as model", ours, simulator, len(rates), SIMULATOR_RATIO
        ),
    }
    if "composed" in mean:
        speeds["against_composed"] = _speed(
            "beside graphs composed for each sample and step", ours, mean["composed"], len(rates), COMPOSED_RATIO
        )
    settings = {
        "samples": search.samples,
        "horizon": search.horizon,
        "threads": threads,
        "device": device,
        "simulator_samples": samples,
        "model": model.checkpoint.hash,
        "cpu_ms": {name: 1e3 * float(np.mean([one.cpu for one in found])) for name, found in spent.items() if found},
        "edges_a_graph": float(np.mean([rate.edges_a_graph for rate in rates])),
    }
    text = speed_table(speeds) + (
        f"\nA decision: {search.samples} samples of {search.horizon} steps. The simulator was given {samples} samples, "
        f"its time multiplied by {search.samples / samples:g}. CPU time of a decision: "
        + ", ".join(f"{name} {number(value)} ms" for name, value in settings["cpu_ms"].items())
        + ".\n"
    )
    return {name: speed.as_dict() for name, speed in speeds.items()} | settings | {"text": text}


def _speed(what: str, seconds: float, reference: float, n: int, limit: float) -> Speed:
    return Speed(what, 1 / seconds, "decisions/s", 1 / reference, n, limit=limit, at_least=True)
