"""What a stock viewer draws: poses as foxglove.FrameTransforms, and lines of text as foxglove.Log."""

from collections.abc import Sequence

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from jaxtyping import Float

from jenga_data.geometry import rotation_matrices
from jenga_data.log.urdf import HAND, LEFT_FINGER, RIGHT_FINGER, WORLD

GRIPPER_LINKS = (HAND, LEFT_FINGER, RIGHT_FINGER)


class Transforms:
    """Poses of a fixed list of bodies as one message, the same one filled anew each time: that is several times
    faster than building it from new objects."""

    def __init__(self, links: Sequence[str], parent: str = WORLD) -> None:
        self._message = FrameTransforms()
        for link in links:
            self._message.transforms.add(parent_frame_id=parent, child_frame_id=link)
        self._parts = [(t.timestamp, t.translation, t.rotation) for t in self._message.transforms]

    def fill(self, pose: Float[np.ndarray, "body 7"], time_ns: int) -> FrameTransforms:
        """The message for these poses. It is overwritten by the next call."""
        seconds, nanos = divmod(time_ns, 1_000_000_000)
        for (stamp, translation, rotation), (x, y, z, qw, qx, qy, qz) in zip(self._parts, pose.tolist(), strict=True):
            stamp.seconds, stamp.nanos = seconds, nanos
            translation.x, translation.y, translation.z = x, y, z
            rotation.w, rotation.x, rotation.y, rotation.z = qw, qx, qy, qz
        return self._message


def gripper_poses(pose: Float[np.ndarray, "7"], width: float) -> Float[np.ndarray, "3 7"]:
    """Poses of hand, left and right finger; the fingers stand half the width away from the middle, along y."""
    out = np.tile(pose, (3, 1))
    across = rotation_matrices(pose[3:])[:, 1] * width / 2
    out[1, :3] += across
    out[2, :3] -= across
    return out


def log_text(text: str, source: str, time_ns: int) -> Log:
    """A line for the viewer's text log."""
    log = Log(level=Log.Level.INFO, message=text, name=source)
    log.timestamp.FromNanoseconds(time_ns)
    return log
