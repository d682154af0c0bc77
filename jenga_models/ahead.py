"""Many towers a number of steps on, each with its own plan: predictions of either kind of simulator over data."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from jenga_models.checkpoint import Checkpoint
from jenga_models.columns import Towers
from jenga_models.config import DynamicsTraining
from jenga_models.factored import Factored
from jenga_models.motion import STEP
from jenga_models.rotations import turned
from jenga_models.store import EpochOrder, GraphStore

BATCH = 64
"""Graphs a forward pass of a model of plans."""


def answers_plans(checkpoint: Checkpoint) -> bool:
    """Whether its model answers whole plans (see `jenga_models.factored`), and does not go step by step."""
    return hasattr(checkpoint.model, "look")


@dataclass(frozen=True, eq=False)
class Ahead:
    """What is predicted: poses after each step, and at the end the velocities and the lag of the hand."""

    pose: Float[np.ndarray, "tower step block 7"]
    twist: Float[np.ndarray, "tower block 6"]
    lag: Float[np.ndarray, "tower 3"]


def poses_after(
    pose: Float[Tensor, "*batch block 7"], motion: Float[Tensor, "*plan block step 6"]
) -> Float[Tensor, "*plan step block 7"]:
    """Poses after each step of a motion from `pose` on. Rotations of a few steps are small, and add up."""
    total = motion.cumsum(-2).transpose(-2, -3)
    now = pose[..., None, :, :]
    return torch.cat(
        [now[..., :3] + total[..., :3], turned(now[..., 3:].expand(*total.shape[:-1], 4), total[..., 3:])], -1
    )


def plan_ahead(
    checkpoint: Checkpoint,
    towers: Towers,
    plans: Float[np.ndarray, "tower step 3"],
    lag: Float[np.ndarray, "tower 3"] | None = None,
) -> Ahead:
    """What comes of one plan for each tower, by a model that answers plans.

    A plan that is longer than those that it was trained on is answered piece by piece, each from the predicted tower.

    Args:
        plans: displacements of the gripper [m].
        lag: how far the hand's set point is ahead of the hand [m]; not at all by default.
    """
    config = checkpoint.config
    assert isinstance(config, DynamicsTraining)
    behind = np.zeros((len(towers), 3)) if lag is None else lag
    each, twist, poses = np.arange(len(towers)), np.zeros((len(towers), 0, 6)), []
    for start in range(0, plans.shape[1], config.horizon):
        plan = plans[:, start : start + config.horizon]
        if start:
            towers = _again(towers, poses[-1][:, -1], twist)
        pose, twist = _piece(checkpoint, towers, plan, behind)
        way = pose[each, -1, towers.target, :3] - towers.block_pose[each, towers.target, :3]
        behind = behind + plan.sum(1) - way
        poses.append(pose)
    return Ahead(np.concatenate(poses, axis=1), twist, behind)


def _again(
    towers: Towers, pose: Float[np.ndarray, "tower block 7"], twist: Float[np.ndarray, "tower block 6"]
) -> Towers:
    """The same towers elsewhere, with the topology that they have there."""
    return Towers.of_poses(
        towers.block_size, towers.block_mass, pose, towers.level, towers.slot, towers.target, twist=twist
    )


def _piece(
    checkpoint: Checkpoint, towers: Towers, plan: Float[np.ndarray, "tower step 3"], lag: Float[np.ndarray, "tower 3"]
) -> tuple[Float[np.ndarray, "tower step block 7"], Float[np.ndarray, "tower block 6"]]:
    model = checkpoint.model
    assert isinstance(model, Factored)
    store = GraphStore.of(checkpoint.spec, towers, lag=lag)
    pose, twist = [np.zeros((0, plan.shape[1], store.blocks, 7))], [np.zeros((0, store.blocks, 6))]
    with torch.inference_mode():
        for rows in EpochOrder(np.arange(len(towers)), BATCH, None).batches(0):
            actions = torch.tensor(plan[rows.numpy()], dtype=torch.float32)
            said = model(replace(store.batch(checkpoint.featurizer, rows), action=actions))
            said = said.view(len(rows), store.blocks, -1, 12).double()
            now = torch.tensor(towers.block_pose[rows.numpy()]).double()
            pose.append(poses_after(now, said[..., :6]).numpy())
            twist.append(said[:, :, -1, 6:].numpy() / STEP)
    return np.concatenate(pose), np.concatenate(twist)


def rows_of(towers: Towers, rows: Int[np.ndarray, " row"]) -> Towers:
    """Some of many towers."""
    count = np.diff(towers.offset)[rows]
    start = towers.offset[:-1][rows]
    edge = np.repeat(start - (np.cumsum(count) - count), count) + np.arange(count.sum())
    each = {
        name: getattr(towers, name)[rows]
        for name in ("block_size", "block_mass", "block_pose", "level", "slot", "target")
    }
    twist = None if towers.block_twist is None else towers.block_twist[rows]
    return Towers(
        **each,
        offset=np.concatenate([[0], np.cumsum(count)]),
        upper=towers.upper[edge],
        lower=towers.lower[edge],
        block_twist=twist,
    )
