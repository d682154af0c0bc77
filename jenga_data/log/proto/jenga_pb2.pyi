from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Tower(_message.Message):
    __slots__ = ("size", "mass", "level", "slot", "moves", "target", "turn", "face", "wedge")
    SIZE_FIELD_NUMBER: _ClassVar[int]
    MASS_FIELD_NUMBER: _ClassVar[int]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    SLOT_FIELD_NUMBER: _ClassVar[int]
    MOVES_FIELD_NUMBER: _ClassVar[int]
    TARGET_FIELD_NUMBER: _ClassVar[int]
    TURN_FIELD_NUMBER: _ClassVar[int]
    FACE_FIELD_NUMBER: _ClassVar[int]
    WEDGE_FIELD_NUMBER: _ClassVar[int]
    size: _containers.RepeatedScalarFieldContainer[float]
    mass: _containers.RepeatedScalarFieldContainer[float]
    level: _containers.RepeatedScalarFieldContainer[int]
    slot: _containers.RepeatedScalarFieldContainer[int]
    moves: int
    target: int
    turn: int
    face: int
    wedge: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, size: _Optional[_Iterable[float]] = ..., mass: _Optional[_Iterable[float]] = ..., level: _Optional[_Iterable[int]] = ..., slot: _Optional[_Iterable[int]] = ..., moves: _Optional[int] = ..., target: _Optional[int] = ..., turn: _Optional[int] = ..., face: _Optional[int] = ..., wedge: _Optional[_Iterable[float]] = ...) -> None: ...

class TowerState(_message.Message):
    __slots__ = ("frame", "pose", "twist", "turntable")
    FRAME_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    TWIST_FIELD_NUMBER: _ClassVar[int]
    TURNTABLE_FIELD_NUMBER: _ClassVar[int]
    frame: int
    pose: _containers.RepeatedScalarFieldContainer[float]
    twist: _containers.RepeatedScalarFieldContainer[float]
    turntable: float
    def __init__(self, frame: _Optional[int] = ..., pose: _Optional[_Iterable[float]] = ..., twist: _Optional[_Iterable[float]] = ..., turntable: _Optional[float] = ...) -> None: ...

class Contacts(_message.Message):
    __slots__ = ("frame", "first", "second", "force")
    FRAME_FIELD_NUMBER: _ClassVar[int]
    FIRST_FIELD_NUMBER: _ClassVar[int]
    SECOND_FIELD_NUMBER: _ClassVar[int]
    FORCE_FIELD_NUMBER: _ClassVar[int]
    frame: int
    first: _containers.RepeatedScalarFieldContainer[int]
    second: _containers.RepeatedScalarFieldContainer[int]
    force: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, frame: _Optional[int] = ..., first: _Optional[_Iterable[int]] = ..., second: _Optional[_Iterable[int]] = ..., force: _Optional[_Iterable[float]] = ...) -> None: ...

class SimState(_message.Message):
    __slots__ = ("frame", "state")
    FRAME_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    frame: int
    state: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, frame: _Optional[int] = ..., state: _Optional[_Iterable[float]] = ...) -> None: ...

class Robot(_message.Message):
    __slots__ = ("joint", "link")
    JOINT_FIELD_NUMBER: _ClassVar[int]
    LINK_FIELD_NUMBER: _ClassVar[int]
    joint: _containers.RepeatedScalarFieldContainer[str]
    link: _containers.RepeatedCompositeFieldContainer[Link]
    def __init__(self, joint: _Optional[_Iterable[str]] = ..., link: _Optional[_Iterable[_Union[Link, _Mapping]]] = ...) -> None: ...

class Link(_message.Message):
    __slots__ = ("name", "solid")
    NAME_FIELD_NUMBER: _ClassVar[int]
    SOLID_FIELD_NUMBER: _ClassVar[int]
    name: str
    solid: _containers.RepeatedCompositeFieldContainer[Solid]
    def __init__(self, name: _Optional[str] = ..., solid: _Optional[_Iterable[_Union[Solid, _Mapping]]] = ...) -> None: ...

class Solid(_message.Message):
    __slots__ = ("shape", "size", "pose", "color")
    SHAPE_FIELD_NUMBER: _ClassVar[int]
    SIZE_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    COLOR_FIELD_NUMBER: _ClassVar[int]
    shape: str
    size: _containers.RepeatedScalarFieldContainer[float]
    pose: _containers.RepeatedScalarFieldContainer[float]
    color: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, shape: _Optional[str] = ..., size: _Optional[_Iterable[float]] = ..., pose: _Optional[_Iterable[float]] = ..., color: _Optional[_Iterable[float]] = ...) -> None: ...

class RobotState(_message.Message):
    __slots__ = ("frame", "position", "velocity", "torque", "link_pose")
    FRAME_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_FIELD_NUMBER: _ClassVar[int]
    TORQUE_FIELD_NUMBER: _ClassVar[int]
    LINK_POSE_FIELD_NUMBER: _ClassVar[int]
    frame: int
    position: _containers.RepeatedScalarFieldContainer[float]
    velocity: _containers.RepeatedScalarFieldContainer[float]
    torque: _containers.RepeatedScalarFieldContainer[float]
    link_pose: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, frame: _Optional[int] = ..., position: _Optional[_Iterable[float]] = ..., velocity: _Optional[_Iterable[float]] = ..., torque: _Optional[_Iterable[float]] = ..., link_pose: _Optional[_Iterable[float]] = ...) -> None: ...

class Action(_message.Message):
    __slots__ = ("frame", "displacement", "reached", "wanted")
    FRAME_FIELD_NUMBER: _ClassVar[int]
    DISPLACEMENT_FIELD_NUMBER: _ClassVar[int]
    REACHED_FIELD_NUMBER: _ClassVar[int]
    WANTED_FIELD_NUMBER: _ClassVar[int]
    frame: int
    displacement: _containers.RepeatedScalarFieldContainer[float]
    reached: _containers.RepeatedScalarFieldContainer[float]
    wanted: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, frame: _Optional[int] = ..., displacement: _Optional[_Iterable[float]] = ..., reached: _Optional[_Iterable[float]] = ..., wanted: _Optional[_Iterable[float]] = ...) -> None: ...

class Gripper(_message.Message):
    __slots__ = ("pose", "width", "left_force", "right_force")
    POSE_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    LEFT_FORCE_FIELD_NUMBER: _ClassVar[int]
    RIGHT_FORCE_FIELD_NUMBER: _ClassVar[int]
    pose: _containers.RepeatedScalarFieldContainer[float]
    width: float
    left_force: _containers.RepeatedScalarFieldContainer[float]
    right_force: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, pose: _Optional[_Iterable[float]] = ..., width: _Optional[float] = ..., left_force: _Optional[_Iterable[float]] = ..., right_force: _Optional[_Iterable[float]] = ...) -> None: ...

class Phase(_message.Message):
    __slots__ = ("frame", "name")
    FRAME_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    frame: int
    name: str
    def __init__(self, frame: _Optional[int] = ..., name: _Optional[str] = ...) -> None: ...

class Outcome(_message.Message):
    __slots__ = ("label", "dragged", "moved", "clear_frame", "cause")
    LABEL_FIELD_NUMBER: _ClassVar[int]
    DRAGGED_FIELD_NUMBER: _ClassVar[int]
    MOVED_FIELD_NUMBER: _ClassVar[int]
    CLEAR_FRAME_FIELD_NUMBER: _ClassVar[int]
    CAUSE_FIELD_NUMBER: _ClassVar[int]
    label: str
    dragged: bool
    moved: float
    clear_frame: int
    cause: str
    def __init__(self, label: _Optional[str] = ..., dragged: bool = ..., moved: _Optional[float] = ..., clear_frame: _Optional[int] = ..., cause: _Optional[str] = ...) -> None: ...

class Prediction(_message.Message):
    __slots__ = ("episode", "episode_sha256", "name", "checkpoint", "kind", "failure_probability")
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    EPISODE_SHA256_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    CHECKPOINT_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    FAILURE_PROBABILITY_FIELD_NUMBER: _ClassVar[int]
    episode: str
    episode_sha256: str
    name: str
    checkpoint: str
    kind: str
    failure_probability: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, episode: _Optional[str] = ..., episode_sha256: _Optional[str] = ..., name: _Optional[str] = ..., checkpoint: _Optional[str] = ..., kind: _Optional[str] = ..., failure_probability: _Optional[_Iterable[float]] = ...) -> None: ...

class PredictedState(_message.Message):
    __slots__ = ("frame", "pose")
    FRAME_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    frame: int
    pose: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, frame: _Optional[int] = ..., pose: _Optional[_Iterable[float]] = ...) -> None: ...
