"""Records of an episode as messages of proto/jenga.proto and back. Every `read_` refuses what does not fit.

Arrays of doubles go into packed fields byte by byte (`packed`): the same bytes as protobuf's own, 50 times faster
than number by number.

Raises:
    ValueError: on any `read_`, with what was found and what is allowed; the caller knows the file's name.
"""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from google.protobuf.message import DecodeError, Message
from jaxtyping import Float

from jenga_data.blocks import Blocks
from jenga_data.episode import (
    Action,
    Contacts,
    EpisodeHeader,
    Frame,
    GripperSample,
    GripperTrack,
    Link,
    Phase,
    Result,
    RobotModel,
    RobotState,
    Solid,
)
from jenga_data.limits import MAX_BLOCKS, MAX_PARTS
from jenga_data.log.profile import CONTACTS
from jenga_data.log.proto import jenga_pb2 as pb
from jenga_data.outcome import Outcome, Verdict
from jenga_data.tower import SLOTS, Layout

M = TypeVar("M", bound=Message)

_DIMENSIONS = {"box": 3, "sphere": 1, "cylinder": 2, "capsule": 2}
"""How many of a solid's three sizes mean something; the others are 0."""
UNIT_TOLERANCE = 1e-6
"""How far a quaternion's length may be from 1; simulators keep it within 1e-12."""


def packed(field: int, values: Float[np.ndarray, "..."]) -> bytes:
    """A packed `repeated double` field as protobuf serializes it; nothing for an empty array."""
    if not values.size:
        return b""
    data = np.ascontiguousarray(values, "<f8").tobytes()
    return _varint(field << 3 | 2) + _varint(len(data)) + data


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def doubles(values: object, *shape: int) -> np.ndarray:
    """A repeated field as a new array of the given shape (one axis may be -1)."""
    array = np.array(values, np.float64)
    try:
        return array.reshape(shape)
    except ValueError:
        want = " x ".join("n" if n < 0 else str(n) for n in shape)
        raise ValueError(f"{array.size} numbers where {want} are needed") from None


def parse(kind: type[M], data: bytes) -> M:
    try:
        return kind.FromString(data)
    except DecodeError:
        raise ValueError(f"{len(data)} bytes that are no {kind.DESCRIPTOR.full_name}") from None


# --- the tower -----------------------------------------------------------------------------------------------------


def write_tower(header: EpisodeHeader) -> pb.Tower:
    return pb.Tower(
        size=header.blocks.size.ravel().tolist(),
        mass=header.blocks.mass.tolist(),
        level=header.layout.level.tolist(),
        slot=header.layout.slot.tolist(),
        moves=header.layout.moves,
        target=header.target,
        turn=header.turn,
        face=header.face,
        wedge=header.blocks.wedge.tolist() if header.blocks.wedge.any() else [],
    )


def read_tower(data: bytes) -> tuple[Blocks, Layout, pb.Tower]:
    """The blocks, where they lie in the game, and the message for target, turn and face."""
    tower = parse(pb.Tower, data)
    count = len(tower.mass)
    if not 0 < count <= MAX_BLOCKS:
        raise ValueError(f"a tower of {count} blocks; allowed: 1 to {MAX_BLOCKS}")
    size, mass = doubles(tower.size, count, 3), doubles(tower.mass, count)
    wedge = doubles(tower.wedge, count) if tower.wedge else np.zeros(count)
    if not all(np.isfinite(values).all() for values in (size, mass, wedge)):
        raise ValueError("sizes, masses or wedges that are no finite numbers")
    level, slot = np.array(tower.level, np.int64), np.array(tower.slot, np.int64)
    if not len(level) == len(slot) == count:
        raise ValueError(f"{len(level)} levels and {len(slot)} slots for {count} blocks")
    if level.min() < 0 or level.max() >= MAX_BLOCKS or slot.min() < 0 or slot.max() >= SLOTS:
        raise ValueError(f"a level or slot out of range; allowed: levels 0 to {MAX_BLOCKS - 1}, slots 0 to {SLOTS - 1}")
    for name, value, limit in (("target", tower.target, count), ("turn", tower.turn, 4), ("face", tower.face, 2)):
        if not 0 <= value < limit:
            raise ValueError(f"{name} is {value}; allowed: 0 to {limit - 1}")
    return Blocks(size, mass, wedge), Layout.from_places(level, slot, tower.moves), tower


# --- the robot -----------------------------------------------------------------------------------------------------


def write_robot(robot: RobotModel) -> pb.Robot:
    return pb.Robot(
        joint=robot.joints,
        link=[
            pb.Link(
                name=link.name,
                solid=[pb.Solid(shape=s.shape, size=s.size, pose=s.pose, color=s.color) for s in link.solids],
            )
            for link in robot.links
        ],
    )


def read_robot(data: bytes) -> RobotModel:
    robot = parse(pb.Robot, data)
    joints, links = tuple(robot.joint), tuple(link.name for link in robot.link)
    for what, names in (("joints", joints), ("links", links)):
        if len(names) > MAX_PARTS:
            raise ValueError(f"a robot of {len(names)} {what}; allowed: up to {MAX_PARTS}")
        for name in names:
            if not name or not name.isprintable():
                raise ValueError(f"{what} named {name[:40]!r}; allowed: one printable character or more")
        if len(set(names)) < len(names):
            raise ValueError(f"two {what} named {next(n for n in names if names.count(n) > 1)[:40]!r}; allowed: one")
    return RobotModel(joints, tuple(_read_link(link) for link in robot.link))


def _read_link(link: pb.Link) -> Link:
    if len(link.solid) > MAX_PARTS:
        raise ValueError(f"link {link.name[:40]!r} of {len(link.solid)} solids; allowed: up to {MAX_PARTS}")
    try:
        return Link(link.name, tuple(_read_solid(solid) for solid in link.solid))
    except ValueError as error:
        raise ValueError(f"link {link.name[:40]!r}: {error}") from None


def _read_solid(solid: pb.Solid) -> Solid:
    if solid.shape not in _DIMENSIONS:
        raise ValueError(f"shape {solid.shape[:40]!r}; allowed: {', '.join(_DIMENSIONS)}")
    size, pose, color = doubles(solid.size, 3), doubles(solid.pose, 7), doubles(solid.color, 4)
    needed = _DIMENSIONS[solid.shape]
    if not ((size[:needed] > 0) & (size[:needed] < np.inf)).all() or size[needed:].any():
        raise ValueError(f"{solid.shape} of size {solid.size}; allowed: {needed} positive numbers, then zeros")
    if not np.isfinite(pose).all() or abs(np.linalg.norm(pose[3:]) - 1) > UNIT_TOLERANCE:
        raise ValueError(f"{solid.shape} at {solid.pose}; allowed: finite numbers and a quaternion of length 1")
    if not ((color >= 0) & (color <= 1)).all():
        raise ValueError(f"{solid.shape} of color {solid.color}; allowed: 0 to 1")
    (sx, sy, sz), (x, y, z, qw, qx, qy, qz), (red, green, blue, alpha) = solid.size, solid.pose, solid.color
    return Solid(solid.shape, (sx, sy, sz), (x, y, z, qw, qx, qy, qz), (red, green, blue, alpha))


def frame_of(topic: str, data: bytes) -> int:
    """The number of the frame that a state or contacts belong to."""
    return parse(pb.Contacts if topic == CONTACTS else pb.TowerState, data).frame


# --- one control step ----------------------------------------------------------------------------------------------


def write_state(frame: Frame) -> bytes:
    head = pb.TowerState(frame=frame.index).SerializeToString()
    pose = packed(pb.TowerState.POSE_FIELD_NUMBER, frame.pose)
    twist = packed(pb.TowerState.TWIST_FIELD_NUMBER, frame.twist)
    return head + pose + twist + pb.TowerState(turntable=frame.turntable).SerializeToString()


def read_state(data: bytes, blocks: int) -> tuple[int, tuple[np.ndarray, np.ndarray, float]]:
    """Frame number, pose (block, 7), twist (block, 6) and the turntable's angle [rad]."""
    state = parse(pb.TowerState, data)
    return state.frame, (doubles(state.pose, blocks, 7), doubles(state.twist, blocks, 6), state.turntable)


def write_robot_state(index: int, state: RobotState) -> bytes:
    kind = pb.RobotState
    return kind(frame=index).SerializeToString() + b"".join(
        packed(field, values)
        for field, values in (
            (kind.POSITION_FIELD_NUMBER, state.position),
            (kind.VELOCITY_FIELD_NUMBER, state.velocity),
            (kind.TORQUE_FIELD_NUMBER, state.torque),
            (kind.LINK_POSE_FIELD_NUMBER, state.link_pose),
        )
    )


def read_robot_state(data: bytes, robot: RobotModel) -> tuple[int, RobotState]:
    """Frame number and the state of `robot`."""
    state, joints = parse(pb.RobotState, data), len(robot.joints)
    position, velocity, torque = (doubles(v, joints) for v in (state.position, state.velocity, state.torque))
    return state.frame, RobotState(position, velocity, torque, doubles(state.link_pose, len(robot.links), 7))


def write_contacts(frame: Frame) -> bytes:
    contacts = frame.contacts
    head = pb.Contacts(frame=frame.index, first=contacts.first.tolist(), second=contacts.second.tolist())
    return head.SerializeToString() + packed(pb.Contacts.FORCE_FIELD_NUMBER, contacts.force)


def read_contacts(data: bytes) -> tuple[int, Contacts]:
    message = parse(pb.Contacts, data)
    first, second = np.array(message.first, np.int64), np.array(message.second, np.int64)
    if len(first) != len(second):
        raise ValueError(f"{len(first)} first and {len(second)} second bodies of a contact")
    return message.frame, Contacts(first, second, doubles(message.force, len(first), 3))


def write_sim_state(frame: Frame) -> bytes:
    head = pb.SimState(frame=frame.index).SerializeToString()
    return head + packed(pb.SimState.STATE_FIELD_NUMBER, frame.sim_state)


def read_sim_state(data: bytes) -> tuple[int, Float[np.ndarray, " state"]]:
    message = parse(pb.SimState, data)
    return message.frame, doubles(message.state, -1)


# --- what was done, and what came of it ----------------------------------------------------------------------------


def write_action(action: Action) -> pb.Action:
    return pb.Action(
        frame=action.frame,
        displacement=action.displacement.tolist(),
        reached=action.reached.tolist(),
        wanted=None if action.wanted is None else action.wanted.tolist(),
    )


def read_action(data: bytes, time_ns: int) -> Action:
    action = parse(pb.Action, data)
    wanted = doubles(action.wanted, 3) if action.wanted else None
    return Action(action.frame, time_ns, doubles(action.displacement, 3), doubles(action.reached, 3), wanted)


def write_gripper(sample: GripperSample) -> pb.Gripper:
    return pb.Gripper(
        pose=sample.pose.tolist(),
        width=sample.width,
        left_force=sample.left_force.tolist(),
        right_force=sample.right_force.tolist(),
    )


def read_gripper(data: bytes, time_ns: int) -> GripperSample:
    gripper = parse(pb.Gripper, data)
    left, right = doubles(gripper.left_force, 3), doubles(gripper.right_force, 3)
    return GripperSample(time_ns, doubles(gripper.pose, 7), gripper.width, left, right)


def read_gripper_track(messages: Sequence[tuple[int, bytes]]) -> GripperTrack:
    """All samples in the order of their times [ns], from the (time, data) of each message."""
    ordered = sorted(messages, key=lambda message: message[0])
    samples = [parse(pb.Gripper, data) for _, data in ordered]
    for sample in samples:
        if len(sample.pose) != 7 or len(sample.left_force) != 3 or len(sample.right_force) != 3:
            read_gripper(sample.SerializeToString(), 0)  # says what is wrong with it
    return GripperTrack(
        time_ns=np.array([time for time, _ in ordered], np.int64),
        pose=np.array([list(s.pose) for s in samples]).reshape(-1, 7),
        width=np.array([s.width for s in samples], np.float64),
        left_force=np.array([list(s.left_force) for s in samples]).reshape(-1, 3),
        right_force=np.array([list(s.right_force) for s in samples]).reshape(-1, 3),
    )


def write_phase(phase: Phase) -> pb.Phase:
    return pb.Phase(frame=phase.frame, name=phase.name)


def read_phase(data: bytes, time_ns: int) -> Phase:
    phase = parse(pb.Phase, data)
    return Phase(phase.frame, time_ns, phase.name)


def write_outcome(result: Result) -> pb.Outcome:
    verdict = result.verdict
    return pb.Outcome(
        label=verdict.outcome.value,
        dragged=bool(verdict.dragged),
        moved=verdict.moved,
        clear_frame=verdict.clear_frame,
        cause=result.cause,
    )


def read_outcome(data: bytes) -> Result:
    outcome = parse(pb.Outcome, data)
    if outcome.label not in list(Outcome):
        raise ValueError(f"outcome {outcome.label!r}; allowed: {', '.join(Outcome)}")
    verdict = Verdict(Outcome(outcome.label), outcome.dragged, outcome.moved, outcome.clear_frame)
    return Result(verdict, outcome.cause)
