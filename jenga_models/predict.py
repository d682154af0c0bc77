"""Trained models on live towers: which pulls fail, and what becomes of a tower under 100 actions at once."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from jenga_data.errors import JengaError
from jenga_data.tower import TowerState
from jenga_models.ahead import poses_after
from jenga_models.checkpoint import Checkpoint, Kind, load
from jenga_models.columns import Towers
from jenga_models.factored import Factored
from jenga_models.features import feature_slices, raw_nodes
from jenga_models.sweep import SweepClassifier


def opened(checkpoint: Checkpoint | Path | str, kind: Kind) -> Checkpoint:
    """A checkpoint of that kind, read from its folder if it is not at hand.

    Raises:
        JengaError: it cannot be read, or is of the other kind.
    """
    return (checkpoint if isinstance(checkpoint, Checkpoint) else load(checkpoint)).require(kind)


CPU_SAMPLES = 25
"""Samples a forward pass on a CPU: the messages of more do not fit its cache, and take up to twice as long each."""


@contextmanager
def one_thread() -> Iterator[None]:
    """For products so small that threads wait for each other longer than they work."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


class Selector:
    """Says how likely pulling a block ends in a failure, for all blocks of a tower in one forward pass."""

    def __init__(self, checkpoint: Checkpoint | Path | str) -> None:
        self.checkpoint = opened(checkpoint, "selection")

    def failure_probability(self, state: TowerState, targets: Sequence[int]) -> Float[np.ndarray, " target"]:
        """Probability of a failure of pulling each target from the same tower, in the order of `targets`.

        Raises:
            JengaError: a target is no block of the tower.
        """
        unknown = [target for target in targets if not 0 <= target < len(state.blocks)]
        if unknown:
            raise JengaError(f"no block {unknown[0]} in a tower of {len(state.blocks)}, numbered from 0")
        if not len(targets):
            return np.zeros(0)
        featurizer, model = self.checkpoint.featurizer, self.checkpoint.model
        towers = Towers.of_state(state, np.asarray(targets))
        one = slice(0, towers.offset[1])
        node = raw_nodes(featurizer.spec, towers)
        if isinstance(model, SweepClassifier) and "block_pose" not in featurizer.spec.node_features:
            node = node[:1]  # nothing that it looks at differs between targets
        graphs = featurizer.graphs(
            node,
            torch.tensor(towers.upper[one]),
            torch.tensor(towers.lower[one]),
            target=torch.tensor(towers.target),
        )
        with torch.inference_mode(), one_thread():
            return model(graphs).double().softmax(-1)[:, 1].numpy()


class LearnedDynamics:
    """A simulator for one decision at a time: one topology, then any number of steps of many samples.

    The support graph is that of the tower at `start`; samples share it for the whole horizon (a few centimetres
    of motion change little of what rests on what), so that no graph is composed between two steps.
    """

    def __init__(self, checkpoint: Checkpoint | Path | str, device: str | torch.device = "cpu") -> None:
        self.checkpoint = opened(checkpoint, "dynamics")
        self.device = torch.device(device)
        self._model = self.checkpoint.model.to(self.device)
        self._featurizer = self.checkpoint.featurizer.to(self.device)
        self._simulator = self.checkpoint.simulator.to(self.device)
        self._pose_columns = feature_slices(self.checkpoint.spec).get("block_pose")

    def start(self, state: TowerState, target: int, lag: Float[np.ndarray, "3"] | None = None) -> None:
        """Fix the blocks, the topology and the target; the tower is turned so that its target lies along x.

        `lag` is how far the hand's set point is ahead of the hand [m], for models that ask for it.

        Raises:
            JengaError: the target is no block of the tower.
        """
        blocks = len(state.blocks)
        if not 0 <= target < blocks:
            raise JengaError(f"no block {target} in a tower of {blocks}, numbered from 0")
        towers = Towers.of_poses(
            state.blocks.size[None],
            state.blocks.mass[None],
            state.pose[None],
            state.layout.level[None],
            state.layout.slot[None],
            np.array([target]),
            twist=state.twist[None],
        )
        self._node = raw_nodes(self.checkpoint.spec, towers)[0].to(self.device)
        self._upper, self._lower = (torch.tensor(end, device=self.device) for end in (towers.upper, towers.lower))
        self._target = torch.tensor([target], device=self.device)
        self._is_target = (torch.arange(blocks, device=self.device) == target).float()
        self._pose = torch.tensor(state.pose, dtype=torch.float32, device=self.device)
        if isinstance(self._model, Factored):
            behind = torch.zeros(1, 3) if lag is None else torch.tensor(lag, dtype=torch.float32)[None]
            graphs = self._featurizer.graphs(
                self._node[None], self._upper, self._lower, self._target, lag=behind.to(self.device)
            )
            with torch.inference_mode():
                self._look = self._model.look(graphs)

    def rollout(self, actions: Float[Tensor, "sample horizon 3"]) -> Float[Tensor, "sample horizon+1 block 7"]:
        """Poses now and after each action of every plan, all from the tower at `start` [m]."""
        now = self._pose.expand(len(actions), -1, -1)
        if not isinstance(self._model, Factored):
            poses = [now]
            for step in range(actions.shape[1]):
                poses.append(self.step(poses[-1], actions[:, step]))
            return torch.stack(poses, dim=1)
        with torch.inference_mode():
            motion, _ = self._model.answers(self._look, actions, None)
            return torch.cat([now[:, None], poses_after(self._pose, motion)], dim=1)

    def step(
        self, pose: Float[Tensor, "sample block 7"], action: Float[Tensor, "sample 3"]
    ) -> Float[Tensor, "sample block 7"]:
        """Poses one control step later, for each sample its own poses [m] and displacement of the gripper [m].

        Raises:
            JengaError: the model answers whole plans, see `rollout`.
        """
        if isinstance(self._model, Factored):
            raise JengaError(f"{self.checkpoint.path} answers whole plans and takes no single steps; use rollout")
        if self.device.type == "cpu" and len(pose) > CPU_SAMPLES:
            parts = zip(pose.split(CPU_SAMPLES), action.split(CPU_SAMPLES), strict=True)
            return torch.cat([self.step(*part) for part in parts])
        samples = len(pose)
        node = self._node.expand(samples, -1, -1)
        if self._pose_columns is not None:
            node = node.clone()
            node[..., self._pose_columns] = pose
        target = self._target.expand(samples)
        graphs = self._featurizer.graphs(node, self._upper, self._lower, target, action=action)
        with torch.inference_mode():
            output = self._model(graphs)
            return self._simulator.next_pose(pose, output, action[:, None, :], self._is_target)
