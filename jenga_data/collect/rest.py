"""When a tower is at rest: the one criterion for a tower that is spawned and for one that was pulled at."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jenga_data.clock import CONTROL_STEP_NS

WINDOW = 8
"""Frames over which a tower is watched before it counts as resting: 0.256 s, in which a block that lost its support
falls by 0.3 m, and in which a whole tower that tips over doubles its speed (its time constant is about 0.2 s)."""
REST_SPEED = 0.0005
"""No block of a resting tower gets on by more than this [m/s]: a tenth of this is creep, and a fall passes through it
in a hundredth of a second."""


def at_rest(poses: Sequence[Float[np.ndarray, "block 7"]], ignore: int = -1) -> bool:
    """Whether no block moved by more than `REST_SPEED` allows over the last `WINDOW` frames.

    Displacement is judged and not velocity: loose blocks rattle by some hundredths of a millimetre without getting on.

    Args:
        poses: one entry a frame, the latest last.
        ignore: a block that may move, such as the one that is being carried away; -1 for none.
    """
    if len(poses) <= WINDOW:
        return False
    moved = np.linalg.norm(poses[-1][:, :3] - poses[-1 - WINDOW][:, :3], axis=1)
    if ignore >= 0:
        moved[ignore] = 0.0
    return bool(moved.max() <= REST_SPEED * WINDOW * CONTROL_STEP_NS * 1e-9)
