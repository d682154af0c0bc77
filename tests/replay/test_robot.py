"""A robot in a replay: its links in rerun and in pictures where the log has them, its joints and the turntable."""

import time
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from made_up_episode import TARGET, make_episode
from rerun.chunk import Chunk, RrdReader
from three_link_robot import BASE, MODEL, REACH, track

from jenga_data.episode import ROBOT, Contacts, Episode, Phase, Result
from jenga_data.geometry import rotation_matrices
from jenga_data.outcome import Outcome, Verdict
from jenga_data.replay.contact_points import contact_points
from jenga_data.replay.curves import episode_curves
from jenga_data.replay.measures import displacement
from jenga_data.replay.moments import Moment, telling_moments
from jenga_data.replay.paint import TURNTABLE
from jenga_data.replay.picture import AZIMUTH, free_azimuth, render_tower, robot_parts, tower_camera
from jenga_data.replay.rerun_adapter import FRAME, write_rrd
from jenga_data.replay.series import episode_series
from jenga_data.replay.side_by_side import film_strip
from jenga_data.replay.solids import Boxes, Faces, robot_faces, solid_quads
from jenga_data.tower import turn_poses

SOLIDS = {
    "/world/robot/base/box",
    "/world/robot/base/cylinder",
    "/world/robot/arm/capsule",
    "/world/robot/tool\\ 1/sphere",
    "/world/robot/tool\\ 1/box",
}


def with_robot(episode: Episode) -> Episode:
    frames = len(episode.time_ns)
    return replace(episode, header=replace(episode.header, robot=MODEL), robot=track(frames))


@pytest.fixture(scope="module")
def moved(episode: Episode) -> Episode:
    """The made-up episode with the three-link robot."""
    return with_robot(episode)


# --- rerun ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def recorded(moved: Episode, tmp_path_factory: pytest.TempPathFactory) -> tuple[RrdReader, dict[str, list[Chunk]]]:
    out = tmp_path_factory.mktemp("robot") / "robot.rrd"
    write_rrd(replace(moved, turntable=0.01 * np.arange(len(moved.time_ns))), [], out)
    reader = RrdReader(out)
    chunks: dict[str, list[Chunk]] = {}
    for chunk in reader.stream():
        chunks.setdefault(str(chunk.entity_path), []).append(chunk)
    return reader, chunks


def column(chunks: list[Chunk], name: str) -> np.ndarray:
    tables = [chunk.to_record_batch() for chunk in chunks]
    return np.array([row for t in tables if name in t.schema.names for row in t.column(name).to_pylist()])


def test_a_recording_has_every_link_at_every_frame(recorded, moved: Episode) -> None:
    _, chunks = recorded
    assert {path for path in chunks if path.startswith("/world/robot/") and path.count("/") == 4} == SOLIDS
    assert moved.robot is not None
    for number, link in enumerate(("base", "arm", "tool\\ 1")):
        found = chunks[f"/world/robot/{link}"]
        pose = moved.robot.link_pose[:, number]
        np.testing.assert_allclose(column(found, "Transform3D:translation")[:, 0], pose[:, :3], atol=1e-6)
        turn = column(found, "Transform3D:quaternion")[:, 0]
        np.testing.assert_allclose(turn[:, [3, 0, 1, 2]], pose[:, 3:], atol=1e-6)
        assert column(found, FRAME).tolist() == list(range(len(moved.time_ns)))


def test_a_capsule_begins_at_its_lower_end(recorded) -> None:
    """rerun's capsule has its origin there; the log's in the middle. This one lies along the link's x from 0 on."""
    _, chunks = recorded
    arm = chunks["/world/robot/arm/capsule"]
    np.testing.assert_allclose(column(arm, "Capsules3D:translations")[0, 0], [0, 0, 0], atol=1e-7)
    np.testing.assert_allclose(column(arm, "Capsules3D:lengths")[0, 0], REACH, rtol=1e-6)
    x, y, z, w = column(arm, "Capsules3D:quaternions")[0, 0]
    np.testing.assert_allclose(rotation_matrices(np.array([w, x, y, z]))[:, 2], [1, 0, 0], atol=1e-6)


def test_a_robot_takes_the_schematic_hand_s_place(recorded, moved: Episode) -> None:
    _, chunks = recorded
    assert len(moved.gripper.time_ns)
    assert "/world/gripper" not in chunks


def test_joints_and_turntable_have_curves_behind_each_other(recorded) -> None:
    reader, chunks = recorded
    np.testing.assert_allclose(column(chunks["/curve/robot/torque"], "Scalars:scalars")[:, 1], 2.5)
    angle = column(chunks["/curve/turntable"], "Scalars:scalars")[:, 0]
    np.testing.assert_allclose(angle, np.degrees(0.01 * np.arange(len(angle))))
    (blueprint,) = reader.blueprints()
    tables = [chunk.to_record_batch() for chunk in reader.stream(store=blueprint)]
    name = "ViewBlueprint:display_name"
    titles = {title for t in tables if name in t.schema.names for (title,) in t.column(name).to_pylist()}
    assert {"joints [rad]", "speed [rad/s]", "torque [N m]", "turntable [°]", "phases"} <= titles


def test_without_a_robot_there_are_no_such_curves(episode: Episode) -> None:
    assert not any(series.tab for series in episode_series(episode, []))


def test_a_minute_with_a_robot_takes_less_than_five_seconds(tmp_path: Path) -> None:
    """1.2 s on two idle cores for 60 s at 31 frames a second."""
    short, count = make_episode(frames=60), 1860
    many = np.resize(np.arange(60), count)
    long = replace(
        short,
        time_ns=np.arange(count) * 32_000_000,
        pose=short.pose[many],
        twist=short.twist[many],
        sim_state=short.sim_state[many],
        contacts=[short.contacts[k] for k in many],
        turntable=np.zeros(count),
    )
    start = time.perf_counter()
    write_rrd(with_robot(long), [], tmp_path / "long.rrd")
    assert time.perf_counter() - start < 5.0


# --- solids --------------------------------------------------------------------------------------------------------


def test_solids_move_with_their_links(moved: Episode) -> None:
    assert moved.robot is not None
    first, last = (robot_faces(MODEL, moved.robot.link_pose[k]) for k in (0, -1))
    base = len(solid_quads("box", (1, 1, 1))[0]) + len(solid_quads("cylinder", (1, 1, 0))[0])
    np.testing.assert_array_equal(first.corner[:base], last.corner[:base])
    assert first.corner[:base, :, 2].min() == pytest.approx(BASE[2])
    for faces, pose in ((first, moved.robot.link_pose[0]), (last, moved.robot.link_pose[-1])):
        tip = pose[2, :3] + rotation_matrices(pose[2, 3:])[:, 0] * 0.05
        assert np.linalg.norm(faces.corner - tip, axis=-1).min() < 0.01


# --- pictures ------------------------------------------------------------------------------------------------------


def test_a_picture_changes_where_the_robot_is(moved: Episode, tmp_path: Path) -> None:
    """The arm is red: its pixels lie where the camera sees its capsule, and nowhere without the robot."""
    tower = Boxes(moved.pose[60], moved.header.blocks.size, np.zeros((54, 3)))
    (robot,) = robot_parts(moved, 60)
    camera = tower_camera([tower, robot])
    plain, drawn = (
        render_tower(tmp_path / "t.png", tower.pose, tower.size, target=TARGET, others=o, camera=camera, height=300)
        for o in ([], [robot])
    )
    red = (drawn[..., 0] > 0.4) & (drawn[..., 1] < 0.25 * drawn[..., 0])
    assert not ((plain[..., 0] > 0.4) & (plain[..., 1] < 0.25 * plain[..., 0])).any()
    assert red.sum() > 500
    assert isinstance(robot, Faces)
    arm = camera.project(robot.corner[(robot.colour[:, 0] > 0.8) & (robot.colour[:, 1] < 0.2)].reshape(-1, 3))
    u, v = camera.pixel_grid(drawn.shape[1], drawn.shape[0])
    rows, columns = np.nonzero(red)
    pixel = u[1] - u[0]
    assert arm[:, 0].min() - pixel < u[columns].min() < u[columns].max() < arm[:, 0].max() + pixel
    assert arm[:, 1].min() - pixel < v[rows].min() < v[rows].max() < arm[:, 1].max() + pixel


def test_the_stand_is_a_disc_on_a_column(tmp_path: Path) -> None:
    """Seen from the side, below the disc: as wide as the column, white beside it, and nothing below the floor."""
    nothing = np.zeros((0, 7)), np.zeros((0, 3))
    camera = tower_camera([], elevation=0.05)
    image = render_tower(tmp_path / "t.png", *nothing, camera=camera, height=240)
    u, v = camera.pixel_grid(image.shape[1], image.shape[0])
    row = image[int(np.argmin(np.abs(v - camera.project(np.array([0, 0, -0.045]))[1])))]
    grey = u[row.max(axis=-1) < 0.65]
    assert grey.max() - grey.min() == pytest.approx(0.06, rel=0.1)
    assert TURNTABLE.has_column


def test_a_film_strip_of_a_robot_has_two_rows_and_shows_what_is_near_the_tower(episode: Episode) -> None:
    """What is far from the tower would make it small, and does not widen the view."""
    moments = [Moment(60, "pull")] * 6
    near, far = with_robot(episode), with_robot(episode)
    assert far.robot is not None
    far.robot.link_pose[:, 0, 0] -= 5.0
    strips = [film_strip(e, moments, height=200) for e in (episode, near, far)]
    columns, rows = zip(
        *(
            (
                len({round(a.get_position().x0, 6) for a in strip.axes}),
                len({round(a.get_position().y0, 6) for a in strip.axes}),
            )
            for strip in strips
        ),
        strict=True,
    )
    assert columns == (6, 3, 3)
    assert rows == (1, 2, 2)
    wide, narrow = (strip.get_size_inches()[0] for strip in strips[1:])
    assert narrow <= wide


def test_the_moments_of_a_robot_are_the_papers_key_frames(episode: Episode) -> None:
    phases = [
        Phase(k * 8, k * 8 * 32_000_000, name)
        for k, name in enumerate(("turn", "take_stick", "push", "turn_back", "approach", "grasp", "pull", "put_down"))
    ]
    moving = episode.pose.copy()
    moving[:, episode.header.target, 0] += np.clip((np.arange(len(moving)) - 16) * 0.005, 0, 0.02)
    told = telling_moments(replace(with_robot(episode), phases=phases, pose=moving))
    assert [m.name for m in told] == ["stick taken", "pushed", "turned back", "grasped", "pull", "extracted"]
    assert [m.frame for m in told[:4]] == [16, 20, 32, 48]
    verdict = Verdict(Outcome.COLLAPSED, dragged=True, moved=0.3, clear_frame=60)
    fallen = replace(with_robot(episode), phases=phases, pose=moving, result=Result(verdict))
    assert [m.name for m in telling_moments(fallen)] == ["pushed", "turned back", "grasped", "pull", "block out", "end"]
    failed = telling_moments(replace(with_robot(episode), phases=phases[:4], pose=moving))
    assert [m.name for m in failed[:2]] == ["stick taken", "pushed"]
    assert failed[-1].name == "end"


@pytest.mark.parametrize("bearing", [0.0, 1.0, 2.5, np.pi, -2.0, -0.5])
def test_a_robot_does_not_stand_between_the_eye_and_the_tower(moved: Episode, bearing: float) -> None:
    assert moved.robot is not None
    pose = turn_poses(np.array([[-0.5, 0, 0, 1, 0, 0, 0]] * 3), bearing - np.pi)
    robot = replace(moved.robot, link_pose=np.tile(pose, (len(moved.time_ns), 1, 1)))
    azimuth = free_azimuth(replace(moved, robot=robot))
    centre = moved.pose[0, :, :2].mean(axis=0)
    to_robot, to_eye = pose[0, :2] - centre, np.array([np.cos(azimuth), np.sin(azimuth)])
    assert to_robot @ to_eye / np.linalg.norm(to_robot) == pytest.approx(np.cos(np.radians(70)))
    assert np.cos(azimuth - AZIMUTH) > np.cos(np.radians(111))


def test_without_a_robot_the_eye_keeps_its_place(episode: Episode) -> None:
    assert free_azimuth(episode) == AZIMUTH


def test_the_curves_get_a_panel_for_each_of_the_joints_quantities_and_the_turntable(
    moved: Episode, tmp_path: Path
) -> None:
    def height(episode: Episode) -> int:
        episode_curves(episode, [], tmp_path / "c.png")
        return matplotlib.image.imread(tmp_path / "c.png").shape[0]

    plain = height(replace(moved, robot=None, header=replace(moved.header, robot=None)))
    panel = (height(moved) - plain) / 3
    assert panel == pytest.approx(2.1 * 160, abs=1)
    turned = replace(moved, turntable=np.linspace(0, 1, len(moved.time_ns)))
    assert height(turned) - height(moved) == pytest.approx(panel, abs=1)


# --- contacts ------------------------------------------------------------------------------------------------------


def test_what_the_robot_touches_is_touched_where_its_nearest_solid_is(moved: Episode) -> None:
    """The tool's tip pokes 2 mm into the target's -x end; all else of the robot is far away."""
    end = moved.pose[0, TARGET, :3] - np.array([moved.header.blocks.size[TARGET, 0] / 2, 0.0, 0.0])
    tip = end + np.array([0.002, 0.0, 0.0])
    robot = track(len(moved.time_ns))
    robot.link_pose[0, :, :3] = [[9, 9, 9], [8, 8, 8], tip - np.array([0.05, 0, 0])]
    robot.link_pose[0, :, 3:] = [1, 0, 0, 0]
    touching = Contacts(np.array([TARGET]), np.array([ROBOT]), np.array([[3.0, 0.0, 0.0]]))
    for gripper in (moved.gripper, make_episode(frames=120, robot=False).gripper):
        episode = replace(moved, robot=robot, contacts=[touching, *moved.contacts[1:]], gripper=gripper)
        found = contact_points(episode)
        assert found.frame[0] == 0
        np.testing.assert_allclose(found.point[0], (end + tip) / 2, atol=1e-9)


# --- the turntable -------------------------------------------------------------------------------------------------


def test_a_turn_of_the_table_moves_no_block(episode: Episode) -> None:
    """Displacements are those seen from the turntable."""
    angle = np.linspace(0.0, 3.0, len(episode.time_ns))
    turned = replace(episode, pose=turn_poses(episode.pose, angle[:, None]), turntable=angle)
    np.testing.assert_allclose(displacement(turned), displacement(episode), atol=1e-12)
    forgotten = replace(turned, turntable=np.zeros_like(angle))
    assert displacement(forgotten).max() > displacement(episode).max() + 0.01
