"""Building blocks of the message-passing networks, and the two steps of message passing made of them.

Node states are [*sample, node, width]: layers index the node axis, the last but one, so that a flat batch and
samples that share one topology go through the same code.
"""

from collections.abc import Sequence
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor, nn

from jenga_models.graphs import Graphs


def mlp(inputs: int, width: int, outputs: int, hidden_layers: int, norm: bool) -> nn.Sequential:
    """Linear layers with ReLU between them, `hidden_layers` of them hidden, and a layer norm behind if `norm`."""
    sizes = [inputs, *[width] * hidden_layers, outputs]
    layers: list[nn.Module] = []
    for before, after in pairwise(sizes):
        layers += [nn.Linear(before, after), nn.ReLU()]
    layers.pop()
    return nn.Sequential(*layers, nn.LayerNorm(outputs)) if norm else nn.Sequential(*layers)


class SplitLinear(nn.Linear):
    """A linear layer over several inputs side by side, applied to each of them on its own.

    W [a, b, c] = Wa a + Wb b + Wc c: what belongs to a node is multiplied once a node and not once an edge, and
    what belongs to a graph once a graph. The bias comes with the first input.
    """

    def __init__(self, widths: Sequence[int], outputs: int) -> None:
        super().__init__(sum(widths), outputs)
        self.widths = list(widths)

    def part(self, which: int, values: Float[Tensor, "*batch part"]) -> Float[Tensor, "*batch output"]:
        return nn.functional.linear(values, self._weight(which), self.bias if which == 0 else None)

    def add_part_(
        self, total: Float[Tensor, "*batch output"], which: int, values: Float[Tensor, "*#batch part"]
    ) -> Float[Tensor, "*batch output"]:
        """Add a part in place, without its product in memory where there is one value for each row of `total`."""
        if values.shape[:-1] != total.shape[:-1]:
            return total.add_(self.part(which, values))
        total.view(-1, total.shape[-1]).addmm_(values.flatten(0, -2), self._weight(which).t())
        return total

    def _weight(self, which: int) -> Float[Tensor, "output part"]:
        return self.weight.split(self.widths, dim=1)[which]


def _before_message(first: SplitLinear, node: Tensor, edge: Tensor, graphs: Graphs) -> Tensor:
    """first([receiver, sender, edge]) for every edge."""
    sender, receiver = graphs.edge_index
    at_receiver = first.part(0, node).index_select(-2, receiver)
    at_sender = first.part(1, node).index_select(-2, sender)
    # In place: these are the largest tensors of a forward pass, which on a CPU waits for memory.
    return first.add_part_(at_receiver.add_(at_sender), 2, edge)


def _gathered(messages: Tensor, node: Tensor, graphs: Graphs) -> Tensor:
    """The sum of the messages that reach each node."""
    if graphs.edge_mask is not None:
        messages = messages * graphs.edge_mask[..., None]
    empty = messages.new_zeros(*node.shape[:-1], messages.shape[-1])
    return empty.index_add(-2, graphs.edge_index[1], messages)


class MemoryInteraction(nn.Module):
    """One processing layer of the GNS (Sanchez-Gonzalez 2020, arXiv 2002.09405, section 3.2).

    e' = MLP([v_r, v_s, e]), v' = MLP([v, sum of e' at r]), and both are added to what was there.
    """

    def __init__(self, width: int, hidden_layers: int) -> None:
        super().__init__()
        self.first = SplitLinear([width] * 3, width)
        self.message = nn.Sequential(nn.ReLU(), mlp(width, width, width, hidden_layers - 1, norm=True))
        self.update = mlp(2 * width, width, width, hidden_layers, norm=True)

    def forward(self, node: Tensor, edge: Tensor, graphs: Graphs) -> tuple[Tensor, Tensor]:
        message = self.message(_before_message(self.first, node, edge, graphs))
        update = self.update(torch.cat([node, _gathered(message, node, graphs)], dim=-1))
        return node + update, edge + message


class LightInteraction(nn.Module):
    """The same without a state on the edges: v' = v + MLP([v, sum of ReLU(W [v_r, v_s, a])]), a the attributes.

    A message MLP that ends in a linear layer may be summed before that layer, and the layer is then one with the
    first of the update MLP: this is an interaction network with one hidden layer a message. Attributes enter as
    they are, so that no edge costs a product of width x width.
    """

    def __init__(self, width: int, edge_width: int, hidden_layers: int) -> None:
        super().__init__()
        self.first = SplitLinear([width, width, edge_width], width)
        self.update = mlp(2 * width, width, width, hidden_layers, norm=True)

    def forward(self, node: Tensor, edge: Tensor, graphs: Graphs) -> tuple[Tensor, Tensor]:
        message = _before_message(self.first, node, edge, graphs).relu_()
        return node + self.update(torch.cat([node, _gathered(message, node, graphs)], dim=-1)), edge
