"""The few records that say what an episode is and how it ended, without reading its frames."""

import struct
import zlib
from collections.abc import Collection, Iterator
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

from jenga_data.log.records import HEAD, UNREADABLE, Damage, parse_record, read_record, reason_of, size_of, unpack, walk

_FOOTER_BYTES = HEAD.size + 20


def select(stream: BinaryIO, topics: Collection[str], attachments: Collection[str]) -> Iterator[McapRecord | Damage]:
    """Like `records.walk`, but of attachments and messages only those of the given names and topics.

    Reads only the summary, what it points to, and the chunks that hold these topics. A file without a complete
    index is walked from front to back.
    """
    try:
        found = _indexed(stream, topics, attachments)
    except UNREADABLE as error:
        yield Damage(size_of(stream), f"the index cannot be read: {reason_of(error)}")
        return
    yield from found if found is not None else walk(stream)


def _indexed(stream: BinaryIO, topics: Collection[str], attachments: Collection[str]) -> list[McapRecord] | None:
    size = size_of(stream)
    summary = _read_summary(stream, size)
    if summary is None:
        return None
    channels = {channel.id for channel in summary.channels.values() if channel.topic in topics}
    offsets = [len(MCAP0_MAGIC)]  # The file's header, which names the profile.
    offsets += [index.offset for index in summary.metadata_indexes]
    offsets += [index.offset for index in summary.attachment_indexes if index.name in attachments]
    out: list[McapRecord] = [*summary.schemas.values(), *summary.channels.values()]
    out += [record for offset in offsets if (record := parse_record(read_record(stream, offset, size)))]
    for index in summary.chunk_indexes:
        if channels & index.message_index_offsets.keys():
            chunk = parse_record(read_record(stream, index.chunk_start_offset, size))
            if not isinstance(chunk, Chunk):
                raise ValueError(f"no chunk at byte {index.chunk_start_offset}")
            out += [record for record in unpack(chunk, channels) if isinstance(record, Message)]
    return out


def _read_summary(stream: BinaryIO, size: int) -> Summary | None:
    """The summary section, None where the file has none or where it does not list everything."""
    start = size - _FOOTER_BYTES - len(MCAP0_MAGIC)
    if start < len(MCAP0_MAGIC):
        return None
    stream.seek(start)
    raw = stream.read(_FOOTER_BYTES)
    if stream.read() != MCAP0_MAGIC or HEAD.unpack(raw[: HEAD.size]) != (Opcode.FOOTER, 20):
        return None
    footer = Footer(*struct.unpack("<QQI", raw[HEAD.size :]))
    if not len(MCAP0_MAGIC) < footer.summary_start < start:
        return None
    stream.seek(footer.summary_start)
    data = stream.read(start - footer.summary_start)
    if footer.summary_crc not in (0, zlib.crc32(data + raw[:-4])):
        raise ValueError("the checksum of the summary is wrong")

    summary = Summary()
    position = footer.summary_start
    while position < start:
        record_bytes = read_record(stream, position, start)
        position += len(record_bytes)
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
