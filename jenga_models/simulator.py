"""Between poses and what the network says: displacements, their scaling, and the step V_t+1 = V_t + dV.

Paper, section II-C. All functions take tensors with any leading axes; poses are x y z [m] and a wxyz quaternion.
"""

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from jenga_models.normalisation import Normalisation


def displacement(pose: Float[Tensor, "*batch 7"], next_pose: Float[Tensor, "*batch 7"]) -> Float[Tensor, "*batch 7"]:
    """next_pose - pose, with the sign of the next quaternion chosen nearest to the present one.

    q and -q are one rotation: without the choice, a difference of nearly 2 can stand for no motion at all.
    """
    same_side = (pose[..., 3:] * next_pose[..., 3:]).sum(-1, keepdim=True) >= 0
    aligned = torch.where(same_side, next_pose[..., 3:], -next_pose[..., 3:])
    return torch.cat([next_pose[..., :3] - pose[..., :3], aligned - pose[..., 3:]], dim=-1)


def displaced(pose: Float[Tensor, "*batch 7"], delta: Float[Tensor, "*batch 7"]) -> Float[Tensor, "*batch 7"]:
    """pose + delta, with the quaternion brought back to length 1."""
    moved = pose + delta
    return torch.cat([moved[..., :3], torch.nn.functional.normalize(moved[..., 3:], dim=-1)], dim=-1)


@dataclass(frozen=True, eq=False)
class Simulator:
    """What a network's output means: a displacement in units of its scale, one scale for the target and one for
    all others, on top of the trivial displacement if `residual` (the target moves by the action, nothing else).

    `is_target` is 1 at the target and 0 elsewhere, `action` the displacement of the gripper [m] at each node.
    """

    mean: Float[Tensor, "role 7"]
    scale: Float[Tensor, "role 7"]
    residual: bool

    @classmethod
    def of(cls, normalisation: Normalisation, residual: bool) -> "Simulator":
        return cls(normalisation.delta_mean, normalisation.delta_scale, residual)

    def to(self, device: Any) -> "Simulator":
        return Simulator(self.mean.to(device), self.scale.to(device), self.residual)

    def _origin(self, action: Tensor, is_target: Tensor) -> Tensor:
        """The displacement that an output of 0 stands for."""
        origin = torch.where(is_target[..., None] > 0, self.mean[1], self.mean[0])
        if not self.residual:
            return origin
        return origin + torch.nn.functional.pad(is_target[..., None] * action, (0, 4))

    def _unit(self, is_target: Tensor) -> Tensor:
        return torch.where(is_target[..., None] > 0, self.scale[1], self.scale[0])

    def output_for(
        self,
        pose: Float[Tensor, "*sample node 7"],
        next_pose: Float[Tensor, "*sample node 7"],
        action: Float[Tensor, "*#sample #node 3"],
        is_target: Float[Tensor, "*#sample node"],
    ) -> Float[Tensor, "*sample node 7"]:
        """What the network should say: the inverse of `next_pose`."""
        return (displacement(pose, next_pose) - self._origin(action, is_target)) / self._unit(is_target)

    def next_pose(
        self,
        pose: Float[Tensor, "*sample node 7"],
        output: Float[Tensor, "*sample node 7"],
        action: Float[Tensor, "*#sample #node 3"],
        is_target: Float[Tensor, "*#sample node"],
    ) -> Float[Tensor, "*sample node 7"]:
        """The tower after the step, from poses now and the network's output."""
        return displaced(pose, output * self._unit(is_target) + self._origin(action, is_target))
