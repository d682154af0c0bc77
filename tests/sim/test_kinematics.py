# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

"""Where the arm can take its hand, how, and what it refuses."""

from itertools import pairwise

import numpy as np
import pytest
from robot_stage import ARM, GRIPPER
from test_panda import LIMITS, forward

from jenga_data.errors import UnreachableError
from jenga_data.sim.arm import Kinematics, Path
from jenga_data.sim.robot import STICK_GRIP, STICK_LENGTH, STICK_PLACE, TRAY

X, Z = np.eye(3)[0], np.eye(3)[2]
STICK = STICK_PLACE - (STICK_LENGTH / 2 - STICK_GRIP) * X
"""Where the hand takes the stick."""


@pytest.fixture(scope="module")
def kinematics() -> Kinematics:
    return Kinematics(ARM, GRIPPER)


def hand(joint: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place and axes of the hand in the world, from the maker's parameters: x along the flange's z, y to the left
    finger, and the fingertips' middle 6.5 cm of palm and a finger's length beyond the flange."""
    turn = np.array([[np.cos(ARM.yaw), -np.sin(ARM.yaw), 0], [np.sin(ARM.yaw), np.cos(ARM.yaw), 0], [0, 0, 1]])
    flange = forward(joint)
    left = np.array([np.sqrt(0.5), -np.sqrt(0.5), 0])
    axes = flange[:3, :3] @ np.stack([[0, 0, 1], left, np.cross([0, 0, 1], left)], axis=1)
    reach = 0.065 + GRIPPER.finger_length
    return np.array(ARM.base) + turn @ (flange[:3, 3] + reach * flange[:3, 2]), turn @ axes


def way(*through: np.ndarray | tuple[float, float, float], knot: float = 0.01) -> np.ndarray:
    """Points along straight lines, `knot` [m] apart at most."""
    points = []
    for start, end in pairwise(map(np.array, through)):
        count = int(np.ceil(np.linalg.norm(end - start) / knot))
        points += [start + (k + 1) / count * (end - start) for k in range(count)]
    return np.array(points)


def taken(kinematics: Kinematics, points: np.ndarray) -> Path:
    """From home along points, the velocity at each what the neighbours give."""
    return kinematics.path(kinematics.home, points, np.zeros_like(points))


def margin(joint: np.ndarray) -> float:
    """Of the joint that is nearest to an end of its range [degrees]."""
    return float(np.degrees(np.minimum(joint - LIMITS["lower"], np.array(LIMITS["upper"]) - joint).min()))


# --- reach ---------------------------------------------------------------------------------------------------------


def test_home_is_where_it_is_configured(kinematics):
    place, axes = hand(kinematics.home)
    np.testing.assert_allclose(place, ARM.home, atol=5e-5)
    np.testing.assert_allclose(axes, np.eye(3), atol=5e-4)
    assert margin(kinematics.home) > 20


@pytest.mark.parametrize("x", [-0.34, -0.24, -0.14, -0.045])
def test_the_whole_workspace_is_reached_with_a_level_hand_and_a_margin(kinematics, x):
    """In front of every face, from the lowest level to the top of the highest tower."""
    corners = []
    for k, y in enumerate((-0.03, 0.0, 0.03)):
        corners += [(x, y, z) for z in ((0.0, 0.34) if k % 2 == 0 else (0.34, 0.0))]
    points = way(ARM.home, *corners)
    path = taken(kinematics, points)
    for joint, point in zip(path.joint, points, strict=True):
        place, axes = hand(joint)
        np.testing.assert_allclose(place, point, atol=5e-5)
        np.testing.assert_allclose(axes, np.eye(3), atol=5e-4)
        assert margin(joint) > 20


@pytest.mark.parametrize("place", [STICK, STICK - 0.05 * X, STICK + 0.04 * Z, TRAY - 0.03 * X + 0.01 * Z])
def test_the_holder_and_the_tray_are_reached(kinematics, place):
    path = taken(kinematics, way(ARM.home, place))
    np.testing.assert_allclose(hand(path.joint[-1])[0], place, atol=5e-5)
    assert np.vectorize(margin, signature="(n)->()")(path.joint).min() > 20


# --- paths ---------------------------------------------------------------------------------------------------------


def test_joint_speeds_move_the_hand_as_wanted_and_do_not_turn_it(kinematics):
    points = way(ARM.home, (-0.2, 0.0, 0.1), knot=0.03)
    velocity = np.random.default_rng(0).normal(0, 0.2, points.shape)
    path = kinematics.path(kinematics.home, points, velocity)
    for joint, rate, wanted in zip(path.joint, path.velocity, velocity, strict=True):
        (after, turned), (before, axes) = hand(joint + 1e-5 * rate), hand(joint - 1e-5 * rate)
        np.testing.assert_allclose((after - before) / 2e-5, wanted, atol=1e-3)
        np.testing.assert_allclose((turned - axes) / 2e-5, 0, atol=1e-3)


def test_neighbouring_places_have_neighbouring_postures(kinematics):
    """The elbow does not flip: a millimetre takes no joint further than a hundredth of a radian."""
    path = taken(kinematics, way(ARM.home, (-0.045, 0.0, 0.0), (-0.045, 0.0, 0.34), knot=0.001))
    assert np.abs(np.diff(path.joint, axis=0)).max() < 0.01


# --- refusals ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("place", [(-1.2, 0.0, 0.1), (0.6, 0.0, 0.1), (-0.2, 0.0, 1.2)])
def test_a_place_out_of_reach_is_refused_with_one_line(kinematics, place):
    with pytest.raises(UnreachableError) as refused:
        taken(kinematics, way(ARM.home, place))
    message = str(refused.value)
    assert message.startswith("the arm cannot take the hand to (")
    assert " mm and " in message
    assert message.endswith(" degrees away")
    assert "\n" not in message


def test_a_way_that_is_too_fast_is_refused_with_the_joint_that_cannot(kinematics):
    with pytest.raises(UnreachableError, match=r"^joint [1-7] would move at \d+\.\d\d of its speed limit") as refused:
        taken(kinematics, way(ARM.home, (-0.1, 0.0, 0.1), knot=0.09))
    assert str(refused.value).endswith("m; allowed: at most 1")


def test_a_velocity_that_is_too_high_is_refused_although_the_way_is_short(kinematics):
    points = way(ARM.home, np.array(ARM.home) + 0.001 * X)
    with pytest.raises(UnreachableError, match="of its speed limit"):
        kinematics.path(kinematics.home, points, np.array([[5.0, 0.0, 0.0]]))
