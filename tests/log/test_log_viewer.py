"""What stock viewers draw: the URDF hangs together, and /tf says where its links are."""

import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import matplotlib.image
import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from mcap.reader import make_reader
from synthetic_log import make_script, write

from jenga_data.geometry import rotation_matrices
from jenga_data.log.urdf import ghost_urdf, gripper_urdf, tower_urdf, wood
from jenga_data.log.viewer import Transforms, gripper_poses
from jenga_data.replay.rerun_adapter import screenshot


def messages(path, topic):
    with path.open("rb") as stream:
        return [(message.log_time, message.data) for _, _, message in make_reader(stream).iter_messages(topics=topic)]


def links(urdf):
    return [link.get("name") for link in ElementTree.fromstring(urdf).iter("link")]


@pytest.mark.parametrize(
    ("urdf", "bodies"),
    [
        (tower_urdf(np.full((54, 3), 0.02), 7), [f"block_{i}" for i in range(54)]),
        (ghost_urdf(np.full((6, 3), 0.02), 1, "gns/"), [f"gns/block_{i}" for i in range(6)]),
        (gripper_urdf(), ["hand", "left_finger", "right_finger"]),
    ],
)
def test_every_body_floats_in_the_world(urdf, bodies):
    robot = ElementTree.fromstring(urdf)
    assert links(urdf) == ["world", *bodies]
    assert [child.get("link") for child in robot.findall("joint/child")] == bodies
    assert [parent.get("link") for parent in robot.findall("joint/parent")] == ["world"] * len(bodies)
    assert {joint.get("type") for joint in robot.findall("joint")} == {"floating"}


def test_boxes_are_as_large_as_the_blocks():
    size = make_script().header.blocks.size
    boxes = [box.attrib["size"] for box in ElementTree.fromstring(tower_urdf(size, 0)).iter("box")]
    assert [[float(v) for v in box.split()] for box in boxes[1:]] == size.tolist()  # the first one is the table


def test_blocks_can_be_told_apart_and_the_target_stands_out():
    colors = [wood(i)[:3] for i in range(54)]
    assert len(set(colors)) == 54
    robot = ElementTree.fromstring(tower_urdf(np.full((54, 3), 0.02), 7))
    (target,) = robot.findall("link[@name='block_7']/visual/material/color")
    rgba = [float(v) for v in target.attrib["rgba"].split()]
    assert min(np.abs(np.array(rgba[:3]) - color).max() for color in colors) > 0.1


def test_transforms_are_the_poses(log, script):
    drawn = [(t, FrameTransforms.FromString(d)) for t, d in messages(log, "/tf")]
    blocks = [(t, m) for t, m in drawn if m.transforms[0].child_frame_id == "block_0"]
    assert [t for t, _ in blocks] == [frame.time_ns for frame in script.frames]
    for (time, message), frame in zip(blocks, script.frames, strict=True):
        for i, transform in enumerate(message.transforms):
            p, q = transform.translation, transform.rotation
            assert [p.x, p.y, p.z, q.w, q.x, q.y, q.z] == frame.pose[i].tolist()
            assert (transform.parent_frame_id, transform.child_frame_id) == ("world", f"block_{i}")
            assert transform.timestamp.ToNanoseconds() == time
    hands = [m for _, m in drawn if m.transforms[0].child_frame_id == "hand"]
    assert len(hands) == len(script.frames) - 1  # the first sample comes after the first frame


def test_no_gripper_is_drawn_where_there_is_none(tmp_path):
    path = write(tmp_path / "e.mcap", make_script(gripper=False))
    assert messages(path, "/gripper/robot_description") == []
    assert len(messages(path, "/tf")) == 12


def test_fingers_stand_apart_by_the_width_across_the_hand():
    pose = np.array([0.1, -0.2, 0.3, np.cos(0.4), 0, 0, np.sin(0.4)])
    hand, left, right = gripper_poses(pose, 0.03)
    assert np.array_equal(hand, pose)
    assert np.allclose((left[:3] + right[:3]) / 2, pose[:3])
    assert np.allclose(rotation_matrices(pose[3:]).T @ (left[:3] - right[:3]), [0, 0.03, 0])


def test_large_times_split_without_rounding():
    time = 1_700_000_000_123_456_789
    (transform,) = Transforms(["a"]).fill(np.eye(7)[:1], time).transforms
    assert transform.timestamp.ToNanoseconds() == time


def test_description_is_a_ros2_string(log):
    ((_, data),) = messages(log, "/robot_description")
    assert data[:4] == b"\0\1\0\0"  # CDR, little-endian
    length = int.from_bytes(data[4:8], "little")
    assert len(data) == 8 + length
    assert data[-1:] == b"\0"
    assert len(links(data[8:-1].decode())) == 7


def vulkan_drivers() -> list[Path]:
    named = os.environ.get("VK_DRIVER_FILES") or os.environ.get("VK_ICD_FILENAMES")
    if named:
        return [Path(p) for p in named.split(os.pathsep) if Path(p).exists()]
    return [
        p for folder in ("/usr/share", "/etc", "/usr/local/share") for p in Path(folder).glob("vulkan/icd.d/*.json")
    ]


@pytest.mark.skipif(not vulkan_drivers(), reason="no Vulkan driver (Debian: apt-get install mesa-vulkan-drivers)")
def test_stock_rerun_shows_the_tower_and_its_target_on_the_way_out(tmp_path):
    """The viewer opens the log itself: no plugin, no blueprint, nothing of this package."""
    script = make_script(frames=60, blocks=54, gripper=False)
    path = write(tmp_path / "e.mcap", script)
    column = []
    for at in (0.0, script.frames[-1].time_ns * 1e-9):
        screenshot(path, tmp_path / "shown.png", at, window=(1280, 800))
        picture = matplotlib.image.imread(tmp_path / "shown.png")[60:590, 200:940, :3]  # where rerun puts its views
        red, green, blue = np.moveaxis(picture, 2, 0)
        assert ((red > 0.5) & (red - blue > 0.15) & (green > blue)).mean() > 0.002  # wood
        target = np.argwhere((blue > 0.5) & (blue - red > 0.3))
        assert len(target) > 10
        column.append(target[:, 1].mean())
    assert abs(column[1] - column[0]) > 5  # it was pulled


def test_stock_rerun_draws_tower_and_gripper(log, tmp_path):
    command = [sys.executable, "-m", "rerun_cli", "mcap", "convert", str(log), "-o", str(tmp_path / "e.rrd")]
    # CI=1 switches rerun's analytics off.
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=os.environ | {"CI": "1"})
    for entity in ("block_0/block_0", "block_5/block_5", "world/table", "left_finger/left_finger"):
        assert f"visual_geometries/{entity}" in done.stdout + done.stderr
    shown = subprocess.run(
        [sys.executable, "-m", "rerun_cli", "rrd", "print", str(tmp_path / "e.rrd")],
        check=True, capture_output=True, text=True, env=os.environ | {"CI": "1"},
    ).stdout  # fmt: skip
    assert "Transform3D:child_frame" in shown
    assert "Boxes3D:half_sizes" in shown
    assert "TextLog:text" in shown
