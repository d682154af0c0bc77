"""What a sampling controller considered at each of its decisions, for replay to draw: arrays, whoever made them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True, eq=False)
class Plans:
    """Plans of every decision as ways through the air: `path` of all samples, `chosen` of what was decided on [m].

    The first point of each way is where the hand was. `note` says in words how they came about.
    """

    frame: Int[np.ndarray, " decision"]
    path: Float[np.ndarray, "decision sample point 3"]
    chosen: Float[np.ndarray, "decision point 3"]
    note: str = ""

    @classmethod
    def of_displacements(
        cls,
        frame: Int[np.ndarray, " decision"],
        start: Float[np.ndarray, "decision 3"],
        plans: Float[np.ndarray, "decision sample horizon 3"],
        chosen: Float[np.ndarray, "decision horizon 3"],
        note: str = "",
    ) -> "Plans":
        """From where the hand was and the displacements that were planned [m]."""
        return cls(frame, _way(start[:, None], plans), _way(start, chosen), note)


def _way(
    start: Float[np.ndarray, "*batch 3"], steps: Float[np.ndarray, "*more step 3"]
) -> Float[np.ndarray, "*more point 3"]:
    travelled = np.cumsum(steps, axis=-2)
    return start[..., None, :] + np.concatenate([np.zeros_like(travelled[..., :1, :]), travelled], axis=-2)
