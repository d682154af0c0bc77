"""Architectures by name. Add your own to a table before training or loading a checkpoint of it:

    SELECTORS["mine"] = lambda config, widths: MyNetwork(widths.node)

A selector maps `Graphs` to logits [graph, 2] of (holds, fails), a simulator to displacements [*sample, node, 7]
in units of their scale. One that has a method `look` answers whole plans: see `jenga_models.factored`.
"""

from collections.abc import Callable

import torch
from torch import nn

from jenga_data.errors import JengaError
from jenga_data.graph_spec import GraphSpec
from jenga_models.committee import Committee
from jenga_models.config import DynamicsTraining, SelectionTraining, Training
from jenga_models.factored import Factored
from jenga_models.features import feature_slices
from jenga_models.gns import ACTION_WIDTH, GNS, InteractionClassifier, Widths
from jenga_models.sweep import SweepClassifier


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


def _sweep(config: SelectionTraining, widths: Widths) -> nn.Module:
    if config.flow != "down":
        raise JengaError(f"flow is {config.flow!r}; allowed for the model sweep: down (it goes both ways by itself)")
    if config.readout != "target":
        raise JengaError(f"readout is {config.readout!r}; allowed for the model sweep: target")
    return SweepClassifier(
        widths, width=config.width, sweeps=config.layers, members=config.members, dropout=config.dropout
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


SELECTORS: dict[str, Callable[[SelectionTraining, Widths], nn.Module]] = {
    "gcn": _gcn,
    "interaction": _interaction,
    "sweep": _sweep,
}
SIMULATORS: dict[str, Callable[[DynamicsTraining, Widths], nn.Module]] = {"gns": _gns, "factored": _factored}


def build(config: Training, spec: GraphSpec, edge_width: int) -> nn.Module:
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
        widths = Widths(spec.node_width, edge_width, 0 if selection else ACTION_WIDTH, feature_slices(spec))
        # The table was chosen by the kind of the config, which pyright does not see.
        model = table[config.model](config, widths)  # pyright: ignore[reportArgumentType]
    if isinstance(config, SelectionTraining):
        _check_committee(config, model)
    return model


def _check_committee(config: SelectionTraining, model: nn.Module) -> None:
    """What only a committee can do is asked of no other model."""
    if not isinstance(model, Committee):
        neutral = {"members": 1, "calibrate": False, "verdict": 0.0, "motion": 0.0}
        given = [name for name, value in neutral.items() if getattr(config, name) != value]
        if given:
            raise JengaError(f"{given[0]} is not for model {config.model!r}; allowed for: sweep, and own committees")
    elif config.learns_verdicts and type(model).judge is Committee.judge:
        raise JengaError(
            f"verdict and motion are not for model {config.model!r}, which has no `judge`; allowed for: sweep"
        )
