"""The plans that MPPI sampled in a logged episode, computed again: a log holds what was decided, not what else was
considered.

A decision is a function of the logged tower, of the episode's seed and number, and of the controller and checkpoint
that its log names, so that nothing more has to be stored. What comes out is compared with the logged actions.
"""

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float

from jenga_control.extraction.closed_loop import MPPIPolicy
from jenga_control.planning.cost import CostConfig
from jenga_control.planning.dynamics import Dynamics, Learned, NothingMoves, StepModel
from jenga_control.planning.mppi import MPPIConfig
from jenga_control.planning.mppi import Plan as Decision
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.extraction import executable
from jenga_data.episode import Episode
from jenga_data.replay.measures import MM, samples_at_frames
from jenga_data.replay.plans import Plans
from jenga_data.tower import TowerState
from jenga_models.checkpoint import Checkpoint
from jenga_models.predict import LearnedDynamics

_SAME = 1e-6
"""Actions that differ by less are the same but for rounding [m]."""


def sampled_plans(episode: Episode, checkpoints: Sequence[Checkpoint] = ()) -> Plans | None:
    """The plans of every decision, or why they are not known; None where no sampling controller acted.

    Args:
        checkpoints: those at hand; where the controller had a learned model, one of them must be the same.
    """
    settings = episode.header.config.get("controller") or {}
    if not isinstance(settings, dict) or "search" not in settings or not len(episode.action_frame):
        return None
    policy, why = _policy(episode, settings, checkpoints)
    if policy is None:
        return _unknown(why)
    decisions: list[Decision] = []
    worst, previous = 0.0, np.zeros(3)
    for row, frame in enumerate(episode.action_frame):
        policy.act(episode.tower_state(frame), episode.header.target)
        assert policy.decision is not None  # it has just acted
        decisions.append(policy.decision)
        done = executable(policy.decision.action, previous)
        worst = max(worst, float(np.abs(done - episode.action[row]).max()))
        previous = episode.action[row]
    if worst > _SAME:
        why = f"not shown: computed again, an action differs from the logged one by {worst * MM:.3g} mm"
        return _unknown(f"{why}, as with other versions of the libraries or of jenga")
    return Plans.of_displacements(
        episode.action_frame,
        _hand(episode),
        np.stack([decision.plans for decision in decisions]),
        np.stack([decision.mean for decision in decisions]),
        f"{len(decisions)} decisions over {decisions[0].plans.shape[0]} samples of {decisions[0].plans.shape[1]} "
        "steps, computed again from the log; they give the logged actions",
    )


def _policy(
    episode: Episode, settings: dict[str, Any], checkpoints: Sequence[Checkpoint]
) -> tuple[MPPIPolicy | None, str]:
    """The controller that acted, in the state in which it began, or why it cannot be had."""
    header = episode.header
    try:
        search = msgspec.convert(settings["search"], MPPIConfig)
        cost = msgspec.convert(settings["cost"], CostConfig)
    except (msgspec.ValidationError, KeyError) as error:
        return None, f"not shown: the log's controller is none of this version ({error})"
    if "touch" in settings:
        return None, "not shown: the pull heeds touch, and what that changed is not computed again"
    kind = settings.get("dynamics", "learned")
    if kind == "simulator" and cost.needs_dynamics:
        return None, "not shown: the simulator was the model, which takes minutes to ask again"
    dynamics: Dynamics | None = NothingMoves() if kind == "trivial" else None
    if cost.needs_dynamics and kind == "learned":
        own = next((c for c in checkpoints if c.hash == header.checkpoint), None)
        if own is None:
            return None, f"not shown: give the checkpoint that acted, {header.checkpoint[:12]}, with --model"
        dynamics = _ToldByLog(LearnedDynamics(own), episode.lag)
    return MPPIPolicy(search, cost, dynamics, episode_rng(header.seed, header.number, "controller")), ""


class _ToldByLog(Learned):
    """The model that acted, told of the hand what the log says before each action in turn."""

    def __init__(self, model: StepModel, lags: Float[np.ndarray, "action 3"]) -> None:
        super().__init__(model)
        self._lags = iter(lags)

    def start(self, state: TowerState, target: int, lag: Float[np.ndarray, "3"] | None = None) -> None:
        super().start(state, target, next(self._lags) if lag is None else lag)


def _hand(episode: Episode) -> np.ndarray:
    """Where the point between the fingertips was at each decision, or the target where there is no gripper [m]."""
    if not len(episode.gripper.time_ns):
        return episode.pose[episode.action_frame, episode.header.target, :3]
    return episode.gripper.pose[samples_at_frames(episode)[episode.action_frame], :3]


def _unknown(why: str) -> Plans:
    none = np.zeros(0, np.int64)
    return Plans(none, np.zeros((0, 1, 1, 3)), np.zeros((0, 1, 3)), why)
