"""What a log from elsewhere may not do: fill memory, run for hours, or name a place outside its folder."""

import os
import struct
from dataclasses import replace

import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from synthetic_log import make_script, write

from jenga_data.errors import CheckFailed, JengaError
from jenga_data.limits import MAX_DAMAGES, MAX_DEPTH
from jenga_data.log.parse import HEAD, unpack
from jenga_data.log.reader import read_episode, read_header
from jenga_data.log.records import Damage, open_log, walk


def damages(path):
    with open_log(path) as stream:
        return [record for record in walk(stream) if isinstance(record, Damage)]


def one_chunk(path, chunk):
    builder = RecordBuilder()
    chunk.write(builder)
    path.write_bytes(b"\x89MCAP0\r\n" + builder.end())
    return path


def test_a_bomb_of_zeros_is_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr("jenga_data.log.parse._ZSTD", None)  # nothing may reach it
    data = zstandard.compress(bytes(2**24))
    bomb = one_chunk(tmp_path / "bomb.mcap", Chunk("zstd", data, 0, 0, 0, 2**24))
    assert "bytes claim to unpack to 16777216" in damages(bomb)[0].reason


def test_chunks_that_together_unpack_to_too_much_are_not(tmp_path, monkeypatch):
    monkeypatch.setattr("jenga_data.log.records.MAX_UNPACKED_BYTES", 10_000)
    path = write(tmp_path / "e.mcap", make_script(frames=12, state=100))
    assert any("unpack to more than 10000 bytes" in damage.reason for damage in damages(path))


def test_a_message_shorter_than_its_head_is_damage():
    data = HEAD.pack(5, 3) + b"abc"
    with pytest.raises(ValueError, match="message of 3 bytes"):
        list(unpack(Chunk("", data, 0, 0, 0, len(data))))


def test_empty_messages_are_not_free(tmp_path, monkeypatch):
    path = write(tmp_path / "e.mcap", make_script(frames=12))
    monkeypatch.setattr("jenga_data.log.gather.MESSAGE_BYTES", 2**40)
    with pytest.raises(CheckFailed, match="bytes of frames; allowed"):
        read_episode(path)


def test_ever_more_damage_is_given_up(tmp_path):
    """Places that look like chunks and are none: each sends the search for a whole one through what follows."""
    false = HEAD.pack(6, 2**40) + bytes(28) + struct.pack("<I", 4) + b"zstd"
    path = tmp_path / "e.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + false * 20 * MAX_DAMAGES)
    found = damages(path)
    assert len(found) < MAX_DAMAGES + 10
    assert "the rest was not looked at" in found[-1].reason


@pytest.mark.parametrize("key", ["../../x", "/etc/x", "a\\b", ".bashrc", "C:x", "a\nb"])
def test_a_key_names_no_place_elsewhere(tmp_path, key):
    script = make_script(frames=2)
    path = write(tmp_path / "e.mcap", replace(script, header=replace(script.header, key=key)))
    with pytest.raises(CheckFailed, match=r"metadata key is [^\n]*; allowed: a plain file name"):
        read_header(path)


def test_long_names_are_refused(tmp_path):
    script = make_script(frames=2)
    path = write(tmp_path / "e.mcap", replace(script, header=replace(script.header, kind="x" * 1000)))
    with pytest.raises(CheckFailed, match="metadata kind has 1000 characters; allowed: 128"):
        read_header(path)


@pytest.mark.parametrize(("depth", "fine"), [(MAX_DEPTH - 2, True), (MAX_DEPTH + 1, False)])
def test_a_config_is_nested_so_deep_and_no_deeper(tmp_path, depth, fine):
    config = {}
    for _ in range(depth):
        config = {"deeper": config}
    script = make_script(frames=2)
    path = write(tmp_path / "e.mcap", replace(script, header=replace(script.header, config=config)))
    if fine:
        assert read_header(path)[0].config == config
    else:
        with pytest.raises(CheckFailed, match="nested more than 32 deep"):
            read_header(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "e.mcap")
    with pytest.raises(JengaError, match="is no regular file"):
        read_header(tmp_path / "e.mcap")
