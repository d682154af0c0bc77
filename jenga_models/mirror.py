"""Towers in the mirror: a pull ends alike when left and right are exchanged."""

from dataclasses import replace

import torch

from jenga_data.graph_spec import GraphSpec
from jenga_models.features import feature_slices
from jenga_models.graphs import Graphs


def mirrored(graphs: Graphs, spec: GraphSpec) -> Graphs:
    """A flat batch with the slots of each tower's even levels reversed or not, and those of its odd levels, at random.

    Both are symmetries of a tower without poses: the mirror along its blocks, and the one across. What rests on what
    stays as it is. Where nodes hold no slots, nothing changes.
    """
    at = feature_slices(spec)
    if "slot" not in at:
        return graphs
    assert graphs.graph is not None, "only flat batches are trained on"
    slot, odd = graphs.node[:, at["slot"]], graphs.node[:, at["orientation"].start].long()
    turned = torch.rand(len(graphs), 2, device=slot.device) < 0.5
    node = graphs.node.clone()
    node[:, at["slot"]] = torch.where(turned[graphs.graph, odd][:, None], slot.flip(-1), slot)
    return replace(graphs, node=node)
