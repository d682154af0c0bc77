"""The learned model fed as the paper composes: one graph object for each sample of each step, batched anew each time.

"The computational expense of composing graphs to input into the dynamics model remains a rate-limiting factor"
(section II-C). It is here to be measured, `jenga bench control`; `Learned` in dynamics.py does without.
"""

from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch_geometric.data import Batch, Data

from jenga_data.tower import TowerState
from jenga_models.columns import Towers
from jenga_models.features import raw_nodes
from jenga_models.predict import LearnedDynamics


class Composed:
    """Composes every graph by `jenga_data.graph`: nodes from the predicted poses, edges from what rests on what."""

    def __init__(self, model: LearnedDynamics) -> None:
        self._checkpoint, self._device = model.checkpoint, model.device

    def start(self, state: TowerState, target: int) -> None:
        self._state, self._target = state, target
        self._is_target = (torch.arange(len(state.blocks)) == target).float()

    def rollout(self, actions: Float[np.ndarray, "sample horizon 3"]) -> Float[np.ndarray, "sample horizon+1 block 7"]:
        pose = np.repeat(self._state.pose[None], len(actions), axis=0)  # torch warns of views that cannot be written
        poses = [pose]
        with torch.inference_mode():
            for step in range(actions.shape[1]):
                batch = self.compose(poses[-1], actions[:, step]).to(self._device)
                poses.append(self._advanced(batch, poses[-1]))
        return np.stack(poses, axis=1)

    def compose(self, pose: Float[np.ndarray, "sample block 7"], action: Float[np.ndarray, "sample 3"]) -> Any:
        """The graphs of one step as torch_geometric batches them: a `Batch`, whose attributes have no types."""
        return Batch.from_data_list([self._graph(p, a) for p, a in zip(pose, action, strict=True)])

    def _graph(self, pose: Float[np.ndarray, "block 7"], action: Float[np.ndarray, "3"]) -> Data:
        blocks, layout = self._state.blocks, self._state.layout
        tower = Towers.of_poses(
            blocks.size[None], blocks.mass[None], pose[None], layout.level[None], layout.slot[None],
            np.array([self._target]),
        )  # fmt: skip
        edges = torch.tensor(np.stack([tower.upper, tower.lower]))
        nodes = raw_nodes(self._checkpoint.spec, tower)[0]
        return Data(x=nodes, edge_index=edges, action=torch.tensor(action, dtype=torch.float32)[None])

    def _advanced(self, batch: Any, pose: Float[np.ndarray, "sample block 7"]) -> Float[np.ndarray, "sample block 7"]:
        samples, blocks, _ = pose.shape
        target: Tensor = batch.ptr[:-1] + self._target
        graphs = self._checkpoint.featurizer.to(self._device).graphs(
            batch.x, batch.edge_index[0], batch.edge_index[1], target, action=batch.action, graph=batch.batch
        )
        output = self._checkpoint.model(graphs).reshape(samples, blocks, -1)
        now = torch.as_tensor(pose, dtype=torch.float32, device=self._device)
        simulator = self._checkpoint.simulator.to(self._device)
        after = simulator.next_pose(now, output, batch.action[:, None], self._is_target.to(self._device))
        return after.cpu().double().numpy()
