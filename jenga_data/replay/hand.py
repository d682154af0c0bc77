"""The gripper as boxes: a palm, two fingers and two pads, as a viewer draws them.

The gripper's frame lies between the fingertips: x points from the palm to the tips, y from the right to the left
finger, z completes the right-handed frame. The sizes are for the eye; the log holds the frame and the opening only.
"""

import numpy as np
from jaxtyping import Float

from jenga_data.geometry import rotation_matrices
from jenga_data.palette import RUBBER, STEEL

_PAD = (0.016, 0.008, 0.011)
_LINK = (0.045, 0.008, 0.012)
_PALM = (0.030, 0.090, 0.036)
_LINK_X, _PALM_X = -0.030, -0.066

SIZE: Float[np.ndarray, "5 3"] = np.array([_PALM, _LINK, _LINK, _PAD, _PAD])
"""Full edge lengths [m] of the palm, the left and right finger, and the left and right pad."""
PALM, LEFT_PAD, RIGHT_PAD = 0, 3, 4
"""Rows of `SIZE` that touch something."""
COLOUR: Float[np.ndarray, "5 3"] = np.array([STEEL, STEEL, STEEL, RUBBER, RUBBER])


def hand_poses(
    pose: Float[np.ndarray, "*batch 7"], width: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch 5 7"]:
    """Poses in the world of the boxes in `SIZE`, for a gripper opened by `width` [m]."""
    offset = np.zeros((*width.shape, 5, 3))
    offset[..., 0, 0] = _PALM_X
    offset[..., 1:3, 0] = _LINK_X
    side = width[..., None] / 2 + _PAD[1] / 2
    offset[..., 1::2, 1] = side
    offset[..., 2::2, 1] = -side
    centre = pose[..., None, :3] + np.einsum("...ij,...bj->...bi", rotation_matrices(pose[..., 3:]), offset)
    return np.concatenate([centre, np.broadcast_to(pose[..., None, 3:], (*centre.shape[:-1], 4))], axis=-1)
