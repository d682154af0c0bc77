"""What is left of a dataset when training starts: graphs, what to say of them, and how both are scaled."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Int
from torch import Tensor
from torch.utils.data import Dataset as TorchDataset

from jenga_data.graph_spec import GraphSpec
from jenga_models.batch import Batch
from jenga_models.columns import Rows, Towers
from jenga_models.config import DynamicsTraining, SelectionTraining
from jenga_models.features import Featurizer
from jenga_models.normalisation import Normalisation
from jenga_models.plans import PlanBatches, PlanTruth, lags, worth_learning
from jenga_models.scaling import fit_features, fit_targets
from jenga_models.simulator import Simulator
from jenga_models.store import GraphStore
from jenga_models.verdicts import with_verdicts


@dataclass(frozen=True, eq=False)
class Problem:
    """Graphs of all rows of a dataset. `wanted` holds a label a row, with verdicts or without, or an output a block."""

    store: GraphStore
    wanted: Tensor
    normalisation: Normalisation
    batches: TorchDataset[Batch] | None = None
    """What makes batches, where they are more than graphs and `wanted` of the same rows."""
    keep: Bool[np.ndarray, " row"] | None = None
    """Rows that are worth learning from; None is all."""


def selection_problem(
    dataset: Rows, config: SelectionTraining, spec: GraphSpec, train: Int[np.ndarray, " row"]
) -> Problem:
    """Does pulling the target fail? Scaled by the rows `train`."""
    store = GraphStore.of(spec, Towers.of_dataset(dataset))
    wanted = torch.from_numpy(dataset.column(config.label).astype(np.int64))
    if config.learns_verdicts:
        wanted = with_verdicts(dataset, wanted)
    return Problem(store, wanted, fit_features(config, spec, store, train))


def dynamics_problem(
    dataset: Rows, config: DynamicsTraining, spec: GraphSpec, train: Int[np.ndarray, " row"]
) -> Problem:
    """How does each block move? Scaled by the rows `train`."""
    if config.model == "factored":
        return plan_problem(dataset, config, spec)
    store = GraphStore.of(spec, Towers.of_dataset(dataset), dataset.column("action"))
    assert store.action is not None
    normalisation = fit_features(config, spec, store, train)
    pose, after = (torch.tensor(dataset.column(name)) for name in ("block_pose", "next_pose"))
    is_target = torch.nn.functional.one_hot(store.target, store.blocks).to(pose.dtype)
    motion = (pose, after, store.action[:, None, :], is_target)
    raw = Simulator.of(normalisation, config.residual_to_action).output_for(*motion)
    mean, scale = fit_targets(
        config.scale_targets, raw[train], is_target[train], standing=~dataset.column("collapsed")[train]
    )
    normalisation = replace(normalisation, delta_mean=mean, delta_scale=scale)
    wanted = Simulator.of(normalisation, config.residual_to_action).output_for(*motion)
    return Problem(store, wanted, normalisation)


def plan_problem(dataset: Rows, config: DynamicsTraining, spec: GraphSpec) -> Problem:
    """What comes of a plan of several actions? Nothing is scaled by the rows: the model's units are millimetres."""
    store = GraphStore.of(spec, Towers.of_dataset(dataset, moving=True), dataset.column("action"), lags(dataset))
    normalisation = Normalisation.none(spec.node_width, 0)
    featurizer = Featurizer(spec, config.flow, config.edge_attributes, normalisation)
    batches = PlanBatches(store, featurizer, PlanTruth.of(dataset, config.horizon), config.mirror)
    return Problem(store, torch.zeros(0), normalisation, batches, worth_learning(dataset))
