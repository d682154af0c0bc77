"""What a model of plans learns from: runs of transitions, each with the plan that was made and the motion that came."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.utils.data import Dataset

from jenga_data.errors import JengaError
from jenga_models.batch import Batch
from jenga_models.columns import Rows
from jenga_models.features import Featurizer, feature_slices
from jenga_models.graphs import Graphs
from jenga_models.motion import STEP
from jenga_models.rotations import between
from jenga_models.store import GraphStore

MOTION = 13
"""Numbers that a block has a step: displacement [m] and rotation [rad], the same at the velocity after the step, and
whether the step was made at all."""
CLEAR_SHARE = 4
"""Of the rows after the target is clear one in so many is trained on: nothing is left to learn of them."""


def chains(
    episode: np.ndarray, frame: Int[np.ndarray, " row"], steps: int
) -> tuple[Int[np.ndarray, "row step"], Bool[np.ndarray, "row step"]]:
    """The row of each step of the plan that begins at a row, and whether the episode has it."""
    order = np.lexsort((frame, episode))
    follows = (episode[order][1:] == episode[order][:-1]) & (np.diff(frame[order]) == 1)
    after = np.full(len(frame), -1)
    after[order[:-1][follows]] = order[1:][follows]
    chain = np.empty((len(frame), steps), np.int64)
    chain[:, 0] = np.arange(len(frame))
    for step in range(1, steps):
        before = chain[:, step - 1]
        chain[:, step] = np.where(before >= 0, after[before], -1)
    return np.maximum(chain, 0), chain >= 0


def lags(dataset: Rows) -> Float[np.ndarray, "row 3"]:
    """How far the hand's set point is ahead of the hand at each row [m]: the sum of what the target fell short.

    The hand holds the target, so the way of the one is the way of the other. Before the first action it is taken to
    be 0; a sum starts anew where rows of an episode are missing.
    """
    rows, target = np.arange(len(dataset)), dataset.column("target").astype(int)
    moved = (
        (dataset.column("next_pose")[rows, target, :3]).astype(float) - dataset.column("block_pose")[rows, target, :3]
    )
    short = dataset.column("action") - moved
    episode, frame = dataset.column("episode"), dataset.column("frame")
    order = np.lexsort((frame, episode))
    begins = np.concatenate([[True], (episode[order][1:] != episode[order][:-1]) | (np.diff(frame[order]) != 1)])
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(short[order], axis=0)[:-1]])
    first = np.maximum.accumulate(np.where(begins, np.arange(len(order)), 0))
    lag = np.empty_like(total)
    lag[order] = total - total[first]
    return lag


def worth_learning(dataset: Rows) -> Bool[np.ndarray, " row"]:
    """Rows to start plans from: the tower stands, and the target is in it, but for a few."""
    seldom = dataset.column("frame") % CLEAR_SHARE == 0
    return ~dataset.column("collapsed") & (~dataset.column("target_clear") | seldom)


@dataclass(frozen=True, eq=False)
class PlanTruth:
    """The motion of every row of a dataset, and which rows a plan from each one goes through."""

    motion: Float[Tensor, "row block 12"]
    chain: Int[np.ndarray, "row step"]
    made: Bool[np.ndarray, "row step"]

    @classmethod
    def of(cls, dataset: Rows, steps: int) -> "PlanTruth":
        now, after = (torch.tensor(dataset.column(name)).double() for name in ("block_pose", "next_pose"))
        moved = torch.cat([after[..., :3] - now[..., :3], between(now[..., 3:], after[..., 3:])], dim=-1)
        twist = torch.tensor(dataset.column("next_twist")).double() * STEP
        motion = torch.cat([moved, twist], dim=-1).float()
        if not motion.isfinite().all():
            raise JengaError("a transition of the dataset holds a number that is none; run `jenga dataset verify`")
        return cls(motion, *chains(dataset.column("episode"), dataset.column("frame"), steps))


class PlanBatches(Dataset[Batch]):
    """Graphs with plans, and what came of them: `wanted` is [node, step, MOTION].

    Half of the batches are seen in a mirror, the plane of the pull: y and -y are the same to a tower. Which half is a
    function of a batch's rows, so that a resumed training sees the same.
    """

    def __init__(self, store: GraphStore, featurizer: Featurizer, truth: PlanTruth, mirror: bool) -> None:
        self._store, self._featurizer, self._truth, self._mirror = store, featurizer, truth, mirror

    def __getitem__(self, rows: Int[Tensor, " graph"]) -> Batch:
        store, truth = self._store, self._truth
        assert store.action is not None
        chain = torch.from_numpy(truth.chain[rows.numpy()])
        made = torch.from_numpy(truth.made[rows.numpy()]).float()
        motion = truth.motion[chain].transpose(1, 2)  # (graph, block, step, 12)
        flags = made[:, None, :, None].expand(*motion.shape[:3], 1)
        wanted = torch.cat([motion, flags], dim=-1).flatten(0, 1)
        graphs = replace(store.batch(self._featurizer, rows), action=store.action[chain])
        if self._mirror and int(rows.sum()) % 2:
            return mirrored(Batch(graphs, wanted), self._featurizer)
        return Batch(graphs, wanted)


def mirrored(batch: Batch, featurizer: Featurizer) -> Batch:
    """The same towers seen in a mirror, the plane through x and z: y turns round, and rotations about x and z."""
    vector = torch.tensor([1.0, -1.0, 1.0])
    twist = torch.cat([vector, -vector])
    at, node = feature_slices(featurizer.spec), batch.graphs.node.clone()
    node[:, at["block_pose"]] *= torch.tensor([1.0, -1.0, 1.0, 1.0, -1.0, 1.0, -1.0])
    node[:, at["block_twist"]] *= twist
    graphs: Graphs = batch.graphs
    assert graphs.action is not None
    lag = None if graphs.lag is None else graphs.lag * vector
    wanted = batch.wanted * torch.cat([twist, twist, torch.ones(1)])
    return Batch(replace(graphs, node=node, action=graphs.action * vector, lag=lag), wanted)
