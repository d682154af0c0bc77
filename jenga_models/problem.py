"""What is left of a dataset when training starts: graphs, what to say of them, and how both are scaled."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Int
from torch import Tensor

from jenga_data.graph_spec import GraphSpec
from jenga_models.columns import Rows, Towers
from jenga_models.config import DynamicsTraining, SelectionTraining
from jenga_models.normalisation import Normalisation
from jenga_models.scaling import fit_features, fit_targets
from jenga_models.simulator import Simulator
from jenga_models.store import GraphStore


@dataclass(frozen=True, eq=False)
class Problem:
    """Graphs of all rows of a dataset. `wanted` holds a label a row, or an output a block."""

    store: GraphStore
    wanted: Tensor
    normalisation: Normalisation


def selection_problem(
    dataset: Rows, config: SelectionTraining, spec: GraphSpec, train: Int[np.ndarray, " row"]
) -> Problem:
    """Does pulling the target fail? Scaled by the rows `train`."""
    store = GraphStore.of(spec, Towers.of_dataset(dataset))
    wanted = torch.from_numpy(dataset.column(config.label).astype(np.int64))
    return Problem(store, wanted, fit_features(config, spec, store, train))


def dynamics_problem(
    dataset: Rows, config: DynamicsTraining, spec: GraphSpec, train: Int[np.ndarray, " row"]
) -> Problem:
    """How does each block move? Scaled by the rows `train`."""
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
