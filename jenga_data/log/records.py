"""All records of an MCAP file in order, and what of it cannot be read. Reader, doctor and recovery share this walk.

Files may come from anybody: no length that a file claims is allocated before it is compared with the file's size
and with `jenga_data.limits`, and damage is not searched for what is whole without end.
"""

import struct
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from io import SEEK_END, BytesIO
from pathlib import Path
from typing import Any, BinaryIO

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
from mcap.writer import MCAP0_MAGIC

from jenga_data.errors import CheckFailed, JengaError
from jenga_data.limits import (
    MAX_DAMAGES,
    MAX_NAME,
    MAX_PACKING,
    MAX_READING,
    MAX_RECORD_BYTES,
    MAX_SMALL_CHUNK_BYTES,
    MAX_UNPACKED_BYTES,
)

HEAD = struct.Struct("<BQ")
"""Opcode and length, before every record."""
_CHUNK_INDEX = struct.Struct("<QQQQI")
_INDEX_OFFSET = struct.Struct("<HQ")
_MESSAGE = struct.Struct("<HIQQ")
"""Channel, sequence, log time and publish time, before a message's data."""
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

_KINDS: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
    Opcode.ATTACHMENT: Attachment,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.SUMMARY_OFFSET: SummaryOffset,
    Opcode.DATA_END: DataEnd,
}
_ZSTD = zstandard.ZstdDecompressor()
_CHUNK_SIGNATURE = struct.pack("<I", 4) + b"zstd"
_SIGNATURE_AT = HEAD.size + 8 + 8 + 8 + 4


@dataclass(frozen=True)
class Damage:
    """Something that cannot be read, from byte `offset` on."""

    offset: int
    reason: str

    def __str__(self) -> str:
        return f"byte {self.offset}: {self.reason}"


def open_log(path: Path) -> BinaryIO:
    """Open a file for reading and check that it is an MCAP file at all.

    Raises:
        JengaError: it cannot be opened, or is something else.
    """
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            raise JengaError(f"{path} is no regular file; give the path of an MCAP file")  # a pipe would wait forever
        stream = path.open("rb")
    except OSError as error:
        raise JengaError(f"cannot read {path}: {error.strerror or error}; give the path of an MCAP file") from error
    if (start := stream.read(len(MCAP0_MAGIC))) != MCAP0_MAGIC:
        stream.close()
        raise JengaError(f"{path} is no MCAP file: it starts with {start!r}; give the path of an MCAP file")
    return stream


@contextmanager
def one_line(path: Path) -> Iterator[None]:
    """Turn what reading a file may raise into an error of this project.

    Raises:
        CheckFailed: the content does not fit the profile.
        JengaError: the system refused to read.
    """
    try:
        yield
    except ValueError as error:
        raise CheckFailed(f"{path}: {error}; run: jenga log doctor {path}") from error
    except OSError as error:
        raise JengaError(f"cannot read {path}: {error.strerror or error}") from error


def reason_of(error: Exception) -> str:
    """What one of UNREADABLE says; mcap's end-of-file says nothing."""
    return printable(str(error)) or "it ends too early"


def printable(text: str) -> str:
    """What a file says, fit for a message: printable, and not longer than a line."""
    return "".join(c if c.isprintable() else "?" for c in text[: 2 * MAX_NAME])


def size_of(stream: BinaryIO) -> int:
    return stream.seek(0, SEEK_END)


def walk(stream: BinaryIO) -> Iterator[McapRecord | Damage]:
    """Every record in the order of the file: a chunk, then the records in it. Message indexes are left out.

    After damage the walk goes on with the next record, or with the next zstd chunk where lengths can no longer be
    trusted. The last thing from a complete file is its footer.
    """
    size = size_of(stream)
    position = previous = len(MCAP0_MAGIC)
    reported = -1
    damages, unread, unpacked = 0, MAX_READING * size, 0
    checksum: int | None = zlib.crc32(MCAP0_MAGIC)
    while position < size:
        if damages > MAX_DAMAGES or unread < 0:
            yield Damage(position, f"too much damage ({damages} places): the rest was not looked at")
            return
        try:
            raw = read_record(stream, position, size)
        except ValueError as error:
            if position != reported:  # the way back may lead to the same place
                yield Damage(position, str(error))
            damages += 1
            reported = position
            checksum = None
            # A wrong length in the record before may have led here, past good chunks.
            position = previous = _next_chunk(stream, previous + 1, size)
            continue
        previous = position
        unread -= len(raw)
        try:
            record = parse_record(raw)
            if isinstance(record, DataEnd) and record.data_section_crc not in (0, checksum) and checksum is not None:
                yield Damage(position, "the checksum of the data section is wrong")
            if isinstance(record, Footer):
                yield from _check_end(stream, record, position, size)
            if record is not None:
                yield record
            if isinstance(record, Chunk):
                unpacked += record.uncompressed_size
                if unpacked > MAX_UNPACKED_BYTES:
                    yield Damage(position, f"the chunks unpack to more than {MAX_UNPACKED_BYTES} bytes")
                    return
                yield from unpack(record)
        except UNREADABLE as error:
            damages += 1
            yield Damage(position, f"{_name(raw[0])}: {reason_of(error)}")
            checksum = None
        if raw[0] == Opcode.FOOTER:
            return
        if checksum is not None:
            checksum = zlib.crc32(raw, checksum)
        position += len(raw)
    yield Damage(size, "the file ends without a footer: it is unfinished or was cut off")


def read_record(stream: BinaryIO, position: int, size: int) -> bytes:
    """The bytes of the record at `position`, head included.

    Raises:
        ValueError: there is none of a length that can be true.
    """
    stream.seek(position)
    head = stream.read(HEAD.size)
    if len(head) < HEAD.size:
        raise ValueError("cut off within a record's head")
    opcode, length = HEAD.unpack(head)
    if opcode == 0 or length > MAX_RECORD_BYTES:
        raise ValueError(f"no record starts here (opcode {opcode}, length {length})")
    if position + HEAD.size + length > size:
        missing = position + HEAD.size + length - size
        raise ValueError(f"{_name(opcode)} of {length} bytes, the last {missing} of which are missing")
    return head + stream.read(length)


def parse_record(raw: bytes) -> McapRecord | None:
    """One record from its bytes; None for message indexes and for kinds that this version of MCAP does not know."""
    if raw[0] == Opcode.MESSAGE:
        return Message.read(ReadDataStream(BytesIO(raw[HEAD.size :])), len(raw) - HEAD.size)
    if raw[0] == Opcode.FOOTER:
        return Footer(*struct.unpack("<QQI", raw[HEAD.size :]))
    if raw[0] == Opcode.CHUNK_INDEX:
        return _chunk_index(raw)
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
            raise ValueError(f"{_name(opcode)} of {length} bytes, the last {position - size} of which are missing")
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


def _check_end(stream: BinaryIO, footer: Footer, position: int, size: int) -> Iterator[Damage]:
    end = position + HEAD.size + 20
    stream.seek(end)
    if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
        yield Damage(end, "the file's last bytes are missing")
    elif end + len(MCAP0_MAGIC) != size:
        yield Damage(end + len(MCAP0_MAGIC), "something follows after the end of the file")
    if footer.summary_crc:
        stream.seek(min(footer.summary_start, end))
        summary = stream.read(max(end - 4 - footer.summary_start, 0))
        if zlib.crc32(summary) != footer.summary_crc:
            yield Damage(position, "the checksum of the summary is wrong")


def _next_chunk(stream: BinaryIO, position: int, size: int) -> int:
    """Where the next zstd chunk may start from `position` on, else the end of the file. Its checksum decides."""
    stream.seek(position)
    overlap = b""
    start = position
    while block := stream.read(2**20):
        window = overlap + block
        found = window.find(_CHUNK_SIGNATURE)
        while found >= 0:
            candidate = start + found - _SIGNATURE_AT
            if candidate >= position and _opcode_at(stream, candidate) == Opcode.CHUNK:
                return candidate
            found = window.find(_CHUNK_SIGNATURE, found + 1)
        overlap = window[-(len(_CHUNK_SIGNATURE) - 1) :]
        start += len(window) - len(overlap)
    return size


def _opcode_at(stream: BinaryIO, position: int) -> int:
    here = stream.tell()
    stream.seek(position)
    opcode = stream.read(1)[0]
    stream.seek(here)
    return opcode


def _name(opcode: int) -> str:
    try:
        return Opcode(opcode).name.lower().replace("_", " ")
    except ValueError:
        return f"unknown record {opcode}"
