"""Architectures by name. Add your own to a table before training or loading a checkpoint of it:

    SELECTORS["mine"] = lambda config, widths: MyNetwork(widths.node)

A selector maps `Graphs` to logits [graph, 2] of (holds, fails), a simulator to displacements [*sample, node, 7]
in units of their scale. One that has a method `look` answers whole plans: see `jenga_models.factored`.
"""

from collections.abc import Callable

import torch
from torch import nn

from jenga_data.errors import JengaError
from jenga_models.config import DynamicsTraining, SelectionTraining, Training
from jenga_models.factored import Factored
from jenga_models.gns import ACTION_WIDTH, GNS, InteractionClassifier, Widths


def _gcn(config: SelectionTraining, widths: Widths) -> nn.Module:
    from jenga_models.gcn import GCN  # torch_geometric takes seconds to import, and only this model needs it

    return GCN(
        widths,
        width=config.width,
        layers=config.layers,
        residual=config.residual,
        at_target=config.readout == "target",
    )


def _interaction(config: SelectionTraining, widths: Widths) -> nn.Module:
    return InteractionClassifier(
        widths,
        width=config.width,
        layers=config.layers,
        shared=config.shared_layers,
        at_target=config.readout == "target",
    )


def _gns(config: DynamicsTraining, widths: Widths) -> nn.Module:
    return GNS(
        widths,
        width=config.width,
        layers=config.layers,
        hidden_layers=config.hidden_layers,
        edge_memory=config.edge_memory,
    )


def _factored(config: DynamicsTraining, widths: Widths) -> nn.Module:
    return Factored(config.width, config.layers, config.decoder_width)


SELECTORS: dict[str, Callable[[SelectionTraining, Widths], nn.Module]] = {"gcn": _gcn, "interaction": _interaction}
SIMULATORS: dict[str, Callable[[DynamicsTraining, Widths], nn.Module]] = {"gns": _gns, "factored": _factored}


def build(config: Training, node_width: int, edge_width: int) -> nn.Module:
    """A network with fresh weights, drawn from the config's seed and nothing else.

    Raises:
        JengaError: no architecture of that name is registered for this kind of training.
    """
    selection = isinstance(config, SelectionTraining)
    table = SELECTORS if selection else SIMULATORS
    if config.model not in table:
        kind = "selection" if selection else "dynamics"
        raise JengaError(
            f"unknown model {config.model!r} for {kind}; registered: {', '.join(table)}; "
            "import the module that registers yours first"
        )
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        widths = Widths(node_width, edge_width, 0 if selection else ACTION_WIDTH)
        return table[config.model](config, widths)  # pyright: ignore[reportArgumentType]
