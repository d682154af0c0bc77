"""Predictions of a checkpoint over rows of a dataset, as arrays: evaluation tables are made of these elsewhere."""

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int

from jenga_data.errors import JengaError
from jenga_models.ahead import answers_plans, plan_ahead, rows_of
from jenga_models.checkpoint import Checkpoint, check_dataset
from jenga_models.columns import Rows, Towers, dataset_name
from jenga_models.plans import lags
from jenga_models.predict import opened
from jenga_models.store import EpochOrder, GraphStore

BATCH = 256
"""Graphs a forward pass: more is no faster on two cores."""


def predict_selection(
    checkpoint: Checkpoint | Path, dataset: Rows, rows: Int[np.ndarray, " row"]
) -> Float[np.ndarray, " row"]:
    """Probability that the pull of each row fails, in the order of `rows`.

    Raises:
        JengaError: the checkpoint is no selector, or the dataset is not one of pulls.
    """
    checkpoint = opened(checkpoint, "selection")
    check_dataset(checkpoint, dataset)
    store = GraphStore.of(checkpoint.spec, Towers.of_dataset(dataset))
    parts = [np.zeros(0)]
    with torch.inference_mode():
        for batch in EpochOrder(rows, BATCH, None).batches(0):
            logits = checkpoint.model(store.batch(checkpoint.featurizer, batch))
            parts.append(logits.double().softmax(-1)[:, 1].numpy())
    return np.concatenate(parts)


def predict_dynamics(
    checkpoint: Checkpoint | Path, dataset: Rows, rows: Int[np.ndarray, " row"]
) -> Float[np.ndarray, "row block 7"]:
    """Poses at the next frame, predicted from the true ones at each row's, in the order of `rows`.

    Raises:
        JengaError: the checkpoint is no simulator, or the dataset is not one of transitions.
    """
    checkpoint = opened(checkpoint, "dynamics")
    check_dataset(checkpoint, dataset)
    if answers_plans(checkpoint):
        towers = rows_of(Towers.of_dataset(dataset, moving=True), rows)
        return advance(checkpoint, towers, dataset.column("action")[rows], lag=lags(dataset)[rows])
    return advance(checkpoint, Towers.of_dataset(dataset), dataset.column("action"), rows)


def advance(
    checkpoint: Checkpoint,
    towers: Towers,
    action: Float[np.ndarray, "tower 3"],
    rows: Int[np.ndarray, " row"] | None = None,
    lag: Float[np.ndarray, "tower 3"] | None = None,
) -> Float[np.ndarray, "row block 7"]:
    """The towers one control step on, each with its own topology; of all, or of some rows of them.

    `action` is the displacement of the gripper in each tower [m], `lag` how far its set point is ahead of it [m], for
    models that ask for it.
    """
    if answers_plans(checkpoint):
        if rows is not None:
            towers, action, lag = rows_of(towers, rows), action[rows], None if lag is None else lag[rows]
        return plan_ahead(checkpoint, towers, action[:, None], lag).pose[:, 0]
    rows = np.arange(len(towers)) if rows is None else rows
    store = GraphStore.of(checkpoint.spec, towers, action)
    simulator, parts = checkpoint.simulator, [np.zeros((0, store.blocks, 7), np.float32)]
    with torch.inference_mode():
        for batch in EpochOrder(rows, BATCH, None).batches(0):
            graphs = store.batch(checkpoint.featurizer, batch)
            pose = torch.tensor(towers.block_pose[batch.numpy()], dtype=torch.float32)
            assert store.action is not None
            after = simulator.next_pose(
                pose,
                checkpoint.model(graphs).view_as(pose),
                store.action[batch][:, None, :],
                graphs.is_target().view(pose.shape[:2]),
            )
            parts.append(after.numpy())
    return np.concatenate(parts)


def windows(dataset: Rows, rows: Int[np.ndarray, " row"], steps: int) -> Int[np.ndarray, "start step"]:
    """Runs of `steps` rows that follow each other frame by frame in one episode, all of them among `rows`.

    Windows of one episode do not overlap: the first starts at its first row.

    Raises:
        JengaError: no episode is that long.
    """
    episode, frame = dataset.column("episode")[rows], dataset.column("frame")[rows]
    order = np.lexsort((frame, episode))
    episode, frame, sorted_rows = episode[order], frame[order], rows[order]
    breaks = (episode[1:] != episode[:-1]) | (np.diff(frame) != 1)
    starts = np.flatnonzero(np.concatenate([[True], breaks])) if len(rows) else np.zeros(0, np.int64)
    ends = np.append(starts[1:], len(rows))
    firsts = [np.arange(a, b - steps + 1, steps) for a, b in zip(starts, ends, strict=True)]
    first = np.concatenate([np.zeros(0, np.int64), *firsts])
    if len(first) == 0:
        raise JengaError(f"{dataset_name(dataset)} has no episode of {steps} transitions in a row on this side")
    return sorted_rows[first[:, None] + np.arange(steps)]


def rollout_dynamics(
    checkpoint: Checkpoint | Path, dataset: Rows, window: Int[np.ndarray, "start step"]
) -> Float[np.ndarray, "start step block 7"]:
    """Poses after each step of each window, predicted open loop: true poses at its first row, then its own.

    The topology is found anew from the predicted poses at every step. `windows` gives the windows; the truth to
    compare with is `next_pose` of its rows.

    Raises:
        JengaError: the checkpoint is no simulator, or the dataset is not one of transitions.
    """
    checkpoint = opened(checkpoint, "dynamics")
    check_dataset(checkpoint, dataset)
    first = window[:, 0]
    size, mass, pose, level, slot, target = (
        dataset.column(name)[first] for name in ("block_size", "block_mass", "block_pose", "level", "slot", "target")
    )
    if answers_plans(checkpoint):
        towers = rows_of(Towers.of_dataset(dataset, moving=True), first)
        return plan_ahead(checkpoint, towers, dataset.column("action")[window], lags(dataset)[first]).pose
    action, poses = dataset.column("action"), []
    for step in range(window.shape[1]):
        towers = Towers.of_poses(size, mass, pose, level, slot, target)
        pose = advance(checkpoint, towers, action[window[:, step]])
        poses.append(pose)
    return np.stack(poses, axis=1)
