"""The few records that say what an episode is and how it ended, without reading its frames."""

import hashlib
import struct
import zlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    Footer,
    McapRecord,
    Message,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC

from jenga_data.log.parse import HEAD, UNREADABLE, parse_record, unpack
from jenga_data.log.records import Damage, read_record, reason_of, size_of, walk

_FOOTER_BYTES = HEAD.size + 20
_DATA_END_BYTES = HEAD.size + 4
_READ_BYTES = 2**18


@dataclass(frozen=True)
class Window:
    """Messages that are wanted of a part of a file.

    Of the topics `first` those in the first chunk that holds any, and in those that begin at most `first_ns` after it;
    of `topics` those in all chunks that have messages
    of about the times of `around`: not before its first chunk, and at most `margin_ns` after its last.
    """

    first: Collection[str] = ()
    first_ns: int = 0
    around: str = ""
    topics: Collection[str] = ()
    margin_ns: int = 0


def select(
    stream: BinaryIO, topics: Collection[str], attachments: Collection[str], window: Window = Window()
) -> Iterator[McapRecord | Damage]:
    """Like `records.walk`, but of attachments and messages only those of the given names and topics, and those of
    the window: of its topics there may be more than asked for.

    Reads only the summary, what it points to, and the chunks that hold these topics. A file without a complete
    index is walked from front to back.
    """
    try:
        found = _indexed(stream, topics, attachments, window)
    except UNREADABLE as error:
        yield Damage(size_of(stream), f"the index cannot be read: {reason_of(error)}")
        return
    yield from found if found is not None else walk(stream)


@dataclass(frozen=True)
class Fingerprint:
    """What all bytes of a file say together.

    `intact`: every byte is as its writer wrote it, by the checksums of the file's two sections. False also where the
    writer left them out: then `records.walk` compares those of the single chunks.
    """

    sha256: str
    intact: bool


def fingerprint(stream: BinaryIO) -> Fingerprint:
    """Hash a file and compare it with its checksums, reading it once."""
    try:
        end, expected = _data_section(stream)
    except UNREADABLE:
        end, expected = 0, 0
    digest, checksum, position = hashlib.sha256(), 0, 0
    buffer = memoryview(bytearray(_READ_BYTES))
    stream.seek(0)
    while count := stream.readinto(buffer):  # type: ignore[attr-defined]  # a BufferedReader has it
        digest.update(buffer[:count])
        if position < end:
            checksum = zlib.crc32(buffer[: min(count, end - position)], checksum)
        position += count
    return Fingerprint(digest.hexdigest(), expected != 0 and position > end and checksum == expected)


def _data_section(stream: BinaryIO) -> tuple[int, int]:
    """Where it ends, and the checksum that it should have: 0 where the file does not say, or has no sound summary."""
    found = _read_footer(stream, size_of(stream))
    if found is None or not found[0].summary_crc:
        return 0, 0
    end = found[0].summary_start - _DATA_END_BYTES
    stream.seek(end)
    record = stream.read(_DATA_END_BYTES)
    if HEAD.unpack_from(record) != (Opcode.DATA_END, 4):
        return 0, 0
    return end, struct.unpack_from("<I", record, HEAD.size)[0]


def _indexed(
    stream: BinaryIO, topics: Collection[str], attachments: Collection[str], window: Window
) -> list[McapRecord] | None:
    size = size_of(stream)
    summary = _read_summary(stream, size)
    if summary is None or summary.statistics is None:
        return None
    offsets = [len(MCAP0_MAGIC)]  # The file's header, which names the profile.
    offsets += [index.offset for index in summary.metadata_indexes]
    offsets += [index.offset for index in summary.attachment_indexes if index.name in attachments]
    out: list[McapRecord] = [*summary.schemas.values(), *summary.channels.values(), summary.statistics]
    out += [record for offset in offsets if (record := parse_record(read_record(stream, offset, size)))]
    for index, channels in _chunks(summary, topics, window):
        chunk = parse_record(read_record(stream, index.chunk_start_offset, size))
        if not isinstance(chunk, Chunk):
            raise ValueError(f"no chunk at byte {index.chunk_start_offset}")
        out += [record for record in unpack(chunk, channels) if isinstance(record, Message)]
    return out


def _chunks(summary: Summary, topics: Collection[str], window: Window) -> Iterator[tuple[ChunkIndex, set[int]]]:
    """Which chunks to read, in the order of the file, and of which channels."""

    def channels_of(*names: str) -> set[int]:
        return {channel.id for channel in summary.channels.values() if channel.topic in names}

    wanted, inside, around = channels_of(*topics), channels_of(*window.topics), channels_of(window.around)
    early = {topic: channels_of(topic) for topic in window.first}
    began: dict[str, int] = {}
    chunks = sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset)
    times = [(i.message_start_time, i.message_end_time) for i in chunks if around & i.message_index_offsets.keys()]
    start = min((first for first, _ in times), default=0)
    end = max((last for _, last in times), default=-1) + window.margin_ns
    for index in chunks:
        held = index.message_index_offsets.keys()
        channels = wanted & held
        if times and index.message_start_time <= end and index.message_end_time >= start:
            channels |= inside & held
        for topic in [topic for topic, ids in early.items() if ids & held]:
            if index.message_start_time <= began.setdefault(topic, index.message_start_time) + window.first_ns:
                channels |= early[topic] & held
        if channels:
            yield index, channels


def _read_summary(stream: BinaryIO, size: int) -> Summary | None:
    """The summary section, None where the file has none or where it does not list everything."""
    found = _read_footer(stream, size)
    if found is None:
        return None
    summary, (_, data) = Summary(), found
    for record_bytes in _records_in(data):
        match parse_record(record_bytes):
            case Statistics() as record:
                summary.statistics = record
            case Schema() as record:
                summary.schemas[record.id] = record
            case Channel() as record:
                summary.channels[record.id] = record
            case AttachmentIndex() as record:
                summary.attachment_indexes.append(record)
            case ChunkIndex() as record:
                summary.chunk_indexes.append(record)
            case MetadataIndex() as record:
                summary.metadata_indexes.append(record)
    return summary if _lists_everything(summary) else None


def _records_in(data: bytes) -> Iterator[bytes]:
    """The records of a summary that are of use here, head included.

    Raises:
        ValueError: one of them does not fit into it.
    """
    position = 0
    while position < len(data):
        if position + HEAD.size > len(data):
            raise ValueError("cut off within a record's head")
        opcode, length = HEAD.unpack_from(data, position)
        end = position + HEAD.size + length
        if opcode == 0 or end > len(data):
            raise ValueError(f"no record starts here (opcode {opcode}, length {length})")
        if opcode != Opcode.SUMMARY_OFFSET:
            yield data[position:end]
        position = end


def _read_footer(stream: BinaryIO, size: int) -> tuple[Footer, bytes] | None:
    """The footer and the summary, its checksum compared; None where there is no summary.

    Raises:
        ValueError: the checksum is wrong.
    """
    start = size - _FOOTER_BYTES - len(MCAP0_MAGIC)
    if start < len(MCAP0_MAGIC):
        return None
    stream.seek(start)
    raw = stream.read(_FOOTER_BYTES)
    if stream.read() != MCAP0_MAGIC or HEAD.unpack(raw[: HEAD.size]) != (Opcode.FOOTER, 20):
        return None
    footer = Footer(*struct.unpack("<QQI", raw[HEAD.size :]))
    if not len(MCAP0_MAGIC) + _DATA_END_BYTES < footer.summary_start < start:
        return None
    stream.seek(footer.summary_start)
    data = stream.read(start - footer.summary_start)
    if footer.summary_crc not in (0, zlib.crc32(data + raw[:-4])):
        raise ValueError("the checksum of the summary is wrong")
    return footer, data


def _lists_everything(summary: Summary) -> bool:
    counted = summary.statistics
    return (
        counted is not None
        and len(summary.channels) == counted.channel_count
        and len(summary.metadata_indexes) == counted.metadata_count
        and len(summary.attachment_indexes) == counted.attachment_count
        and len(summary.chunk_indexes) == counted.chunk_count > 0
        and sum(1 for index in summary.chunk_indexes if index.message_index_offsets) == counted.chunk_count
    )
