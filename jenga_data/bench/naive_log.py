"""The log as one would write and read it first: what `jenga bench log` compares the real writer and reader with."""

from pathlib import Path

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.reader import make_reader

from jenga_data.episode import Frame
from jenga_data.log import profile
from jenga_data.log.gather import MESSAGES
from jenga_data.log.output import Output
from jenga_data.log.proto import jenga_pb2 as pb
from jenga_data.log.urdf import WORLD, block_link


def write_naively(path: Path, frames: list[Frame]) -> int:
    """Write the frames into the same topics of the same container, every message a new object, number by number.

    Returns:
        How many messages were written.
    """
    out = Output(path, profile.PROFILE)
    for frame in frames:
        out.message(profile.STATE, _state(frame), frame.time_ns)
        contacts = pb.Contacts(frame=frame.index)
        for first, second, force in zip(frame.contacts.first, frame.contacts.second, frame.contacts.force, strict=True):
            contacts.first.append(int(first))
            contacts.second.append(int(second))
            contacts.force.extend(float(value) for value in force)
        out.message(profile.CONTACTS, contacts, frame.time_ns)
        state = pb.SimState(frame=frame.index, state=[float(value) for value in frame.sim_state])
        out.message(profile.SIM, state, frame.time_ns)
        out.message(profile.TF, _transforms(frame), frame.time_ns)
    out.commit()
    return 4 * len(frames)


def _state(frame: Frame) -> pb.TowerState:
    return pb.TowerState(
        frame=frame.index,
        pose=[float(value) for row in frame.pose for value in row],
        twist=[float(value) for row in frame.twist for value in row],
        turntable=frame.turntable,
    )


def _transforms(frame: Frame) -> FrameTransforms:
    message = FrameTransforms()
    seconds, nanos = divmod(frame.time_ns, 1_000_000_000)
    for block, (x, y, z, qw, qx, qy, qz) in enumerate(frame.pose):
        message.transforms.append(
            FrameTransform(
                timestamp=Timestamp(seconds=seconds, nanos=nanos),
                parent_frame_id=WORLD,
                child_frame_id=block_link(block),
                translation=Vector3(x=x, y=y, z=z),
                rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
            )
        )
    return message


def read_naively(path: Path) -> tuple[int, dict[str, list[np.ndarray]]]:
    """Read message by message through mcap, each array field an array.

    Returns:
        How many messages were read, and the arrays by topic.
    """
    count, arrays = 0, dict[str, list[np.ndarray]]()
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            if (kind := MESSAGES.get(channel.topic)) is None:
                continue
            count += 1
            for field, value in kind.FromString(message.data).ListFields():
                if field.type == field.TYPE_DOUBLE and field.is_repeated:
                    arrays.setdefault(channel.topic, []).append(np.array([float(number) for number in value]))
    return count, arrays
