"""What heights and places of blocks say of each other, as the network is told it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from test_sweep import SPEC, flat, tall_tower
from torch import Tensor

from jenga_control.selection.baselines.layout_features import layout_features
from jenga_control.selection.baselines.structure import Structure
from jenga_data.graph import support_edges
from jenga_data.graph_spec import graph_spec
from jenga_data.tower import TowerState
from jenga_models.features import feature_slices
from jenga_models.graphs import Graphs
from jenga_models.levels import Levels
from jenga_models.mirror import mirrored
from jenga_models.relations import relations, relations_width

AT = feature_slices(SPEC)
SAME = {
    0: ("mates", 0.5),
    1: ("over_highest_of_siblings", 1e-3),
    2: ("over_lowest_of_siblings", 1e-3),
    3: ("over_mean_of_siblings", 1e-3),
    4: ("lower_siblings", 0.5),
    5: ("carries", 1 / 3),
    6: ("rests_on", 1 / 3),
    7: ("spread_above", 1e-3),
    8: ("lead_above", 1e-3),
    9: ("spread_below", 1e-3),
    10: ("lead_below", 1e-3),
    11: ("blocks_above", 1 / 20),
    12: ("blocks_below", 1 / 20),
    13: ("levels_above", 1 / 20),
    14: ("levels_below", 1 / 20),
    15: ("weight_above", 1 / 9.81 / 20),
    16: ("centre", 1.0),
    17: ("crown", 1e-3),
    18: ("crown_against", 1e-3),
    19: ("over_centre", 1e-3),
    20: ("over_other_side", 1e-3),
    21: ("over_highest_side", 1e-3),
    22: ("over_lowest_side", 1e-3),
    25: ("crown_above", 1e-3),
    26: ("centre_above", 1.0),
    28: ("slope_above", 1e-3),
    29: ("crown_below", 1e-3),
    30: ("centre_below", 1.0),
    32: ("slope_below", 1e-3),
}
"""By their number: the hand-made feature that says the same of a target, and what one unit of it is."""


def related(graphs: Graphs, at: dict[str, slice] = AT) -> Tensor:
    """Relations of every block, graph by graph."""
    levels = Levels.of(graphs)
    found = relations(levels, levels.spread(graphs.node), at)
    return levels.gathered(found, graphs.node).view(len(graphs), 54, -1)


def exact(graphs: Graphs) -> Graphs:
    return replace(graphs, node=graphs.node.double())


def structure(state: TowerState, target: int) -> Structure:
    supports = np.zeros((54, 54), bool)
    supports[tuple(support_edges(state.pose, state.blocks.size))] = True
    blocks = state.blocks
    return Structure(blocks.size, blocks.mass, state.pose, state.layout.level, state.layout.slot, supports, target)


@pytest.mark.parametrize("moves", [0, 4, 14])
def test_they_say_of_every_block_what_the_hand_made_features_say_of_a_target(moves: int):
    for seed in range(3):
        state = tall_tower(seed, moves)
        found = related(exact(flat(state)))[0].numpy()
        for target in state.layout.legal_targets():
            wanted = layout_features(structure(state, target))
            for number, (name, unit) in SAME.items():
                # Sizes come from single precision, which holds a block's length to some nanometres.
                assert found[target, number] == pytest.approx(wanted[name] * unit, abs=3e-8, rel=1e-5), name


def test_balance_is_that_of_equally_heavy_blocks_in_slots():
    state = tall_tower(2, moves=14)
    even = replace(state, blocks=replace(state.blocks, mass=np.full(54, 0.02)))
    found, slot = related(exact(flat(even)))[0].numpy(), 25.0
    for target in state.layout.legal_targets():
        wanted = layout_features(structure(even, target))
        said = dict(
            zip(("mass_off_target", "mass_off_centre", "mass_along", "margin"), found[target, 33:37], strict=True)
        )
        for name, value in said.items():
            assert value * slot == pytest.approx(wanted[name], rel=0.02, abs=0.02), name


def test_sides_do_not_matter():
    graphs = exact(flat(*[tall_tower(seed, moves=9) for seed in range(8)]))
    torch.manual_seed(1)
    turned = mirrored(graphs, SPEC)
    assert not torch.equal(turned.node, graphs.node)
    torch.testing.assert_close(related(turned), related(graphs), atol=1e-12, rtol=0)


def test_without_slots_only_what_edges_and_sizes_say():
    spec = graph_spec("G_s")
    at = feature_slices(spec)
    graphs = flat(tall_tower(0))
    plain = replace(graphs, node=graphs.node[:, : spec.node_width])
    found = related(plain, at)
    assert found.shape[-1] == relations_width(at)
    torch.testing.assert_close(found, related(graphs)[..., : found.shape[-1]])


def test_they_are_finite_whatever_stands_on_what():
    """A tower that fell: blocks on the table and one on another."""
    nodes = 5
    edges = torch.tensor([[3, 4], [0, 3]])
    node = torch.randn(nodes, SPEC.node_width)
    node[:, AT["slot"]] = torch.eye(3)[torch.tensor([0, 0, 1, 2, 2])]
    graphs = Graphs(node, edges, torch.ones(2, 1), torch.tensor([0]), graph=torch.zeros(nodes, dtype=torch.long))
    levels = Levels.of(graphs)
    found = relations(levels, levels.spread(node), AT)
    assert found.isfinite().all()
    assert found.shape[-1] == relations_width(AT)
