"""What the controller asks of a model of the tower, and two that answer: a learned one and the trivial one."""

from inspect import signature
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from jenga_data.collect.extraction import View
from jenga_data.sim.fingers import Fingers
from jenga_data.tower import TowerState


@runtime_checkable
class Dynamics(Protocol):
    """Predicts what becomes of a tower under many plans at once. Implement these two to plug in an own model."""

    def start(self, state: TowerState, target: int) -> None:
        """The tower now, its target turned along x; every rollout starts here until the next call."""
        ...

    def rollout(self, actions: Float[np.ndarray, "sample horizon 3"]) -> Float[np.ndarray, "sample horizon+1 block 7"]:
        """Poses in the world before the first action and after each, of every plan; actions are displacements [m]."""
        ...


def target_moves(
    pose: Float[np.ndarray, "*batch block 7"],
    action: Float[np.ndarray, "*batch 3"],
    target: Int[np.ndarray, "*#batch"],
) -> Float[np.ndarray, "*batch block 7"]:
    """The trivial prediction: the target moves by the action and keeps its rotation, nothing else moves."""
    moved = pose.copy()
    is_target = np.arange(pose.shape[-2]) == np.asarray(target)[..., None]
    moved[..., :3] += is_target[..., None] * action[..., None, :]
    return moved


class NothingMoves:
    """The trivial dynamics: every other block stays. With it the full objective is the naive one."""

    def start(self, state: TowerState, target: int) -> None:
        self._pose, self._target = state.pose.copy(), np.asarray(target)

    def rollout(self, actions: Float[np.ndarray, "sample horizon 3"]) -> Float[np.ndarray, "sample horizon+1 block 7"]:
        travelled = np.pad(np.cumsum(actions, axis=1), ((0, 0), (1, 0), (0, 0)))
        pose = np.broadcast_to(self._pose, (*travelled.shape[:2], *self._pose.shape))
        return target_moves(pose, travelled, self._target)


@runtime_checkable
class StepModel(Protocol):
    """Takes many samples of one tower a control step on; `jenga_models.predict.LearnedDynamics` is one."""

    device: torch.device

    def start(self, state: TowerState, target: int) -> None:
        """Fix the blocks, their topology and the target."""
        ...

    def step(
        self, pose: Float[Tensor, "sample block 7"], action: Float[Tensor, "sample 3"]
    ) -> Float[Tensor, "sample block 7"]:
        """Poses one control step later."""
        ...


@runtime_checkable
class PlanModel(Protocol):
    """A model that answers whole plans at once, all from the tower at `start`."""

    def rollout(self, actions: Float[Tensor, "sample horizon 3"]) -> Float[Tensor, "sample horizon+1 block 7"]:
        """Poses now and after each action of every plan [m]."""
        ...


class Learned:
    """A trained graph network simulator, all samples of a step in one forward pass.

    A model whose `start` takes `lag` is told how far the hand's set point is ahead of the target [m], counted from
    the grasp: how hard it is pulled at.
    """

    def __init__(self, model: StepModel) -> None:
        self._model = model
        self._takes_lag = "lag" in signature(model.start).parameters
        self._view: View | None = None

    def enter(self, view: View) -> None:
        """Look at the hand from now on."""
        self._view = view
        self._ahead = self._offset(view.recording.world.pose[view.recording.target])

    def start(self, state: TowerState, target: int, lag: Float[np.ndarray, "3"] | None = None) -> None:
        """`lag` is for who knows it without a hand to look at, such as from a log."""
        told = {}
        if self._takes_lag and lag is not None:
            told = {"lag": lag}
        elif self._takes_lag and self._view is not None:
            told = {"lag": self._offset(state.pose[target]) - self._ahead}
        self._model.start(state, target, **told)
        self._pose = state.pose.copy()

    def _offset(self, pose: Float[np.ndarray, "7"]) -> Float[np.ndarray, "3"]:
        """From the target to the hand's set point [m]."""
        hand = self._view.hand if self._view else None
        return hand.set_point - pose[:3] if isinstance(hand, Fingers) else np.zeros(3)

    def rollout(self, actions: Float[np.ndarray, "sample horizon 3"]) -> Float[np.ndarray, "sample horizon+1 block 7"]:
        samples, horizon, _ = actions.shape
        with torch.inference_mode():
            device = self._model.device
            if isinstance(self._model, PlanModel):
                plans = torch.as_tensor(actions, dtype=torch.float32, device=device)
                return self._model.rollout(plans).cpu().double().numpy()
            pose = torch.as_tensor(self._pose, dtype=torch.float32, device=device).expand(samples, -1, -1)
            plan = torch.as_tensor(actions, dtype=torch.float32, device=device)
            poses = [pose]
            for step in range(horizon):
                poses.append(self._model.step(poses[-1], plan[:, step]))
            return torch.stack(poses, dim=1).cpu().double().numpy()
