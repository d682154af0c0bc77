"""All records of an MCAP file in order, and what of it cannot be read. Reader, doctor and recovery share this walk.

Files may come from anybody: no length that a file claims is allocated before it is compared with the file's size
and `MAX_RECORD_BYTES`.
"""

import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import SEEK_END, BytesIO
from pathlib import Path
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Chunk, DataEnd, Footer, McapRecord
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from jenga_data.errors import CheckFailed, JengaError
from jenga_data.log.profile import MAX_RECORD_BYTES

HEAD = struct.Struct("<BQ")
"""Opcode and length, before every record."""
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

_KNOWN = frozenset(Opcode)
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
    return str(error) or "it ends too early"


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
    checksum: int | None = zlib.crc32(MCAP0_MAGIC)
    while position < size:
        try:
            raw = read_record(stream, position, size)
        except ValueError as error:
            if position != reported:  # the way back may lead to the same place
                yield Damage(position, str(error))
            reported = position
            checksum = None
            # A wrong length in the record before may have led here, past good chunks.
            position = previous = _next_chunk(stream, previous + 1, size)
            continue
        previous = position
        try:
            record = parse_record(raw)
            if isinstance(record, DataEnd) and record.data_section_crc not in (0, checksum) and checksum is not None:
                yield Damage(position, "the checksum of the data section is wrong")
            if isinstance(record, Footer):
                yield from _check_end(stream, record, position, size)
            if record is not None:
                yield record
            if isinstance(record, Chunk):
                yield from unpack(record)
        except UNREADABLE as error:
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
    if raw[0] == Opcode.MESSAGE_INDEX or raw[0] not in _KNOWN:
        return None
    if raw[0] == Opcode.FOOTER:
        return Footer(*struct.unpack("<QQI", raw[HEAD.size :]))
    record = next(StreamReader(BytesIO(raw), skip_magic=True, emit_chunks=True).records, None)
    if isinstance(record, Attachment):
        (expected,) = struct.unpack("<I", raw[-4:])
        if expected not in (0, zlib.crc32(raw[HEAD.size : -4])):
            raise ValueError(f"the checksum of {record.name!r} is wrong")
    return record


def unpack(chunk: Chunk) -> list[McapRecord]:
    """The records in a chunk, its checksum compared.

    Raises:
        ValueError: or another of UNREADABLE, the chunk is damaged or claims to be larger than MAX_RECORD_BYTES.
    """
    size = chunk.uncompressed_size
    if size > MAX_RECORD_BYTES:
        raise ValueError(f"claims to unpack to {size} bytes; allowed: {MAX_RECORD_BYTES}")
    match chunk.compression:
        case "":
            data = chunk.data
        case "zstd":
            # zstandard trusts the size in the frame over the limit that it is given.
            if zstandard.frame_content_size(chunk.data) not in (-1, size):
                raise ValueError("two different sizes for the unpacked data")
            data = zstandard.decompress(chunk.data, max_output_size=size)
        case "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
        case other:
            raise ValueError(f"compression {other!r}; allowed: zstd, lz4 or none")
    if len(data) != size:
        raise ValueError(f"unpacks to {len(data)} bytes instead of {size}")
    return breakup_chunk(replace(chunk, compression="", data=data), validate_crc=True)


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
