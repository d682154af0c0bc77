"""One episode with all that is drawn over it."""

from collections.abc import Sequence
from dataclasses import dataclass

from jenga_data.episode import Episode, Prediction
from jenga_data.replay.plans import Plans


@dataclass(frozen=True, eq=False)
class Shown:
    """An episode, what models say of it, and what its controller considered."""

    episode: Episode
    predictions: Sequence[Prediction] = ()
    plans: Plans | None = None
    notes: Sequence[str] = ()
    """What was asked for and cannot be shown, and why."""
