"""What else became of a pull, for a selector to learn beside its label.

A label is one bit. How a pull ended, whether it dragged another block along and how far the others moved say more of
the same physics, and a network that has to say them as well needs fewer towers (multi-task learning, Caruana 1997,
https://doi.org/10.1023/A:1007379606734).
"""

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn import functional

from jenga_data.outcome import Outcome
from jenga_models.columns import Rows

OUTCOMES = (Outcome.EXTRACTED, Outcome.STUCK, Outcome.COLLAPSED)
WIDTH = len(OUTCOMES) + 2
"""Numbers that a network says: logits of the outcomes, logit of dragged, decimal logarithm of how far others moved."""
CREEP = 1e-4
"""Others move by this far without a pull [m]: below it, differences mean nothing."""
CENTIMETRE = 1e-2


def with_verdicts(dataset: Rows, label: Int[Tensor, " row"]) -> Float[Tensor, "row 4"]:
    """The label, and beside it the number of the outcome, dragged, and log10 of how far others moved [cm]."""
    outcome = np.array([OUTCOMES.index(Outcome(name)) for name in dataset.column("outcome")])
    moved = np.log10((dataset.column("moved") + CREEP) / CENTIMETRE)
    also = np.stack([outcome, dataset.column("dragged"), moved], axis=1)
    return torch.cat([label[:, None].float(), torch.from_numpy(also).float()], dim=1)


def labels(wanted: Tensor) -> Int[Tensor, " graph"]:
    """The labels alone, of batches with verdicts and of batches without."""
    return wanted if wanted.ndim == 1 else wanted[:, 0].long()


def verdict_loss(said: Float[Tensor, "member graph 5"], wanted: Float[Tensor, "graph 4"]) -> Tensor:
    """Cross-entropy of outcome and dragged, and squared error of the logarithm, each with the same weight."""
    outcome, dragged, moved = said[..., : len(OUTCOMES)], said[..., -2], said[..., -1]
    number = wanted[:, 1].long().repeat(len(said))
    return (
        functional.cross_entropy(outcome.flatten(0, 1), number)
        + functional.binary_cross_entropy_with_logits(dragged, wanted[:, 2].expand_as(dragged))
        + functional.mse_loss(moved, wanted[:, 3].expand_as(moved))
    )
