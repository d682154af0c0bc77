"""An MCAP file that gets its name only when it is complete."""

import os
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from google.protobuf.message import Message
from mcap.records import Channel, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from jenga_data.errors import JengaError
from jenga_data.log.profile import CHUNK_BYTES, schema_of

PARTIAL = ".partial"


def partial_path(path: Path) -> Path:
    """Where the file lies until it is complete."""
    return path.with_name(path.name + PARTIAL)


class Output:
    """Writes `<path>.partial` (or `partial`); `commit` completes it and renames it to `path`, `abandon` leaves it.

    Holds no clock and no random state, so the same calls give the same bytes.

    Raises:
        JengaError: on any method, the system refused (no space, no permission, no such folder).
    """

    def __init__(self, path: Path, profile: str, partial: Path | None = None) -> None:
        self._path = path
        self._partial = partial or partial_path(path)
        self._channels: dict[str, int] = {}
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        with self._refusals():
            self._file = self._partial.open("wb")
            self._writer = Writer(
                self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True
            )
            self._writer.start(profile=profile)

    @contextmanager
    def _refusals(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            reason = error.strerror or error
            raise JengaError(f"cannot write {self._partial}: {reason}; make room or choose another folder") from error

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        with self._refusals():
            self._writer.add_metadata(name, dict(sorted(values.items())))

    def attachment(self, name: str, media_type: str, data: bytes) -> None:
        with self._refusals():
            self._writer.add_attachment(0, 0, name, media_type, data)

    def message(self, topic: str, message: Message, time_ns: int) -> None:
        """Publish a protobuf message."""
        self.packed(topic, type(message), message.SerializeToString(), time_ns)

    def packed(self, topic: str, kind: type[Message], data: bytes, time_ns: int) -> None:
        """Publish a message of type `kind` that is serialized already."""
        channel = self._channels.get(topic)
        if channel is None:
            schema = Schema(0, schema_of(kind), SchemaEncoding.Protobuf, kind.DESCRIPTOR.full_name)
            channel = self._channels[topic] = self.channel(Channel(0, topic, MessageEncoding.Protobuf, {}, 0), schema)
        self.raw(channel, data, time_ns)

    def text(self, topic: str, text: str, time_ns: int) -> None:
        """Publish a ROS 2 std_msgs/msg/String, little-endian CDR: what viewers read a URDF from."""
        if topic not in self._channels:
            schema = Schema(0, b"string data", SchemaEncoding.ROS2, "std_msgs/msg/String")
            self._channels[topic] = self.channel(Channel(0, topic, MessageEncoding.CDR, {}, 0), schema)
        data = text.encode() + b"\0"
        self.raw(self._channels[topic], b"\0\1\0\0" + struct.pack("<I", len(data)) + data, time_ns)

    def channel(self, channel: Channel, schema: Schema | None) -> int:
        """Register a channel as another file describes it, and return its number in this one."""
        schema_id = 0
        with self._refusals():
            if schema is not None:
                key = (schema.name, schema.encoding, schema.data)
                if key not in self._schemas:
                    self._schemas[key] = self._writer.register_schema(schema.name, schema.encoding, schema.data)
                schema_id = self._schemas[key]
            return self._writer.register_channel(channel.topic, channel.message_encoding, schema_id, channel.metadata)

    def raw(self, channel: int, data: bytes, time_ns: int, publish_ns: int | None = None, sequence: int = 0) -> None:
        """Publish bytes on a channel that `channel` registered."""
        with self._refusals():
            self._writer.add_message(channel, time_ns, data, time_ns if publish_ns is None else publish_ns, sequence)

    def flush(self) -> None:
        """End the chunk and hand everything to the system: a killed process no longer loses it."""
        with self._refusals():
            self._writer.flush()

    def commit(self) -> None:
        """Complete the file, make it safe against a power cut and give it its name."""
        with self._refusals():
            self._writer.finish()
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
            self._partial.replace(self._path)
            if os.name != "posix":
                return  # Other systems do not open folders.
            folder = os.open(self._path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)

    def abandon(self) -> None:
        """Save what can be saved under the partial name. Silent: the reason for it is on its way already."""
        with suppress(OSError):
            self._writer.flush()
        with suppress(OSError):
            self._file.close()

    def discard(self) -> None:
        """Leave nothing behind."""
        self.abandon()
        self._partial.unlink(missing_ok=True)
