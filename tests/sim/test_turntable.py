# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Iterator
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from short_tower import PHYSICS, SELECTION, short_tower, short_towers, world_of
from test_recording import Kept

from jenga_data.blocks import GRAVITY
from jenga_data.calibrate.turntable import turn_case
from jenga_data.collect.recording import Recording
from jenga_data.episode import TABLE
from jenga_data.geometry import rotation_matrices
from jenga_data.scenery import TURNTABLE_RADIUS
from jenga_data.sim.gripper import Gripper
from jenga_data.sim.physics import GripperConfig
from jenga_data.sim.servo import BlockServo
from jenga_data.sim.turntable import TURN_SECONDS, MinimumJerk, Turntable, whole_frames
from jenga_data.sim.world import World
from jenga_data.tower import turn_poses

HALF_TURN = MinimumJerk(np.pi, TURN_SECONDS)
STEP = PHYSICS.timestep_ns * 1e-9
PULL_TORQUE = 0.1
"""What the pull of an outer block exerts about the axis, the capped 3 N at 2.5 to 4 cm [N m]."""


def put_to_sleep(world: World) -> World:
    world.step(150)
    world.allow_sleep(True)
    while not world.asleep:
        world.step(16)
        assert world.time_ns < 3e9
    return world


def asleep(hand_before: int = -1) -> World:
    return put_to_sleep(world_of(short_tower(), hand_before))


def to_the_end(motion: Iterator[None]) -> None:
    for _ in motion:
        pass


def on_table(world: World, table: float) -> tuple[np.ndarray, np.ndarray]:
    """Places and orientations of the blocks as the table sees them, turned by `table`."""
    back = Rotation.from_rotvec([0, 0, -table]).as_matrix()
    return world.pose[:, :3] @ back.T, back @ rotation_matrices(world.pose[:, 3:])


def farthest(pose: np.ndarray, other: np.ndarray) -> float:
    return float(np.linalg.norm(pose[:, :3] - other[:, :3], axis=1).max())


# --- the profile ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("profile", [HALF_TURN, MinimumJerk(-0.3, 0.7)])
def test_a_profile_starts_and_ends_at_rest_at_its_exact_angle(profile):
    assert profile.at(0.0) == profile.at(-1.0) == (0, 0, 0)
    assert profile.at(profile.seconds) == profile.at(profile.seconds + 1) == (profile.angle, 0, 0)


@pytest.mark.parametrize("profile", [HALF_TURN, MinimumJerk(-0.3, 0.7)])
def test_rate_and_acceleration_are_the_derivatives_of_the_angle(profile):
    time = np.linspace(0, profile.seconds, 4001)
    angle, rate, acceleration = np.array([profile.at(t) for t in time]).T
    step = time[1]
    np.testing.assert_allclose((angle[2:] - angle[:-2]) / (2 * step), rate[1:-1], atol=1e-5)
    np.testing.assert_allclose((rate[2:] - rate[:-2]) / (2 * step), acceleration[1:-1], atol=1e-4)
    assert (np.diff(angle) * np.sign(profile.angle) >= 0).all()
    assert np.abs(rate).max() == pytest.approx(1.875 * abs(profile.angle) / profile.seconds, rel=1e-5)
    assert np.abs(acceleration).max() == pytest.approx(5.7735 * abs(profile.angle) / profile.seconds**2, rel=1e-4)


@pytest.mark.parametrize(("angle", "seconds"), [(np.pi, 0.0), (np.pi, -1.0), (np.nan, 4.0), (np.inf, 4.0), (1, np.inf)])
def test_a_profile_that_cannot_be_is_refused(angle, seconds):
    with pytest.raises(ValueError, match="allowed: finite, and more than 0 s"):
        MinimumJerk(angle, seconds)


# --- turning -------------------------------------------------------------------------------------------------------


def test_half_a_turn_takes_4_seconds_and_ends_at_rest_at_the_exact_angle():
    world = asleep()
    turntable, start, began = Turntable(world), world.pose, world.time_ns
    angle, held = turntable.angle, turntable.set_point
    to_the_end(turntable.turn(np.pi))
    assert world.time_ns - began == TURN_SECONDS * 1e9
    assert turntable.angle == pytest.approx(angle + np.pi, abs=1e-15)
    assert turntable.set_point == pytest.approx(held + np.pi, abs=1e-15)
    assert not world.data.qvel.any()
    np.testing.assert_array_equal(world.pose, turn_poses(start, np.pi))


def test_no_block_moves_against_the_table_at_any_step():
    world = asleep()
    turntable = Turntable(world)
    zero = turntable.angle
    place, orientation = on_table(world, 0.0)
    angles = []
    for _ in turntable.turn(-2.0, 0.5):
        assert world.asleep
        place_now, orientation_now = on_table(world, turntable.angle - zero)
        np.testing.assert_allclose(place_now, place, atol=1e-12)
        np.testing.assert_allclose(orientation_now, orientation, atol=1e-12)
        angles.append(turntable.angle - zero)
    frames, steps = whole_frames(0.5), PHYSICS.steps_a_frame
    assert len(angles) == frames * steps
    profile = MinimumJerk(-2.0, frames * 0.032)
    # What sleeps is moved once a control step, at its end.
    expected = [profile.at(k // steps * 0.032)[0] for k in range(1, len(angles) + 1)]
    np.testing.assert_allclose(angles, expected, atol=1e-12)


def test_half_a_turn_after_the_other_is_none():
    world = asleep()
    turntable, start = Turntable(world), world.pose
    for _ in range(2):
        to_the_end(turntable.turn(np.pi, 0.5))
    np.testing.assert_allclose(world.pose, start, atol=1e-14)
    assert turntable.set_point == pytest.approx(2 * np.pi)


def test_a_turned_tower_sleeps_on_and_is_where_mujoco_takes_it_to_be():
    world = asleep()
    to_the_end(Turntable(world).turn(1.0, 0.5))
    end = world.pose
    world.step(50)
    assert world.asleep
    np.testing.assert_array_equal(world.pose, end)
    fresh = mujoco.MjData(world.model)
    fresh.qpos[:] = world.data.qpos
    mujoco.mj_forward(world.model, fresh)
    for name in ("xpos", "xmat", "geom_xpos", "geom_xmat", "xipos", "xaxis", "subtree_com", "cinert", "cdof"):
        np.testing.assert_allclose(getattr(world.data, name), getattr(fresh, name), atol=1e-15, err_msg=name)


def test_a_turned_tower_that_wakes_creeps_as_one_that_was_not_turned():
    turned, other = asleep(), asleep()
    to_the_end(Turntable(turned).turn(np.pi, 0.5))
    for world in (turned, other):
        before = world.pose
        world.allow_sleep(False)
        world.step(150)
        assert not world.asleep
        assert farthest(world.pose, before) < 5e-5
    assert Turntable(turned).angle == pytest.approx(np.pi, abs=1e-6)


def test_what_is_awake_moves_on_while_the_table_turns():
    world = asleep(hand_before=1)
    hand = Gripper(world, GripperConfig())
    motion = Turntable(world).turn(0.1, 0.32)
    start = hand.position
    for _ in range(whole_frames(0.32)):
        hand.begin(np.array([0.0, 0.0, 0.005]))
        for i in range(PHYSICS.steps_a_frame):
            hand.drive(i / PHYSICS.steps_a_frame)
            next(motion)
    np.testing.assert_allclose(hand.position - start, [0, 0, 0.05], atol=1e-3)
    assert world.asleep


def way_to_a_touch(angle: float) -> float:
    """How far a hand goes towards +x until a tower that was turned wakes [m]."""
    world = asleep(hand_before=1)
    to_the_end(Turntable(world).turn(angle, 0.5))
    hand = Gripper(world, GripperConfig())
    start, steps = hand.position[0], PHYSICS.steps_a_frame
    while world.asleep:
        assert hand.position[0] - start < 0.06
        hand.begin(np.array([0.002, 0.0, 0.0]))
        for i in range(steps):
            hand.drive(i / steps)
            world.step()
    return float(hand.position[0] - start)


def test_a_hand_meets_a_turned_tower_where_it_is_now_and_wakes_it():
    """Seen along x a square that is turned by 20 degrees reaches out 9 mm farther, at one side or the other."""
    straight = way_to_a_touch(0.0)
    assert 0.02 < straight < 0.055
    assert min(way_to_a_touch(0.35), way_to_a_touch(-0.35)) < straight - 0.004


def solved_exactly(world: World) -> World:
    """Forces that do not depend on where the solver began; as it is set up they do in the sixth digit."""
    world.model.opt.tolerance = 1e-14
    return world


# --- what is logged ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def logged() -> tuple[World, Kept]:
    """Half a turn in 4 s as a log holds it; the world at its end."""
    world, kept = put_to_sleep(solved_exactly(world_of(short_tower()))), Kept()
    recording = Recording(world, kept, 0)
    motion = Turntable(world).turn(np.pi)
    for _ in range(whole_frames(TURN_SECONDS)):
        recording.advance(lambda _: next(motion), PHYSICS.steps_a_frame)
    with pytest.raises(StopIteration):
        next(motion)
    return world, kept


def test_logged_twists_are_the_differences_of_logged_poses(logged):
    _, kept = logged
    pose, twist = (np.array([getattr(f, name) for f in kept.frames]) for name in ("pose", "twist"))
    seconds = np.array([f.time_ns for f in kept.frames]) * 1e-9
    period = np.diff(seconds)
    np.testing.assert_allclose(period, 0.032)
    # A central difference is wrong by a sixth of the third derivative times the period squared.
    wrong = 0.032**2 / 6 * 60 * np.pi / TURN_SECONDS**3
    speed = (pose[2:, :, :3] - pose[:-2, :, :3]) / 0.064
    np.testing.assert_allclose(twist[1:-1, :, :3], speed, atol=2 * wrong * TURNTABLE_RADIUS)
    for block in range(pose.shape[1]):
        now, then = (Rotation.from_quat(q[:, block][:, [4, 5, 6, 3]]) for q in (pose[2:], pose[:-2]))
        np.testing.assert_allclose(twist[1:-1, block, 3:], (now * then.inv()).as_rotvec() / 0.064, atol=1.1 * wrong)
    assert not twist[0].any()
    assert not twist[-1].any()
    assert np.abs(twist[..., 5]).max() == pytest.approx(1.875 * np.pi / TURN_SECONDS, rel=1e-3)


@pytest.mark.parametrize("index", [0, 26, 62, 99, 125])
def test_logged_contacts_are_those_of_a_tower_that_stands_at_that_angle(logged, index):
    """They are computed once, when the tower falls asleep, and turned with it: here anew in a world at that angle.

    What the turn's acceleration needs is not in them, as in `friction_needed`: a thousandth of the weight.
    """
    world, kept = logged
    contacts = kept.frames[index].contacts
    anew = solved_exactly(world_of(short_tower()))
    drive = anew.data.actuator("turntable")
    drive.ctrl[0] = anew.data.joint("turntable").qpos[0] = HALF_TURN.at(index * 0.032)[0]
    anew.set_tower(kept.frames[index].pose)
    expected = anew.contacts()
    np.testing.assert_array_equal(contacts.first, expected.first)
    np.testing.assert_array_equal(contacts.second, expected.second)
    np.testing.assert_allclose(contacts.force, expected.force, atol=1e-6)
    weight = world.blocks.mass.sum() * GRAVITY
    assert contacts.force[contacts.second == TABLE, 2].sum() == pytest.approx(weight, rel=0.01)


def test_logged_contacts_turn_with_the_tower(logged):
    _, kept = logged
    first, quarter, last = (kept.frames[k].contacts.force for k in (0, 63, 125))
    assert np.abs(first[:, :2]).max() > 0.01
    np.testing.assert_allclose(last, first * [-1, -1, 1], atol=1e-6)
    angle = HALF_TURN.at(63 * 0.032)[0]
    turned = Rotation.from_rotvec([0, 0, angle]).apply(first)
    np.testing.assert_allclose(quarter, turned, atol=1e-6)


def test_the_drive_of_a_logged_state_accelerates_as_the_profile_does(logged):
    """Its set point is ahead by the drive's lag, so that the state goes on as it went."""
    _, kept = logged
    for index in (26, 62, 99):
        again = world_of(short_tower())
        again.restore(kept.frames[index].sim_state)
        acceleration = again.data.joint("turntable").qacc[0]
        assert acceleration == pytest.approx(HALF_TURN.at(index * 0.032)[2], abs=0.01)
        again.step()
        assert Turntable(again).angle == pytest.approx(HALF_TURN.at(index * 0.032 + STEP)[0], abs=1e-5)


# --- what is refused -----------------------------------------------------------------------------------------------


def test_a_tower_that_is_awake_is_not_turned():
    with pytest.raises(ValueError, match=r"blocks \[0, 1, 2, .*, 11\] are awake; allowed: a tower that sleeps"):
        Turntable(world_of(short_tower())).turn(np.pi)


def test_a_block_that_lies_beside_the_turntable_is_named():
    world = world_of(short_tower())
    pose, apart = world.pose, world.layout.grid[-1, 2]
    pose[apart, :3] = [0.0, 0.3, 0.0]
    world.set_tower(pose)
    put_to_sleep(world)
    with pytest.raises(ValueError, match=rf"blocks \[{apart}\] lie beside the turntable"):
        Turntable(world).turn(np.pi)


def test_a_touch_while_the_table_turns_is_told():
    world = asleep()
    motion = Turntable(world).turn(np.pi)
    for _ in range(100):
        next(motion)
    world.data.xfrc_applied[world.model.body("block_5").id, 2] = 0.1
    with pytest.raises(ValueError, match="were woken while the table turned"):
        to_the_end(motion)


# --- the drive -----------------------------------------------------------------------------------------------------


def test_a_pull_hardly_turns_the_table():
    world = world_of(short_tower())
    world.step(50)
    target = int(world.layout.grid[1, 2])
    servo = BlockServo(world, target, (4.0, 400.0), np.array([0.5, 3.0, 0.5]))
    servo.command(np.array([0.0, -0.1, 0.0]))  # an outer block of level 1, which lies along y
    turntable, most = Turntable(world), 0.0
    for _ in range(150):
        servo.step()
        most = max(most, abs(turntable.angle))
    assert 1e-7 < most < 1e-4


def test_the_drive_gives_way_by_torque_over_stiffness_and_comes_back():
    world = world_of(short_tower())
    world.data.joint("turntable").qfrc_applied[0] = PULL_TORQUE
    world.step(250)
    bent = Turntable(world).angle
    assert 0.5e-5 < bent < 1e-4
    world.data.joint("turntable").qfrc_applied[0] = 0.0
    world.step(250)
    assert abs(Turntable(world).angle) < bent / 100


# --- the calibration -----------------------------------------------------------------------------------------------


def test_a_case_turns_a_tower_of_the_last_round():
    config = replace(SELECTION, spawn=replace(SELECTION.spawn, last_round=2))
    with short_towers():
        result, again = (turn_case(config, 3) for _ in range(2))
    assert result == again
    assert result["round"] == 2
    assert not result["fell"]
    assert 0 < result["displaced_mm"] < 1e-9
    assert result["after_mm"] < 0.1
    assert result["unturned_mm"] < 0.1
    assert 0.002 < result["friction"] < 0.05
