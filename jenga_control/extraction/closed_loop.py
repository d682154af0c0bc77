"""The closed loop: MPPI pulls a block on the simulator, with a model of the tower (paper, section II-C)."""

from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from jenga_control.extraction.touch import CarefulTouch, TouchConfig
from jenga_control.planning.cost import CostConfig, plan_cost
from jenga_control.planning.dynamics import Dynamics, Learned, NothingMoves
from jenga_control.planning.mppi import Controller, MPPIConfig, Plan
from jenga_data.collect.branches import Branch, Trunk
from jenga_data.collect.config import Actor, ExtractionConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.extraction import Onlooker, Policy, View, run_extraction
from jenga_data.collect.rollout import OpenLog
from jenga_data.episode import CONTROL_STEP_NS, Result
from jenga_data.errors import JengaError
from jenga_data.tower import TowerState

CONTROLLERS = ("full", "naive", "straight")
"""MPPI on O_a + O_d; MPPI on O_a alone, the paper's baseline; a straight pull at one speed, the trivial one."""

DYNAMICS = ("learned", "simulator", "trivial")
"""What predicts the tower for O_d: a checkpoint; MuJoCo itself; or the target moves by the action, nothing else."""


class MPPIPolicy:
    """Plans anew at every control step. Without dynamics, the objective must be one that looks at actions alone.

    `wanted` is the last plan's first action before it was put on the executed limits.
    """

    def __init__(
        self, search: MPPIConfig, cost: CostConfig, dynamics: Dynamics | None, rng: np.random.Generator
    ) -> None:
        if cost.needs_dynamics and dynamics is None:
            raise JengaError(f"the objective {cost.objective!r} needs a dynamics model; give one with --model")
        self._controller = Controller(search, rng)
        self._cost = cost
        self._dynamics = dynamics if cost.needs_dynamics else None
        self.decision: Plan | None = None
        """The last one, with all that was considered."""
        self.wanted = np.zeros(3)

    def enter(self, view: View) -> None:
        """Show the running world to dynamics that need more than poses."""
        if isinstance(self._dynamics, Onlooker):
            self._dynamics.enter(view)

    def act(self, state: TowerState, target: int) -> Float[np.ndarray, "3"]:
        dynamics = self._dynamics
        if dynamics is not None:
            dynamics.start(state, target)

        def rollout(plans: Float[np.ndarray, "sample horizon 3"]) -> Float[np.ndarray, " sample"]:
            poses = dynamics.rollout(plans) if dynamics is not None else None
            return plan_cost(plans, poses, target, self._cost)

        self.decision = self._controller.plan(rollout)
        self.wanted = self.decision.unclipped
        return self.decision.action


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
    dynamics: str = "learned"
    touch: TouchConfig | None = None
    """How the pull heeds what the fingers feel, None if it does not."""

    def __post_init__(self) -> None:
        for name, allowed in (("controller", CONTROLLERS), ("dynamics", DYNAMICS)):
            if (value := getattr(self, name)) not in allowed:
                raise JengaError(f"unknown {name} {value!r}; allowed: {', '.join(allowed)}")

    @property
    def model_name(self) -> str:
        """What predicts the tower; "none" where nobody asks."""
        return self.dynamics if self.controller != "straight" and self.cost.needs_dynamics else "none"

    @property
    def actor(self) -> Actor:
        """Who acts, for the key of the episode and its log."""
        felt = {} if self.touch is None else {"touch": asdict(self.touch)}
        if self.controller == "straight":
            return Actor({"name": "straight", "speed": self.speed, **felt})
        settings: dict[str, Any] = {"name": self.controller, "search": asdict(self.search), "cost": asdict(self.cost)}
        if self.model_name not in ("none", "learned"):
            settings["dynamics"] = self.dynamics
        return Actor(settings | felt, self.model_hash if self.model_name == "learned" else "")

    def policy(self, rng: np.random.Generator) -> Policy:
        """A fresh policy for one rollout."""
        pull = StraightPull(self.speed) if self.controller == "straight" else self._mppi(rng)
        return pull if self.touch is None else CarefulTouch(pull, self.touch)

    def _mppi(self, rng: np.random.Generator) -> MPPIPolicy:
        dynamics = None
        if self.model_name == "simulator":
            from jenga_control.extraction.simulator import Simulated

            dynamics = Simulated(self.threads)
        elif self.model_name == "trivial":
            dynamics = NothingMoves()
        elif self.model_name == "learned" and self.model is not None:
            dynamics = Learned(_opened(self.model, self.threads))
        return MPPIPolicy(self.search, self.cost, dynamics, rng)

    def __call__(self, seed: int, number: int, open_log: OpenLog) -> Result:
        """The whole rollout by itself."""
        policy = self.policy(episode_rng(seed, number, "controller"))
        return run_extraction(self.config, seed, number, open_log, policy, self.actor)

    def pull(self, trunk: Trunk) -> Branch:
        """The same rollout from the grasp on, with what comes before it shared."""
        return trunk.branch(self.policy(episode_rng(trunk.seed, trunk.number, "controller")))


@lru_cache(maxsize=4)
def _opened(model: Path, threads: int):
    import torch

    from jenga_models.predict import LearnedDynamics

    torch.set_num_threads(threads)
    return LearnedDynamics(model)
