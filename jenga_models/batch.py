"""What a network is trained on in one step."""

from dataclasses import dataclass

import torch
from torch import Tensor

from jenga_models.graphs import Graphs


@dataclass(frozen=True, eq=False)
class Batch:
    """Graphs and what the network should say of them."""

    graphs: Graphs
    wanted: Tensor

    def __len__(self) -> int:
        return len(self.graphs)

    def to(self, device: torch.device, non_blocking: bool = False) -> "Batch":
        return Batch(self.graphs.to(device, non_blocking), self.wanted.to(device, non_blocking=non_blocking))
