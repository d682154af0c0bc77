"""What else became of a pull, for a selector to learn beside its label.

A label is one bit. How a pull ended, whether it dragged another block along and how far the others moved say more of
the same physics, and a network that has to say them as well needs fewer towers (multi-task learning, Caruana 1997,
https://doi.org/10.1023/A:1007379606734).
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn import functional

from jenga_data.clock import MOMENTS
from jenga_data.outcome import Outcome
from jenga_models.columns import Rows

OUTCOMES = (Outcome.EXTRACTED, Outcome.STUCK, Outcome.COLLAPSED)
WIDTH = len(OUTCOMES) + 2
"""Numbers that a network says: logits of the outcomes, logit of dragged, decimal logarithm of how far others moved."""
CREEP = 1e-4
"""Others move by this far without a pull [m]: below it, differences mean nothing."""
CENTIMETRE = 1e-2


STILL = 1e-3
"""Motions of blocks count in units of their inverse hyperbolic sine: as they are up to about so far [m], as their
logarithm beyond."""
MOTION = 2 * len(MOMENTS)
"""Numbers that a network says of the motion of a block: along the pull and across it, for each moment."""


@dataclass(frozen=True, eq=False)
class Judgement:
    """What a network says of pulls: of the label, the verdicts and the motion of every block."""

    label: Float[Tensor, "member graph class"]
    verdict: Float[Tensor, "member graph verdict"]
    motion: Float[Tensor, "member node motion"]


def with_verdicts(dataset: Rows, label: Int[Tensor, " row"]) -> Float[Tensor, "row wanted"]:
    """The label, and beside it the number of the outcome, dragged, log10 of how far others moved [cm], and the motions
    of all blocks."""
    outcome = np.array([OUTCOMES.index(Outcome(name)) for name in dataset.column("outcome")])
    moved = np.log10((dataset.column("moved") + CREEP) / CENTIMETRE)
    also = np.stack([outcome, dataset.column("dragged"), moved], axis=1)
    along, across = _along_and_across(dataset.column("block_moved"))
    motion = np.concatenate([along, across], axis=1).swapaxes(1, 2)  # [row, block, motion]
    return torch.cat([label[:, None], torch.from_numpy(also), torch.from_numpy(motion).flatten(1)], dim=1).float()


def _along_and_across(
    moved: Float[np.ndarray, "row moment block 3"],
) -> tuple[Float[np.ndarray, "row moment block"], Float[np.ndarray, "row moment block"]]:
    """Along the pull, which goes to -x, and off its line, both squeezed."""
    return np.arcsinh(-moved[..., 0] / STILL), np.arcsinh(np.linalg.norm(moved[..., 1:], axis=-1) / STILL)


def labels(wanted: Tensor) -> Int[Tensor, " graph"]:
    """The labels alone, of batches with verdicts and of batches without."""
    return wanted if wanted.ndim == 1 else wanted[:, 0].long()


def verdict_loss(said: Float[Tensor, "member graph verdict"], wanted: Float[Tensor, "graph wanted"]) -> Tensor:
    """Cross-entropy of outcome and dragged, and squared error of the logarithm, each with the same weight."""
    outcome, dragged, moved = said[..., : len(OUTCOMES)], said[..., -2], said[..., -1]
    number = wanted[:, 1].long().repeat(len(said))
    return (
        functional.cross_entropy(outcome.flatten(0, 1), number)
        + functional.binary_cross_entropy_with_logits(dragged, wanted[:, 2].expand_as(dragged))
        + functional.mse_loss(moved, wanted[:, 3].expand_as(moved))
    )


def motion_loss(said: Float[Tensor, "member node motion"], wanted: Float[Tensor, "graph wanted"]) -> Tensor:
    """Mean squared error over all blocks, the target among them."""
    return functional.mse_loss(said, wanted[:, 4:].reshape(-1, MOTION).expand_as(said))
