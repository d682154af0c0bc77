"""Statistics of the training rows: how features, edges, actions and displacements are scaled."""

from dataclasses import replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from jenga_data.graph_spec import GraphSpec
from jenga_models.config import Training
from jenga_models.features import MEASURED, attribute_width, edge_attributes, feature_slices
from jenga_models.normalisation import MIN_SCALE, Normalisation, moments
from jenga_models.store import GraphStore

EDGE_ROWS = 2000
"""Edge statistics are taken from so many towers, evenly spread: more change them by less than a percent."""


def fit_features(config: Training, spec: GraphSpec, store: GraphStore, rows: Int[np.ndarray, " row"]) -> Normalisation:
    """Standardise measured node features, edge attributes and actions over `rows`; leave displacements alone."""
    chosen = torch.from_numpy(rows)
    n = Normalisation.none(spec.node_width, attribute_width(spec) if config.edge_attributes else 0)
    if not config.scale_features:
        return n
    mean, scale = n.node_mean.clone(), n.node_scale.clone()
    for name, columns in feature_slices(spec).items():
        if name in MEASURED:
            mean[columns], scale[columns] = moments(store.node[chosen][..., columns].flatten(0, 1))
    n = replace(n, node_mean=mean, node_scale=scale)
    if len(n.edge_mean):
        some = chosen[:: -(-len(chosen) // EDGE_ROWS)]
        upper, lower = store.edges_of(some)
        known = edge_attributes(spec, store.node[some].flatten(0, 1), upper, lower)
        n = replace(n, **dict(zip(("edge_mean", "edge_scale"), moments(known), strict=True)))
    if store.action is not None:
        shift, spread = moments(store.action[chosen])
        n = replace(n, action_mean=shift, action_scale=spread)
    return n


def fit_targets(
    how: Literal["none", "all", "role"],
    delta: Float[Tensor, "row block 7"],
    is_target: Float[Tensor, "row block"],
    standing: Bool[np.ndarray, " row"],
) -> tuple[Float[Tensor, "role 7"], Float[Tensor, "role 7"]]:
    """Mean and scale of displacements for the others (row 0) and the target (row 1): 0 and 1 for "none", those
    over all blocks for "all", each for itself by "role".

    By role, means are 0 (at rest is where a block belongs) and rows of collapsing towers are left out, as
    far as there are others: a falling block moves a thousand times farther than a pushed one.
    """
    if how == "none":
        return torch.zeros(2, 7), torch.ones(2, 7)
    if how == "all":
        mean, scale = moments(delta.flatten(0, 1))
        return mean.expand(2, 7).clone(), scale.expand(2, 7).clone()
    keep = torch.from_numpy(standing if standing.any() else np.ones_like(standing))
    scales = [delta[keep][is_target[keep] == role].double().square().mean(0).sqrt() for role in (0, 1)]
    return torch.zeros(2, 7), torch.stack(scales).clamp_min(MIN_SCALE).float()
