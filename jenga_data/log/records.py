"""All records of an MCAP file in order, and what of it cannot be read. Reader, doctor and recovery share this walk.

Files may come from anybody: no length that a file claims is allocated before it is compared with the file's size
and with `jenga_data.limits`, and damage is not searched for what is whole without end.
"""

import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import SEEK_END
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import (
    Chunk,
    DataEnd,
    Footer,
    McapRecord,
)
from mcap.writer import MCAP0_MAGIC

from jenga_data.errors import CheckFailed, JengaError
from jenga_data.limits import (
    MAX_DAMAGES,
    MAX_NAME,
    MAX_READING,
    MAX_RECORD_BYTES,
    MAX_UNPACKED_BYTES,
)
from jenga_data.log.parse import HEAD, UNREADABLE, name_of, parse_record, unpack

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
            yield Damage(position, f"{name_of(raw[0])}: {reason_of(error)}")
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
        raise ValueError(f"{name_of(opcode)} of {length} bytes, the last {missing} of which are missing")
    return head + stream.read(length)


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
