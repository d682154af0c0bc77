"""Which block next: all legal targets of a tower by how likely pulling them fails."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from jenga_data.errors import JengaError
from jenga_data.tower import TowerState


@runtime_checkable
class Selector(Protocol):
    """What ranking asks of a model; `jenga_models.predict.Selector` is one, yours can be another."""

    def failure_probability(self, state: TowerState, targets: Sequence[int]) -> Float[np.ndarray, " target"]: ...


def rank(state: TowerState, selector: Selector) -> list[tuple[int, float]]:
    """All legal targets with their probability of failure, the safest first, equally safe ones by number.

    Raises:
        JengaError: the tower has no legal target, or a probability is no number between 0 and 1.
    """
    targets = state.layout.legal_targets()
    if not targets:
        raise JengaError(
            f"a tower of {len(state.layout.grid)} levels in round {state.layout.round} has no legal target left; "
            "a target lies below the highest completed level and leaves the centre block or both side blocks"
        )
    probability = selector.failure_probability(state, targets)
    if not ((probability >= 0) & (probability <= 1)).all():
        raise JengaError(
            "the selector's probabilities are not all between 0 and 1: its weights are no use, train again"
        )
    order = np.argsort(probability, kind="stable")
    return [(targets[i], float(probability[i])) for i in order]
