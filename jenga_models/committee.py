"""Selectors that are several networks in one (Lakshminarayanan 2017, arXiv 1612.01474), with honest probabilities."""

from abc import ABC, abstractmethod

import torch
from jaxtyping import Float, Int
from scipy.optimize import minimize_scalar
from torch import Tensor, nn
from torch.nn import functional

from jenga_models.graphs import Graphs
from jenga_models.verdicts import Judgement

_TEMPERATURES = (-1.0, 1.0)
"""Decimal logarithms of the coldest and the hottest."""


class Committee(nn.Module, ABC):
    """Its members see the same graphs and differ by their initial weights.

    Called, it gives the logarithm of the mean of their probabilities, divided by a temperature (Guo 2017,
    arXiv 1706.04599), which is 1 until `calibrate` chose it.
    """

    temperature: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("temperature", torch.ones(()))

    @abstractmethod
    def each(self, graphs: Graphs) -> Float[Tensor, "member graph class"]:
        """Logits of every member: training takes the loss of each for itself, or they would lean on each other."""

    def judge(self, graphs: Graphs) -> Judgement:
        """The same logits, and what every member says of the rest of a pull: for those who do."""
        raise NotImplementedError

    def forward(self, graphs: Graphs) -> Float[Tensor, "graph class"]:
        return mean_log_probability(self.each(graphs)) / self.temperature

    def calibrate(self, logits: Float[Tensor, "graph class"], wanted: Int[Tensor, " graph"]) -> None:
        """Choose the temperature at which what it said of these graphs costs the least cross-entropy."""
        raw = (logits * self.temperature).double()

        def loss(logarithm: float) -> float:
            return float(functional.cross_entropy(raw / 10**logarithm, wanted))

        best = minimize_scalar(loss, bounds=_TEMPERATURES, method="bounded")
        self.temperature.fill_(10 ** float(best.x))


def mean_log_probability(logits: Float[Tensor, "member graph class"]) -> Float[Tensor, "graph class"]:
    """The logarithm of the members' mean probability."""
    return logits.log_softmax(-1).logsumexp(0) - torch.tensor(float(len(logits))).log()


class MemberLinear(nn.Module):
    """One linear layer a member, all in one product; each starts as `nn.Linear` does."""

    def __init__(self, members: int, inputs: int, outputs: int) -> None:
        super().__init__()
        layers = [nn.Linear(inputs, outputs) for _ in range(members)]
        self.weight = nn.Parameter(torch.stack([layer.weight.detach().t() for layer in layers]))
        self.bias = nn.Parameter(torch.stack([layer.bias.detach() for layer in layers])[:, None])

    def forward(self, values: Float[Tensor, "member *batch input"]) -> Float[Tensor, "member *batch output"]:
        out = torch.baddbmm(self.bias, values.flatten(1, -2), self.weight)
        return out.view(*values.shape[:-1], -1)
