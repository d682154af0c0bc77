"""What the MCAP files of this project hold: names, versions and limits. The messages stand in proto/jenga.proto."""

from typing import Any, Final

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message

PROFILE: Final = "jenga"
PREDICTION_PROFILE: Final = "jenga-prediction"
VERSION: Final = (1, 2)
"""Another major version cannot be read; a higher minor one only adds what may be ignored."""

TOWER: Final = "/tower"
STATE: Final = "/tower/state"
CONTACTS: Final = "/tower/contacts"
SIM: Final = "/sim/state"
ROBOT: Final = "/robot"
ROBOT_STATE: Final = "/robot/state"
ACTION: Final = "/action"
GRIPPER: Final = "/gripper"
PHASE: Final = "/phase"
OUTCOME: Final = "/outcome"
TOPICS: Final = (TOWER, STATE, CONTACTS, SIM, ROBOT, ROBOT_STATE, ACTION, GRIPPER, PHASE, OUTCOME)
"""What the reader reads. /tower and /tower/state are needed, the rest is not."""

TF: Final = "/tf"
ROBOT_DESCRIPTION: Final = "/robot_description"
GRIPPER_DESCRIPTION: Final = "/gripper/robot_description"
LINKS_DESCRIPTION: Final = "/robot/robot_description"
TEXT: Final = "/log"
"""These five are for viewers only and can be made again from the others."""

EPISODE_METADATA: Final = "jenga"
PROVENANCE_METADATA: Final = "provenance"
RECOVERY_METADATA: Final = "recovery"
SCENE: Final = "scene.xml"
CONFIG: Final = "config.json"

CHUNK_BYTES: Final = 64 * 1024
"""A killed process loses at most one unfinished chunk: about two frames of a full tower."""


def version_text(version: tuple[int, int] = VERSION) -> str:
    return f"{version[0]}.{version[1]}"


def schema_of(message: type[Message]) -> bytes:
    """The serialized FileDescriptorSet that an MCAP schema record needs: the message's file and all it imports."""
    files: dict[str, Any] = {}

    def visit(file: Any) -> None:  # Its class depends on protobuf's backend.
        if file.name not in files:
            for dependency in file.dependencies:
                visit(dependency)
            files[file.name] = file

    visit(message.DESCRIPTOR.file)
    out = FileDescriptorSet()
    for file in files.values():
        file.CopyToProto(out.file.add())
    return out.SerializeToString()
