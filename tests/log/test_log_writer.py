import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from synthetic_log import SCENE, STEP_NS, make_script, play, write

from jenga_data.blocks import Blocks
from jenga_data.episode import Contacts, Frame
from jenga_data.errors import JengaError
from jenga_data.log.actions import read_actions
from jenga_data.log.codec import packed
from jenga_data.log.profile import CONFIG
from jenga_data.log.profile import SCENE as SCENE_NAME
from jenga_data.log.proto import jenga_pb2 as pb
from jenga_data.log.reader import attachment, read_episode, read_header
from jenga_data.log.recover import recover
from jenga_data.log.writer import EpisodeWriter

ANY = st.floats(allow_nan=True, allow_infinity=True)


def same(a: np.ndarray, b: np.ndarray) -> bool:
    """Equal to the last bit, NaN and -0.0 too."""
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def test_episode_comes_back_exactly(log, script):
    episode = read_episode(log)
    for i, frame in enumerate(script.frames):
        assert episode.time_ns[i] == frame.time_ns
        assert same(episode.pose[i], frame.pose)
        assert same(episode.twist[i], frame.twist)
        assert same(episode.sim_state[i], frame.sim_state)
        for name in ("first", "second", "force"):
            assert same(getattr(episode.contacts[i], name), getattr(frame.contacts, name))
    assert episode.action_frame.tolist() == [a.frame for a in script.actions]
    assert same(episode.action, np.array([a.displacement for a in script.actions]))
    assert same(episode.action_reached, np.array([a.reached for a in script.actions]))
    for name in ("time_ns", "pose", "width", "left_force", "right_force"):
        assert same(getattr(episode.gripper, name), np.array([getattr(s, name) for s in script.gripper]))
    assert episode.phases == script.phases
    assert episode.result == script.result


def test_header_comes_back_exactly(log, script):
    header, result = read_header(log)
    for field in dataclasses.fields(header):
        if field.name not in ("blocks", "layout"):
            assert getattr(header, field.name) == getattr(script.header, field.name), field.name
    assert same(header.blocks.size, script.header.blocks.size)
    assert same(header.blocks.mass, script.header.blocks.mass)
    assert same(header.layout.grid, script.header.layout.grid)
    assert header.layout.moves == script.header.layout.moves
    assert result == script.result


@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_any_numbers_come_back_exactly(data, tmp_path_factory):
    count, state = data.draw(st.integers(1, 3)), data.draw(st.integers(0, 4))
    script = make_script(frames=1, blocks=3)
    size = data.draw(arrays(np.float64, (3, 3), elements=st.floats(1e-300, 1e300)))
    header = dataclasses.replace(script.header, blocks=Blocks(size, script.header.blocks.mass))
    frames = []
    for i in range(count):
        rows = data.draw(st.integers(0, 3))
        bodies = arrays(np.int64, rows, elements=st.integers(-4, 2))
        contacts = Contacts(
            data.draw(bodies), data.draw(bodies), data.draw(arrays(np.float64, (rows, 3), elements=ANY))
        )
        pose, twist = (data.draw(arrays(np.float64, (3, n), elements=ANY)) for n in (7, 6))
        sim_state = data.draw(arrays(np.float64, state, elements=ANY))
        frames.append(Frame(i, i * STEP_NS + 1, pose, twist, contacts, sim_state))
    path = tmp_path_factory.mktemp("any") / "e.mcap"
    write(path, dataclasses.replace(script, header=header, frames=frames, actions=[], phases=[], gripper=[]))
    episode = read_episode(path)
    assert same(episode.header.blocks.size, size)
    assert same(episode.pose, np.stack([f.pose for f in frames]))
    assert same(episode.twist, np.stack([f.twist for f in frames]))
    assert same(episode.sim_state, np.stack([f.sim_state for f in frames]))
    for read, frame in zip(episode.contacts, frames, strict=True):
        assert all(same(getattr(read, n), getattr(frame.contacts, n)) for n in ("first", "second", "force"))


def test_same_calls_write_same_bytes(tmp_path):
    first, second = (write(tmp_path / f"{i}.mcap", make_script()) for i in range(2))
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize("count", [0, 1, 15, 16, 40, 3000])
def test_packed_bytes_are_protobufs_own(count):
    values = np.random.default_rng(0).normal(size=count)
    assert packed(pb.SimState.STATE_FIELD_NUMBER, values) == pb.SimState(state=values.tolist()).SerializeToString()


def test_attachments_come_back(log):
    assert attachment(log, SCENE_NAME) == SCENE.encode()
    assert b"friction" in attachment(log, CONFIG)
    with pytest.raises(JengaError, match=r"no attachment 'x'; it has: config.json, scene.xml"):
        attachment(log, "x")


def break_off(path, script):
    with EpisodeWriter(path, script.header, SCENE) as writer:
        play(writer, script)
        raise RuntimeError("physics")


def test_exception_leaves_a_partial_file_with_every_frame(tmp_path, script):
    path = tmp_path / "e.mcap"
    with pytest.raises(RuntimeError, match="physics"):
        break_off(path, script)
    assert not path.exists()
    recover(tmp_path / "e.mcap.partial", path)
    episode = read_episode(path)
    assert len(episode.pose) == len(script.frames)
    assert episode.result is None


def test_killed_process_loses_at_most_one_chunk(tmp_path):
    script = make_script(frames=60, state=1500)
    path = tmp_path / "e.mcap"
    with EpisodeWriter(path, script.header, SCENE) as writer:
        play(writer, script)
        on_disk = (tmp_path / "e.mcap.partial").read_bytes()  # what is there if the process ends here
    (tmp_path / "killed.partial").write_bytes(on_disk)
    report = recover(tmp_path / "killed.partial", tmp_path / "out.mcap")
    assert report.frames >= len(script.frames) - 6  # 64 KiB are five frames of 12 kB


def test_nothing_is_written_after_the_end(log, script, tmp_path):
    writer = EpisodeWriter(tmp_path / "x.mcap", script.header, SCENE)
    writer.finish(script.result)
    before = (tmp_path / "x.mcap").read_bytes()
    with pytest.raises(ValueError, match="finished"):
        writer.frame(script.frames[0])
    assert (tmp_path / "x.mcap").read_bytes() == before
    assert not (tmp_path / "x.mcap.partial").exists()


def test_full_disk_is_one_line(tmp_path, script):
    (tmp_path / "e.mcap.partial").symlink_to("/dev/full")
    with pytest.raises(JengaError, match=r"^cannot write .*e.mcap.partial: No space left on device; [^\n]*$"):
        write(tmp_path / "e.mcap", script)
    assert not (tmp_path / "e.mcap").exists()


def test_missing_folder_is_one_line(tmp_path, script):
    with pytest.raises(JengaError, match=r"^cannot write .*No such file or directory; [^\n]*$"):
        EpisodeWriter(tmp_path / "no" / "e.mcap", script.header, SCENE)


def test_what_was_wanted_comes_back_beside_what_was_done(tmp_path, script):
    """Left out where it is the same, as in every file of an older profile."""
    wanted = np.array([-0.005, 0.013, -0.002])
    first, *rest = script.actions
    asked = dataclasses.replace(script, actions=[dataclasses.replace(first, wanted=wanted), *rest])
    episode = read_episode(write(tmp_path / "asked.mcap", asked))
    assert episode.action_wanted is not None
    assert same(episode.action_wanted[0], wanted)
    assert same(episode.action_wanted[1:], episode.action[1:])
    assert read_episode(write(tmp_path / "plain.mcap", script)).action_wanted is None
    frame, action = read_actions(tmp_path / "asked.mcap")
    assert same(frame, episode.action_frame)
    assert same(action, episode.action)
