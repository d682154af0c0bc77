import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from mcap.records import Channel, Chunk, Message, Metadata
from synthetic_log import SCENE, make_script, write

from jenga_data.errors import CheckFailed, JengaError
from jenga_data.log.parse import parse_record, unpack
from jenga_data.log.profile import CONTACTS, RECOVERY_METADATA, SIM, STATE
from jenga_data.log.proto import jenga_pb2 as pb
from jenga_data.log.reader import attachment, read_episode, read_header
from jenga_data.log.records import open_log, read_record, walk
from jenga_data.log.recover import recover, recovered_path
from jenga_data.log.report import doctor, inspect

CUTS = 30
KINDS = {STATE: pb.TowerState, CONTACTS: pb.Contacts, SIM: pb.SimState}
SCRIPT = make_script(frames=40, state=1500)  # ten chunks


def chunk_spans(path):
    """Where each chunk begins and ends, and how many frames are complete at its end."""
    size, position, out = path.stat().st_size, 8, []
    topics, seen = {}, {STATE: set(), CONTACTS: set(), SIM: set()}
    with open_log(path) as stream:
        while position < size - 8:
            raw = read_record(stream, position, size)
            chunk = parse_record(raw)
            if isinstance(chunk, Chunk):
                for record in unpack(chunk):
                    if isinstance(record, Channel):
                        topics[record.id] = record.topic
                    elif isinstance(record, Message) and (topic := topics[record.channel_id]) in seen:
                        seen[topic].add(KINDS[topic].FromString(record.data).frame)
                out.append((position, position + len(raw), len(set.intersection(*seen.values()))))
            position += len(raw)
    return out


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write(tmp_path_factory.mktemp("whole") / "e.mcap", SCRIPT)


@pytest.fixture(scope="module")
def spans(whole):
    found = chunk_spans(whole)
    assert len(found) >= 8
    assert found[-1][2] == len(SCRIPT.frames)
    return found


@pytest.mark.parametrize("cut", range(CUTS))
def test_all_complete_frames_before_a_cut_are_saved(whole, spans, cut, tmp_path):
    data = whole.read_bytes()
    length = 8 + cut * (len(data) - 9) // (CUTS - 1)
    path, out = tmp_path / "cut.mcap", tmp_path / "out.mcap"
    path.write_bytes(data[:length])
    for read in (read_episode, read_header):
        with pytest.raises(CheckFailed, match=r"jenga log recover [^\n]*cut.mcap$"):
            read(path)
    readable = max((frames for _, end, frames in spans if end <= length), default=0)
    if not readable:
        with pytest.raises(CheckFailed, match="nothing can be recovered"):
            recover(path, out)
        assert list(tmp_path.iterdir()) == [path]
        return
    assert any("unfinished or was cut off" in line or "missing" in line for line in doctor(path).problems)
    report = recover(path, out)
    assert report.frames == readable
    assert report.lost
    episode = read_episode(out)
    for frame, pose, state in zip(SCRIPT.frames, episode.pose, episode.sim_state, strict=False):
        assert np.array_equal(pose, frame.pose)
        assert np.array_equal(state, frame.sim_state)
    assert len(episode.pose) == readable
    assert (episode.result is None) == (not report.has_outcome) == any("outcome" in line for line in report.lost)
    assert read_header(out)[0].key == SCRIPT.header.key
    assert attachment(out, "scene.xml") == SCENE.encode()
    assert inspect(out).complete
    assert inspect(out).recovery == {"lost": "\n".join(report.lost)}
    assert set(tmp_path.iterdir()) == {path, out}


def test_damage_in_the_middle_costs_one_chunk(whole, spans, tmp_path):
    data = bytearray(whole.read_bytes())
    start, end, _ = spans[5]
    data[(start + end) // 2] ^= 0xFF
    path, out = tmp_path / "bad.mcap", tmp_path / "out.mcap"
    path.write_bytes(data)
    report = recover(path, out)
    before, after = spans[4][2], spans[5][2]
    lost = {b - a for (_, _, a), (_, _, b) in pairwise(spans)}
    assert report.has_outcome
    assert len(SCRIPT.frames) - report.frames <= max(lost) + 1
    assert any("are missing in the middle" in line for line in report.lost)
    with pytest.raises(CheckFailed, match=rf"/tower/state lacks frame ({before}|{before + 1}) "):
        read_episode(out)
    assert after - before <= max(lost)
    assert any("lacks frames" in line for line in doctor(out).problems)


def test_a_wrong_length_costs_no_more_than_its_chunk(whole, spans, tmp_path):
    """Lengths can no longer be followed: the next chunk is found by what it looks like."""
    data = bytearray(whole.read_bytes())
    data[spans[5][0] + 1 : spans[5][0] + 9] = (123).to_bytes(8, "little")
    path = tmp_path / "bad.mcap"
    path.write_bytes(data)
    assert len(SCRIPT.frames) - recover(path, tmp_path / "out.mcap").frames <= 7


def test_a_lost_first_chunk_is_named_by_the_summary(tmp_path):
    """Channels are declared in the chunk that first uses them, and again in the summary."""
    path = write(tmp_path / "e.mcap", SCRIPT)
    with open_log(path) as stream:
        before = [r for r in walk(stream) if isinstance(r, Message)]
    start, end, _ = chunk_spans(path)[1]  # declares /tower/state and the others
    data = bytearray(path.read_bytes())
    data[(start + end) // 2] ^= 0xFF
    path.write_bytes(data)
    report = recover(path, tmp_path / "out.mcap")
    assert report.frames > 30
    assert sum(report.messages.values()) > len(before) * 0.75


def test_recovered_file_may_take_the_name_of_the_partial_one(tmp_path, whole):
    partial, out = tmp_path / "e.mcap.partial", tmp_path / "e.mcap"
    partial.write_bytes(whole.read_bytes()[:-100])
    before = partial.read_bytes()
    recover(partial, out)
    assert len(read_episode(out).pose) == len(SCRIPT.frames)
    assert partial.read_bytes() == before


def test_a_whole_file_is_copied_and_nothing_is_lost(whole, tmp_path):
    out = tmp_path / "out.mcap"
    report = recover(whole, out)
    assert (report.lost, report.frames, report.has_outcome) == ([], len(SCRIPT.frames), True)
    first, second = read_episode(whole), read_episode(out)
    for field in dataclasses.fields(first):
        if isinstance(value := getattr(first, field.name), np.ndarray):
            assert np.array_equal(value, getattr(second, field.name)), field.name
    assert doctor(out).problems == []
    with open_log(whole) as one, open_log(out) as two:
        assert [m for m in walk(one) if isinstance(m, Message)] == [m for m in walk(two) if isinstance(m, Message)]


def test_recovering_twice_keeps_what_was_lost_first(whole, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:-3000])
    recover(cut, tmp_path / "once.mcap")
    recover(tmp_path / "once.mcap", tmp_path / "twice.mcap")
    lost = inspect(tmp_path / "once.mcap").recovery["lost"]
    assert inspect(tmp_path / "twice.mcap").recovery["lost"].startswith(lost)
    with open_log(tmp_path / "twice.mcap") as stream:
        names = [record.name for record in walk(stream) if isinstance(record, Metadata)]
    assert names.count(RECOVERY_METADATA) == 1


def test_existing_files_are_not_overwritten(whole, tmp_path):
    out = tmp_path / "out.mcap"
    out.write_text("precious")
    with pytest.raises(JengaError, match=r"out.mcap exists; choose another name"):
        recover(whole, out)
    assert out.read_text() == "precious"
    assert recovered_path(tmp_path / "e.mcap.partial") == tmp_path / "e.recovered.mcap"
