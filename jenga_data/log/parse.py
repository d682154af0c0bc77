"""The records of MCAP from their bytes, and those within a chunk. Nothing is unpacked beyond `jenga_data.limits`."""

import struct
import zlib
from collections.abc import Collection, Iterator
from functools import lru_cache
from io import BytesIO
from typing import Any

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from jenga_data.limits import (
    MAX_NAME,
    MAX_PACKING,
    MAX_RECORD_BYTES,
    MAX_SMALL_CHUNK_BYTES,
)

HEAD = struct.Struct("<BQ")
"""Opcode and length, before every record."""
_CHUNK = struct.Struct("<QQQII")
_CHUNK_INDEX = struct.Struct("<QQQQI")
_INDEX_OFFSET = struct.Struct("<HQ")
_MESSAGE = struct.Struct("<HIQQ")
"""Channel, sequence, log time and publish time, before a message's data."""

_KINDS: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.ATTACHMENT: Attachment,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.SUMMARY_OFFSET: SummaryOffset,
    Opcode.DATA_END: DataEnd,
}
_ZSTD = zstandard.ZstdDecompressor()
UNREADABLE = (
    McapError,
    ValueError,
    KeyError,
    struct.error,
    zstandard.ZstdError,
    RuntimeError,
    OverflowError,
    MemoryError,
)
"""What mcap, zstandard and lz4 raise on damaged bytes."""


def parse_record(raw: bytes) -> McapRecord | None:
    """One record from its bytes; None for message indexes and for kinds that this version of MCAP does not know."""
    if raw[0] == Opcode.MESSAGE:
        return Message.read(ReadDataStream(BytesIO(raw[HEAD.size :])), len(raw) - HEAD.size)
    if raw[0] == Opcode.FOOTER:
        return Footer(*struct.unpack("<QQI", raw[HEAD.size :]))
    if raw[0] == Opcode.CHUNK_INDEX:
        return _chunk_index(raw)
    if raw[0] == Opcode.CHUNK:
        return _chunk(raw)
    if raw[0] in (Opcode.SCHEMA, Opcode.CHANNEL) and len(raw) <= _CACHED_BYTES:
        return _parse_again(raw)
    record = _parse(raw)
    if isinstance(record, Attachment):
        (expected,) = struct.unpack("<I", raw[-4:])
        if expected not in (0, zlib.crc32(raw[HEAD.size : -4])):
            raise ValueError(f"the checksum of {record.name[:MAX_NAME]!r} is wrong")
    return record


def _parse(raw: bytes) -> McapRecord | None:
    kind = _KINDS.get(raw[0])
    return kind.read(ReadDataStream(BytesIO(raw[HEAD.size :]))) if kind else None


_CACHED_BYTES = 2**15
_parse_again = lru_cache(256)(_parse)
"""Schemas and channels are the same in all logs of a collection, twice in each."""


def _chunk(raw: bytes) -> Chunk:
    """As mcap reads it, without its field by field copies."""
    first, last, size, checksum, name = _CHUNK.unpack_from(raw, HEAD.size)
    after = HEAD.size + _CHUNK.size + name
    (length,) = struct.unpack_from("<Q", raw, after)
    data = raw[after + 8 : after + 8 + length]
    if len(data) < length:
        raise ValueError(f"{length} bytes of records, the last {length - len(data)} of which are missing")
    return Chunk(
        compression=raw[after - name : after].decode(),
        data=data,
        message_end_time=last,
        message_start_time=first,
        uncompressed_crc=checksum,
        uncompressed_size=size,
    )


def _chunk_index(raw: bytes) -> ChunkIndex:
    """As mcap reads it, twenty times faster: a log has as many of them as chunks."""
    first, last, offset, length, listed = _CHUNK_INDEX.unpack_from(raw, HEAD.size)
    start = HEAD.size + _CHUNK_INDEX.size
    end = start + listed
    offsets = dict(_INDEX_OFFSET.iter_unpack(raw[start:end]))
    index_length, name = struct.unpack_from("<QI", raw, end)
    after = end + 12 + name
    packed, unpacked = struct.unpack_from("<QQ", raw, after)
    return ChunkIndex(
        chunk_length=length,
        chunk_start_offset=offset,
        compression=raw[end + 12 : after].decode(),
        compressed_size=packed,
        message_end_time=last,
        message_index_length=index_length,
        message_index_offsets=offsets,
        message_start_time=first,
        uncompressed_size=unpacked,
    )


def unpack(chunk: Chunk, channels: Collection[int] | None = None) -> Iterator[McapRecord]:
    """The records in a chunk, its checksum compared; of messages only those of `channels`, if they are given.

    Raises:
        ValueError: or another of UNREADABLE, the chunk is damaged or unpacks to more than is allowed.
    """
    data = _unpacked(chunk)
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("the checksum of the chunk is wrong")
    position, size = 0, len(data)
    while position < size:
        start = position + HEAD.size
        if start > size:
            raise ValueError("cut off within a record's head")
        opcode, length = HEAD.unpack_from(data, position)
        position = start + length
        if position > size:
            raise ValueError(f"{name_of(opcode)} of {length} bytes, the last {position - size} of which are missing")
        if opcode == Opcode.MESSAGE:
            if length < _MESSAGE.size:
                raise ValueError(f"message of {length} bytes")
            channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, start)
            if channels is None or channel in channels:
                body = data[start + _MESSAGE.size : position]
                yield Message(
                    channel_id=channel, sequence=sequence, log_time=log_time, publish_time=publish_time, data=body
                )
        elif opcode == Opcode.CHANNEL:
            yield Channel.read(ReadDataStream(BytesIO(data[start:position])))
        elif opcode == Opcode.SCHEMA:
            yield Schema.read(ReadDataStream(BytesIO(data[start:position])))


def _unpacked(chunk: Chunk) -> bytes:
    size = chunk.uncompressed_size
    if size > MAX_RECORD_BYTES:
        raise ValueError(f"claims to unpack to {size} bytes; allowed: {MAX_RECORD_BYTES}")
    if size > max(MAX_PACKING * len(chunk.data), MAX_SMALL_CHUNK_BYTES):
        raise ValueError(f"{len(chunk.data)} bytes claim to unpack to {size}; allowed: {MAX_PACKING} times as many")
    match chunk.compression:
        case "":
            data = chunk.data
        case "zstd":
            # zstandard trusts the size in the frame over the limit that it is given.
            if zstandard.frame_content_size(chunk.data) not in (-1, size):
                raise ValueError("two different sizes for the unpacked data")
            data = _ZSTD.decompress(chunk.data, max_output_size=size)
        case "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
        case other:
            raise ValueError(f"compression {other[:MAX_NAME]!r}; allowed: zstd, lz4 or none")
    if len(data) != size:
        raise ValueError(f"unpacks to {len(data)} bytes instead of {size}")
    return data


def name_of(opcode: int) -> str:
    try:
        return Opcode(opcode).name.lower().replace("_", " ")
    except ValueError:
        return f"unknown record {opcode}"
