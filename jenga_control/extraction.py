"""The closed loop: MPPI pulls a block on the simulator, with a learned model of the tower (paper, section II-C)."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float

from jenga_control.cost import CostConfig, plan_cost
from jenga_control.dynamics import Dynamics, Learned
from jenga_control.mppi import Controller, MPPIConfig
from jenga_data.collect.config import Actor, ExtractionConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.extraction import Policy, run_extraction
from jenga_data.collect.rollout import OpenLog
from jenga_data.episode import CONTROL_STEP_NS, Result
from jenga_data.errors import JengaError
from jenga_data.tower import TowerState

CONTROLLERS = ("full", "naive", "straight")
"""MPPI on O_a + O_d; MPPI on O_a alone, the paper's baseline; a straight pull at one speed, the trivial one."""


class MPPIPolicy:
    """Plans anew at every control step. Without dynamics, the objective must be one that looks at actions alone."""

    def __init__(
        self, search: MPPIConfig, cost: CostConfig, dynamics: Dynamics | None, rng: np.random.Generator
    ) -> None:
        if cost.needs_dynamics and dynamics is None:
            raise JengaError(f"the objective {cost.objective!r} needs a dynamics model; give one with --model")
        self._controller = Controller(search, rng)
        self._cost = cost
        self._dynamics = dynamics if cost.needs_dynamics else None
        self._set_point: Float[np.ndarray, 3] | None = None

    def act(self, state: TowerState, target: int) -> Float[np.ndarray, "3"]:
        dynamics = self._dynamics
        if dynamics is not None:
            dynamics.start(state, target, self._lag(state.pose[target, :3]))

        def rollout(plans: Float[np.ndarray, "sample horizon 3"]) -> Float[np.ndarray, " sample"]:
            poses = dynamics.rollout(plans) if dynamics is not None else None
            return plan_cost(plans, poses, target, self._cost)

        action = self._controller.plan(rollout).action
        if self._set_point is not None:
            self._set_point = self._set_point + action
        return action

    def _lag(self, held: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """How far the set point is ahead of what the hand holds, from where it was held at the first decision [m]."""
        if self._set_point is None:
            self._set_point = held.copy()
        return self._set_point - held


class StraightPull:
    """The same displacement along -x at every control step."""

    def __init__(self, speed: float) -> None:
        self._action = np.array([-speed * CONTROL_STEP_NS * 1e-9, 0.0, 0.0])

    def act(self, state: TowerState, target: int) -> Float[np.ndarray, "3"]:
        return self._action


@dataclass(frozen=True)
class ClosedLoop:
    """One way to pull, as a rollout that a worker process can run: it holds settings, and opens its model there."""

    config: ExtractionConfig
    controller: str
    search: MPPIConfig
    cost: CostConfig
    model: Path | None = None
    model_hash: str = ""
    speed: float = 0.15
    """Of the straight pull [m/s]."""
    threads: int = 1

    def __post_init__(self) -> None:
        if self.controller not in CONTROLLERS:
            raise JengaError(f"unknown controller {self.controller!r}; allowed: {', '.join(CONTROLLERS)}")

    @property
    def actor(self) -> Actor:
        """Who acts, for the key of the episode and its log."""
        if self.controller == "straight":
            return Actor({"name": "straight", "speed": self.speed})
        settings: dict[str, Any] = {
            "name": self.controller,
            "search": msgspec.to_builtins(self.search),
            "cost": msgspec.to_builtins(self.cost),
        }
        return Actor(settings, self.model_hash if self.cost.needs_dynamics else "")

    def policy(self, rng: np.random.Generator) -> Policy:
        """A fresh policy for one rollout."""
        if self.controller == "straight":
            return StraightPull(self.speed)
        dynamics = None
        if self.cost.needs_dynamics and self.model is not None:
            dynamics = Learned(_opened(self.model, self.threads))
        return MPPIPolicy(self.search, self.cost, dynamics, rng)

    def __call__(self, seed: int, number: int, open_log: OpenLog) -> Result:
        policy = self.policy(episode_rng(seed, number, "controller"))
        return run_extraction(self.config, seed, number, open_log, policy, self.actor)


@lru_cache(maxsize=1)
def _opened(model: Path, threads: int):
    import torch

    from jenga_models.predict import LearnedDynamics

    torch.set_num_threads(threads)
    return LearnedDynamics(model)
