"""The raw content of an episode's file: metadata, attachments and the messages of the profile's topics."""

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from google.protobuf.message import Message as ProtobufMessage
from mcap.records import Attachment, Channel, Footer, Header, McapRecord, Message, Metadata, Schema, Statistics
from mcap.well_known import MessageEncoding

from jenga_data.errors import CheckFailed
from jenga_data.limits import MAX_EPISODE_BYTES, MESSAGE_BYTES
from jenga_data.log import profile
from jenga_data.log.proto import jenga_pb2 as pb
from jenga_data.log.records import Damage, printable

MESSAGES: dict[str, type[ProtobufMessage]] = {
    profile.TOWER: pb.Tower,
    profile.STATE: pb.TowerState,
    profile.CONTACTS: pb.Contacts,
    profile.SIM: pb.SimState,
    profile.ROBOT: pb.Robot,
    profile.ROBOT_STATE: pb.RobotState,
    profile.ACTION: pb.Action,
    profile.GRIPPER: pb.Gripper,
    profile.PHASE: pb.Phase,
    profile.OUTCOME: pb.Outcome,
}


@dataclass
class Raw:
    """What `gather` collected. `messages` holds (log time [ns], data) by topic, in the order of the file."""

    profile: str = ""
    complete: bool = False
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    messages: dict[str, list[tuple[int, bytes]]] = field(default_factory=lambda: defaultdict(list))
    damage: list[Damage] = field(default_factory=list)
    wrong_schema: list[str] = field(default_factory=list)
    statistics: Statistics | None = None

    def counted(self, topic: str) -> int:
        """How many messages of a topic the file says it has."""
        counts = self.statistics.channel_message_counts if self.statistics else {}
        return sum(counts.get(channel.id, 0) for channel in self.channels.values() if channel.topic == topic)


def gather(
    records: Iterable[McapRecord | Damage],
    kind_of: Callable[[str], type[ProtobufMessage] | None] = MESSAGES.get,
) -> Raw:
    """Sort records by what they are; topics for which `kind_of` knows no message are left out.

    Raises:
        ValueError: more data than an episode may have in memory, or a time that is none.
    """
    raw = Raw()
    kept = waiting = 0
    early: list[Message] = []

    def add(message: Message) -> None:
        nonlocal kept
        topic = raw.channels[message.channel_id].topic
        if kind_of(topic) is not None:
            kept += len(message.data) + MESSAGE_BYTES
            if kept > MAX_EPISODE_BYTES:
                raise ValueError(f"more than {MAX_EPISODE_BYTES} bytes of frames; allowed: that many")
            if message.log_time >= 2**63:
                raise ValueError(f"{topic} has a log time of {message.log_time} ns; allowed: less than 2^63")
            raw.messages[topic].append((message.log_time, message.data))

    for record in records:
        match record:
            case Message():
                if record.channel_id in raw.channels:
                    add(record)
                else:
                    early.append(record)
                    waiting += len(record.data) + MESSAGE_BYTES
                    if waiting > MAX_EPISODE_BYTES:
                        raise ValueError(f"more than {MAX_EPISODE_BYTES} bytes of messages on unknown channels")
            case Schema():
                raw.schemas.setdefault(record.id, record)
            case Channel():
                channel = raw.channels.setdefault(record.id, record)
                if (kind := kind_of(channel.topic)) is not None:
                    _check_schema(channel, raw.schemas.get(channel.schema_id), kind, raw.wrong_schema)
            case Metadata():
                raw.metadata.setdefault(record.name, record.metadata)
            case Attachment():
                raw.attachments.setdefault(record.name, record.data)
            case Header():
                raw.profile = record.profile
            case Statistics():
                raw.statistics = record
            case Footer():
                raw.complete = True
            case Damage():
                raw.damage.append(record)
    # Where the chunk that names the channels is damaged, the summary at the end still names them.
    for message in early:
        if message.channel_id in raw.channels:
            add(message)
    return raw


def _check_schema(channel: Channel, schema: Schema | None, kind: type[ProtobufMessage], wrong: list[str]) -> None:
    name = schema.name if schema else "no schema"
    if channel.message_encoding != MessageEncoding.Protobuf or name != kind.DESCRIPTOR.full_name:
        said = printable(f"{name} ({channel.message_encoding})")
        line = f"{channel.topic} holds {said}, not {kind.DESCRIPTOR.full_name} (protobuf)"
        if line not in wrong:
            wrong.append(line)


def refuse_damage(path: Path, raw: Raw, way_out: str | None = None) -> None:
    """Refuse a file of which anything cannot be read.

    Raises:
        CheckFailed: with the first damage and the way out, by default the command that saves the rest.
    """
    if raw.damage:
        raise CheckFailed(f"{path} is damaged at {raw.damage[0]}; {way_out or f'run: jenga log recover {path}'}")
    if raw.wrong_schema:
        raise CheckFailed(f"{path}: {raw.wrong_schema[0]}; write it as jenga_data/log/proto/jenga.proto says")
