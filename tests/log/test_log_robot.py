"""A robot in a log: it comes back exactly, whoever wrote it; nonsense is named; viewers get its links."""

import dataclasses
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from google.protobuf.message import Message
from mcap.reader import make_reader
from mcap.writer import Writer
from synthetic_log import SCENE, make_script, with_robot, write
from three_link_robot import MODEL, state

from jenga_data.episode import Link, RobotModel, Solid
from jenga_data.errors import CheckFailed
from jenga_data.log import codec, profile
from jenga_data.log.header import write_metadata
from jenga_data.log.proto import jenga_pb2 as pb
from jenga_data.log.reader import read_episode, read_header
from jenga_data.log.recover import recover
from jenga_data.log.report import doctor, inspect
from jenga_data.log.urdf import robot_urdf
from jenga_data.log.writer import EpisodeWriter

SCRIPT = with_robot(make_script(frames=8))
STATES = [state(0.05 * i, speed=1.5) for i in range(8)]
"""The robot's, as `with_robot` makes them."""
PARTS = ("position", "velocity", "torque", "link_pose")


@pytest.fixture
def robot_log(tmp_path):
    return write(tmp_path / "robot.mcap", SCRIPT)


def messages(path, topic):
    with path.open("rb") as stream:
        return [message.data for _, _, message in make_reader(stream).iter_messages(topics=topic)]


def with_state(at, /, **changes):
    """The script with the robot's state changed in one frame."""
    frames = list(SCRIPT.frames)
    frames[at] = dataclasses.replace(frames[at], robot=dataclasses.replace(frames[at].robot, **changes))
    return dataclasses.replace(SCRIPT, frames=frames)


def with_angle(at, angle):
    frames = list(SCRIPT.frames)
    frames[at] = dataclasses.replace(frames[at], turntable=angle)
    return dataclasses.replace(SCRIPT, frames=frames)


def with_model(model):
    return dataclasses.replace(SCRIPT, header=dataclasses.replace(SCRIPT.header, robot=model))


# --- round trip ----------------------------------------------------------------------------------------------------


def test_a_robot_comes_back_exactly(robot_log):
    episode = read_episode(robot_log)
    assert episode.header.robot == MODEL
    assert episode.robot is not None
    for name in PARTS:
        found, written = getattr(episode.robot, name), np.stack([getattr(f.robot, name) for f in SCRIPT.frames])
        assert found.shape == written.shape
        assert found.tobytes() == written.tobytes()
    assert episode.turntable.tolist() == [frame.turntable for frame in SCRIPT.frames]
    assert doctor(robot_log).problems == []


def test_the_header_alone_has_the_robot_too(robot_log, log):
    assert read_header(robot_log)[0].robot == MODEL
    assert read_header(log)[0].robot is None


def test_a_robot_without_joints_and_a_link_without_solids_come_back(tmp_path):
    bare = RobotModel((), (Link("tip", ()),))
    none = np.zeros(0)
    still = dataclasses.replace(state(0.0), position=none, velocity=none, torque=none, link_pose=np.eye(7)[3:4])
    frames = [dataclasses.replace(frame, robot=still) for frame in SCRIPT.frames]
    script = dataclasses.replace(with_model(bare), frames=frames)
    episode = read_episode(write(tmp_path / "e.mcap", script))
    assert episode.header.robot == bare
    assert episode.robot is not None
    assert episode.robot.position.shape == (8, 0)
    assert episode.robot.link_pose.shape == (8, 1, 7)


def test_a_log_without_a_robot_holds_nothing_of_one(log, script):
    episode = read_episode(log)
    assert episode.robot is None
    assert episode.turntable.tolist() == [0.0] * len(script.frames)
    assert not any(topic.startswith("/robot/") or topic == "/robot" for topic in inspect(log).topics)
    first = script.frames[0]
    by_protobuf = pb.TowerState(frame=0, pose=first.pose.ravel().tolist(), twist=first.twist.ravel().tolist())
    assert messages(log, "/tower/state")[0] == by_protobuf.SerializeToString()


@pytest.mark.parametrize("index", [0, 3])
def test_packed_states_are_protobufs_own(index):
    frame = SCRIPT.frames[index]
    fields = {name: getattr(frame.robot, name).ravel().tolist() for name in PARTS}
    assert codec.write_robot_state(index, frame.robot) == pb.RobotState(frame=index, **fields).SerializeToString()
    pose, twist = frame.pose.ravel().tolist(), frame.twist.ravel().tolist()
    whole = pb.TowerState(frame=index, pose=pose, twist=twist, turntable=frame.turntable)
    assert codec.write_state(frame) == whole.SerializeToString()


def test_a_frame_and_the_header_agree_on_whether_there_is_a_robot(tmp_path, script):
    for header, frame in ((SCRIPT.header, script.frames[0]), (script.header, SCRIPT.frames[0])):
        with (
            EpisodeWriter(tmp_path / "e.mcap", header, SCENE) as writer,
            pytest.raises(ValueError, match="frame 0 and the header differ"),
        ):
            writer.frame(frame)


# --- files of version 1.0 and of other writers ---------------------------------------------------------------------


def test_a_log_of_version_1_0_is_still_read(tmp_path, script, monkeypatch):
    """Without a robot and without an angle, the new writer's messages are those of version 1.0."""
    monkeypatch.setattr(
        "jenga_data.log.writer.write_metadata", lambda header: write_metadata(header) | {"version": "1.0"}
    )
    path = write(tmp_path / "old.mcap", script)
    assert inspect(path).episode["version"] == "1.0"
    assert doctor(path).problems == []
    episode = read_episode(path)
    assert (episode.robot, episode.header.robot) == (None, None)
    assert episode.pose.tobytes() == np.stack([frame.pose for frame in script.frames]).tobytes()


def test_files_say_version_1_1(robot_log):
    assert inspect(robot_log).episode["version"] == "1.2"


ROBOT = pb.Robot(
    joint=["rail"],
    link=[
        pb.Link(name="cart", solid=[pb.Solid(shape="box", size=[1, 2, 3], pose=[0, 0, 0, 1, 0, 0, 0], color=[1] * 4)]),
        pb.Link(name="stick"),
    ],
)


def robot_state(frame, **changes):
    fields = {"position": [0.5], "velocity": [0], "torque": [0], "link_pose": [0, 0, 0, 1, 0, 0, 0] * 2}
    return pb.RobotState(frame=frame, **(fields | changes))


def by_hand(path, robot, states):
    """Three frames of a tower of one block, and a robot's messages as given, by the mcap library and protobuf."""
    tower = pb.Tower(size=[0.075, 0.025, 0.015], mass=[0.02], level=[0], slot=[1])
    rows: list[tuple[str, int, Message]] = [("/tower", 0, tower)]
    rows += [
        ("/tower/state", i, pb.TowerState(frame=i, pose=[0, 0, 0, 1, 0, 0, 0], twist=[0] * 6, turntable=0.1 * i))
        for i in range(3)
    ]
    rows += [("/robot", 0, r) for r in robot] + [("/robot/state", s.frame, s) for s in states]
    rows.append(("/outcome", 2, pb.Outcome(label="stuck", clear_frame=-1)))
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for topic, time, message in rows:
            name = message.DESCRIPTOR.full_name
            schema = writer.register_schema(name, "protobuf", profile.schema_of(type(message)))
            writer.add_message(writer.register_channel(topic, "protobuf", schema), time, message.SerializeToString(), 0)
        text = {"version": "1.1", "key": "lab", "kind": "extraction", "seed": "0", "number": "0"}
        writer.add_metadata("jenga", text | {"control_step_ns": "1"})
        writer.finish()
    return path


def test_a_robot_by_another_writer_is_read(tmp_path):
    path = by_hand(tmp_path / "e.mcap", [ROBOT], [robot_state(i) for i in (2, 0, 1)])
    episode = read_episode(path)
    assert episode.header.robot is not None
    assert episode.header.robot.joints == ("rail",)
    assert [link.name for link in episode.header.robot.links] == ["cart", "stick"]
    (solid,) = episode.header.robot.links[0].solids
    assert solid == Solid("box", (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0))
    assert episode.robot is not None
    assert episode.robot.position.tolist() == [[0.5]] * 3
    assert episode.turntable.tolist() == [0.0, 0.1, 0.2]
    assert doctor(path).problems == []


ALL = [robot_state(i) for i in range(3)]
MANY = pb.Robot(joint=[f"j{i}" for i in range(257)])
HEAVY = pb.Robot(link=[pb.Link(name="a", solid=[ROBOT.link[0].solid[0]] * 257)])
REFUSALS = {
    "no model": ([], ALL, "no messages on /robot; needed where there is /robot/state", "/robot/state without /robot"),
    "no states": ([ROBOT], [], "no messages on /robot/state; needed", "/robot without /robot/state"),
    "two models": ([ROBOT, ROBOT], ALL, "2 messages on /robot; allowed: 1", "header: 2 messages"),
    "a frame less": ([ROBOT], ALL[:2], "/robot/state has 2 frames|/robot/state lacks frame 2", "lacks frames 2"),
    "a frame more": ([ROBOT], [*ALL, robot_state(3)], "/robot/state has 4 frames", "frames 3 without /tower/state"),
    "twice": ([ROBOT], [*ALL, ALL[0]], "/robot/state has frame 0 twice", "has frame 0 twice"),
    "joints": ([ROBOT], [*ALL[:2], robot_state(2, torque=[])], "0 numbers where 1 are needed", "at 2 ns: 0 numbers"),
    "links": ([ROBOT], [*ALL[:2], robot_state(2, link_pose=[0] * 7)], "7 numbers where 2 x 7 are", "at 2 ns: 7 num"),
    "many joints": ([MANY], ALL, "a robot of 257 joints; allowed: up to 256", "header: /robot: a robot of 257"),
    "many solids": ([HEAVY], ALL, "/robot: link 'a' of 257 solids; allowed: up to 256", "257 solids"),
    "same joints": ([pb.Robot(joint=["a", "a"])], ALL, "two joints named 'a'; allowed: one", "two joints"),
    "same links": ([pb.Robot(link=[pb.Link(name="b")] * 2)], ALL, "two links named 'b'; allowed: one", "two links"),
    "no name": ([pb.Robot(link=[pb.Link()])], ALL, "links named ''; allowed: one printable", "links named ''"),
    "control character": ([pb.Robot(joint=["a\n"])], ALL, r"joints named 'a\\n'; allowed", "joints named"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSALS)
def test_half_a_robot_and_absurd_ones_are_refused_and_named(name, tmp_path):
    robot, states, refusal, complaint = REFUSALS[name]
    path = by_hand(tmp_path / "e.mcap", robot, states)
    with pytest.raises(CheckFailed, match=refusal) as refused:
        read_episode(path)
    assert "\n" not in str(refused.value)
    assert any(re.search(complaint, line) for line in doctor(path).problems), doctor(path).problems


BOX = {"shape": "box", "size": [0.1, 0.1, 0.1], "pose": [0, 0, 0, 1, 0, 0, 0], "color": [1, 1, 1, 1]}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"shape": "cone"}, "link 'cart': shape 'cone'; allowed: box, sphere, cylinder, capsule"),
        ({"size": [0.1, 0.1, 0.0]}, "box of size .*; allowed: 3 positive numbers, then zeros"),
        ({"size": [0.1, float("nan"), 0.1]}, "box of size"),
        ({"size": [0.1]}, "link 'cart': 1 numbers where 3 are needed"),
        ({"shape": "sphere", "size": [0.1, 0.1, 0.0]}, "sphere of size .*; allowed: 1 positive number"),
        ({"shape": "capsule", "size": [0.1, float("inf"), 0.0]}, "capsule of size"),
        ({"pose": [0.0] * 7}, "box at .*; allowed: finite numbers and a quaternion of length 1"),
        ({"color": [0.0, 0.0, 0.0, 1.5]}, "box of color .*; allowed: 0 to 1"),
        ({"color": [0.0, 0.0, 1.0]}, "3 numbers where 4 are needed"),
    ],
)
def test_solids_that_are_none_are_refused(changes, message, tmp_path):
    link = pb.Link(name="cart", solid=[pb.Solid(**(BOX | changes))])
    path = by_hand(tmp_path / "e.mcap", [pb.Robot(joint=["rail"], link=[link, pb.Link(name="stick")])], ALL)
    for read in (read_episode, read_header):
        with pytest.raises(CheckFailed, match=message):
            read(path)
    assert any(re.search(message, line) for line in doctor(path).problems), doctor(path).problems


def spoiled(array, value):
    out = array.copy()
    out.flat[-1] = value
    return out


THIRD = STATES[3]
COMPLAINTS = {
    "position": (with_state(3, position=spoiled(THIRD.position, np.nan)), "/robot/state position: .* in frames 3"),
    "velocity": (with_state(3, velocity=spoiled(THIRD.velocity, np.inf)), "/robot/state velocity: .* in frames 3"),
    "torque": (with_state(3, torque=spoiled(THIRD.torque, np.nan)), "/robot/state torque: .* in frames 3"),
    "link": (with_state(3, link_pose=spoiled(THIRD.link_pose, np.nan)), "/robot/state link: .* finite in frames 3"),
    "quaternion": (with_state(3, link_pose=spoiled(THIRD.link_pose, 0.9)), "/robot/state link: quater.* in frames 3"),
    "turntable": (with_angle(3, float("nan")), "/tower/state turntable: .* not finite in frames 3"),
    "first angle": (with_angle(0, 0.1), "turntable: 0.1 rad in frame 0, from which it counts; needed: 0"),
}  # fmt: skip


@pytest.mark.parametrize("name", COMPLAINTS)
def test_states_that_make_no_sense_are_named(name, tmp_path):
    script, message = COMPLAINTS[name]
    problems = doctor(write(tmp_path / "e.mcap", script)).problems
    assert len(problems) == 1
    assert re.search(message, problems[0]), problems


# --- recovery ------------------------------------------------------------------------------------------------------


def test_a_robot_is_recovered_frame_by_frame(tmp_path):
    script = with_robot(make_script(frames=30, state=1500))
    states = [frame.robot for frame in script.frames if frame.robot is not None]
    data = write(tmp_path / "e.mcap", script).read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) // 2])
    report = recover(tmp_path / "cut.mcap", tmp_path / "out.mcap")
    episode = read_episode(tmp_path / "out.mcap")
    assert 0 < report.frames < 30
    assert episode.header.robot == MODEL
    assert episode.robot is not None
    assert len(episode.robot.position) == report.frames == report.messages["/robot/state"]
    assert np.array_equal(episode.robot.link_pose[-1], states[report.frames - 1].link_pose)


@pytest.mark.parametrize(("robot", "states", "left"), [([], ALL, "/robot/state"), ([ROBOT], [], "/robot")])
def test_half_a_robot_does_not_keep_the_tower_from_being_recovered(robot, states, left, tmp_path):
    path = by_hand(tmp_path / "e.mcap", robot, states)
    report = recover(path, tmp_path / "out.mcap")
    assert report.lost == [f"{left}: its other half is lost"]
    assert read_episode(tmp_path / "out.mcap").robot is None


# --- viewers -------------------------------------------------------------------------------------------------------


def test_viewers_get_the_links_at_every_frame_and_no_schematic_gripper(robot_log):
    assert SCRIPT.gripper
    assert messages(robot_log, "/gripper/robot_description") == []
    ((description),) = messages(robot_log, "/robot/robot_description")
    assert robot_urdf(MODEL).encode() in description
    drawn = [FrameTransforms.FromString(data).transforms for data in messages(robot_log, "/tf")]
    links = [t for t in drawn if t[0].child_frame_id.startswith("robot/")]
    assert len(drawn) == 2 * len(SCRIPT.frames)
    for transforms, there in zip(links, STATES, strict=True):
        assert [t.child_frame_id for t in transforms] == ["robot/base", "robot/arm", "robot/tool 1"]
        for transform, pose in zip(transforms, there.link_pose.tolist(), strict=True):
            p, q = transform.translation, transform.rotation
            assert [p.x, p.y, p.z, q.w, q.x, q.y, q.z] == pose


def test_stock_rerun_draws_the_links(robot_log, tmp_path):
    command = [sys.executable, "-m", "rerun_cli", "mcap", "convert", str(robot_log), "-o", str(tmp_path / "e.rrd")]
    # CI=1 switches rerun's analytics off.
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=os.environ | {"CI": "1"})
    for link, solids in (("base", ("0", "1")), ("arm", ("0", "0_low", "0_high"))):
        for solid in solids:
            assert f"visual_geometries/robot\\/{link}/robot\\/{link}_{solid}" in done.stdout + done.stderr
