"""Bytes that are no episode: one line, whatever they are."""

import dataclasses
import random

import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from synthetic_log import SCENE, make_script, write

from jenga_data.errors import CheckFailed, JengaError
from jenga_data.log.reader import attachment, read_episode, read_header
from jenga_data.log.records import Damage, open_log, walk
from jenga_data.log.recover import recover
from jenga_data.log.report import doctor, inspect


def test_no_flipped_byte_goes_unnoticed(tmp_path):
    """Every byte stands under some checksum."""
    path = write(tmp_path / "e.mcap", make_script(frames=3, state=2))
    good = path.read_bytes()
    rng = random.Random(0)
    middle = rng.sample(range(40, len(good) - 60), 40)
    for position in [*range(0, 40, 2), *middle, *range(len(good) - 60, len(good), 2)]:
        bad = bytearray(good)
        bad[position] ^= 1 << rng.randrange(8)
        path.write_bytes(bad)
        with pytest.raises(JengaError) as refused:
            read_episode(path)
        assert "\n" not in str(refused.value), position
        for look in (read_header, doctor):  # may accept, may not crash
            try:
                look(path)
            except JengaError:
                continue


def test_a_header_is_read_without_the_frames(tmp_path):
    script = make_script(frames=40, state=1500)
    path = write(tmp_path / "e.mcap", script)
    bad = bytearray(path.read_bytes())
    bad[len(bad) // 2] ^= 0xFF
    path.write_bytes(bad)
    header, result = read_header(path)
    assert (header.key, result) == (script.header.key, script.result)
    with pytest.raises(CheckFailed, match="is damaged at byte"):
        read_episode(path)


@pytest.mark.parametrize("content", [b"", b"\0" * 1000, b"PAR1" * 100, b"\x89MCAP0\r\n"[:5]])
def test_garbage_is_no_mcap_file(tmp_path, content):
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    for read in (read_episode, read_header, inspect, doctor, lambda p: attachment(p, "x"), lambda p: recover(p, p)):
        with pytest.raises(JengaError, match=r"^[^\n]*(is no MCAP file|exists)[^\n]*$"):
            read(path)


@pytest.mark.parametrize("tail", [b"", b"garbage" * 500, b"\x06" + b"\xff" * 8, b"\x06" + b"\0" * 8 + b"zstd" * 20])
def test_garbage_after_the_magic_is_damage(tmp_path, tail):
    path = tmp_path / "x.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + tail)
    with pytest.raises(CheckFailed, match="is damaged at byte 8"):
        read_episode(path)


def test_missing_files_and_folders_are_one_line(tmp_path):
    for path in (tmp_path / "no.mcap", tmp_path):
        for read in (read_episode, read_header, inspect, doctor):
            with pytest.raises(JengaError, match=r"^cannot read [^\n]*; give the path of an MCAP file$"):
                read(path)


def write_raw(path, record):
    builder = RecordBuilder()
    record.write(builder)
    path.write_bytes(b"\x89MCAP0\r\n" + builder.end())


def test_a_chunk_that_lies_about_its_size_is_not_unpacked(tmp_path, log):
    with open_log(log) as stream:
        chunk = next(r for r in walk(stream) if isinstance(r, Chunk))
    assert damage_of(tmp_path, dataclasses.replace(chunk, uncompressed_size=chunk.uncompressed_size + 1)) == (
        "chunk: two different sizes for the unpacked data"
    )


def test_a_chunk_that_unpacks_to_more_than_is_allowed_is_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr("jenga_data.log.parse.MAX_RECORD_BYTES", 1000)
    chunk = Chunk("zstd", zstandard.compress(bytes(1001)), 0, 0, 0, 1001)
    assert damage_of(tmp_path, chunk) == "chunk: claims to unpack to 1001 bytes; allowed: 1000"


def damage_of(folder, record):
    """What the walk says of a file that consists of one record."""
    write_raw(folder / "bomb.mcap", record)
    with open_log(folder / "bomb.mcap") as stream:
        return next(r for r in walk(stream) if isinstance(r, Damage)).reason


def test_a_damaged_attachment_is_refused(log):
    data = log.read_bytes()
    assert data.count(SCENE.encode()) == 1
    log.write_bytes(data.replace(SCENE.encode(), SCENE.upper().encode()))
    with pytest.raises(CheckFailed, match=r"the checksum of 'scene.xml' is wrong"):
        attachment(log, "scene.xml")
