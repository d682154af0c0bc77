from dataclasses import replace

import numpy as np
import pytest
from short_tower import PHYSICS, short_tower, world_of

from jenga_data.collect.spawn import GrownTower, shifted
from jenga_data.episode import LEFT_FINGER, RIGHT_FINGER
from jenga_data.sim.gripper import Gripper
from jenga_data.sim.physics import GripperConfig
from jenga_data.sim.set_point import PERIOD
from jenga_data.sim.world import World

CONFIG = GripperConfig()
STEPS = 16
ACTIONS = np.array([[-0.004, 0.001, 0.0], [-0.010, -0.001, 0.001], [0.003, 0.0, -0.001], [0.0, 0.0, 0.0]])


def hand(config: GripperConfig = CONFIG) -> tuple[World, Gripper]:
    """In front of the middle block of the lowest level, with nothing to touch."""
    tower = short_tower(1)
    world = world_of(tower, hand_before=int(tower.layout.grid[0, 1]))
    return world, Gripper(world, config)


def commands(gripper: Gripper, world: World, actions: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """What is sent to the slides at each part of each period (action, part, xyz)."""
    sent = np.empty((len(actions), len(parts), 3))
    slides = [world.model.actuator(f"hand_{axis}").id for axis in "xyz"]
    for i, action in enumerate(actions):
        gripper.begin(action)
        for k, part in enumerate(parts):
            gripper.drive(float(part))
            sent[i, k] = world.data.ctrl[slides]
    return sent


def run(gripper: Gripper, world: World, actions: np.ndarray) -> None:
    for action in actions:
        gripper.begin(action)
        for i in range(STEPS):
            gripper.drive(i / STEPS)
            world.step()


@pytest.fixture(scope="module")
def grasp() -> tuple[World, Gripper, int]:
    """A hand around the end of a block that sticks out by 2 cm, its fingers closed."""
    tower = short_tower(2)
    target = int(tower.layout.grid[0, 1])
    out: GrownTower | None = shifted(tower, target, -0.02, PHYSICS.contact_law)
    assert out is not None
    world = world_of(out, hand_before=target)
    gripper = Gripper(world, CONFIG)
    run(gripper, world, np.tile([0.04 / 5, 0, 0], (5, 1)))
    for part in np.linspace(0, 1, 8):
        gripper.close(float(part))
        run(gripper, world, np.zeros((1, 3)))
    return world, gripper, target


# --- set points ----------------------------------------------------------------------------------------------------


def test_set_points_end_where_they_are_commanded_to():
    world, gripper = hand()
    ends = commands(gripper, world, np.concatenate([ACTIONS, np.zeros((1, 3))]), np.array([1.0]))[:, 0]
    np.testing.assert_allclose(ends[-1], ACTIONS.sum(axis=0), atol=1e-12)


def test_set_points_and_their_velocities_are_continuous():
    """Without damping to feed forward, what is sent is the set point itself."""
    world, gripper = hand(replace(CONFIG, mass=1e-18))
    parts = np.linspace(0, 1, 2001)
    sent = commands(gripper, world, ACTIONS, parts)
    np.testing.assert_allclose(sent[1:, 0], sent[:-1, -1], atol=1e-12)
    speed = np.diff(sent, axis=1) * 2000 / PERIOD
    np.testing.assert_allclose(speed[1:, 0], speed[:-1, -1], atol=2e-3)
    np.testing.assert_allclose(speed[0, 0], 0, atol=2e-3)
    np.testing.assert_allclose(speed[:, -1], ACTIONS / PERIOD, atol=2e-3)
    np.testing.assert_allclose(sent[:, -1], np.cumsum(ACTIONS, axis=0), atol=1e-12)


def test_the_velocity_is_fed_forward():
    """The slides' force is k (command - x) - c v: a lead of c / k times the velocity takes the lag away."""
    parts = np.linspace(0, 1, 2001)
    hands = [hand(config) for config in (replace(CONFIG, mass=1e-18), CONFIG)]
    bare, full = (commands(gripper, world, ACTIONS, parts) for world, gripper in hands)
    speed = np.gradient(bare, PERIOD / 2000, axis=1)[:, 1:-1]
    lead = 2 * np.sqrt(CONFIG.mass / CONFIG.stiffness)
    np.testing.assert_allclose((full - bare)[:, 1:-1], lead * speed, atol=1e-6)


def test_the_hand_goes_where_it_is_sent():
    world, gripper = hand()
    start = gripper.position
    run(gripper, world, ACTIONS)
    np.testing.assert_allclose(gripper.position - start, ACTIONS.sum(axis=0), atol=2e-4)
    run(gripper, world, np.zeros((4, 3)))
    np.testing.assert_allclose(gripper.position - start, ACTIONS.sum(axis=0), atol=2e-5)


def test_a_steady_hand_does_not_lag():
    world, gripper = hand()
    start = gripper.position
    for periods in range(1, 9):
        run(gripper, world, np.array([[-0.008, 0, 0]]))
        if periods > 3:
            np.testing.assert_allclose(gripper.position - start, [-0.008 * periods, 0, 0], atol=5e-5)


# --- fingers -------------------------------------------------------------------------------------------------------


def test_an_open_hand_is_as_wide_as_it_opens_and_feels_nothing():
    world, gripper = hand()
    run(gripper, world, np.zeros((3, 3)))
    sample = gripper.sample(0)
    assert gripper.width == pytest.approx(CONFIG.opening, abs=5e-4)
    assert sample.width == gripper.width
    assert not sample.left_force.any()
    assert not sample.right_force.any()
    np.testing.assert_array_equal(sample.pose, [*gripper.position, 1, 0, 0, 0])


def test_closed_fingers_are_a_block_apart_and_feel_the_grip(grasp):
    """The block pushes the left finger, which is at +y, in +y, and the right one in -y."""
    world, gripper, target = grasp
    sample = gripper.sample(7)
    assert sample.time_ns == 7
    assert gripper.width == pytest.approx(world.blocks.size[target, 1], abs=1e-3)
    assert sample.left_force[1] == pytest.approx(CONFIG.grip_force, rel=0.05)
    assert sample.right_force[1] == pytest.approx(-CONFIG.grip_force, rel=0.05)
    # Both act on a block at rest: what they push along x and y cancels, but for the friction of the tower.
    assert np.abs((sample.left_force + sample.right_force)[:2]).max() < 2


def test_fingers_feel_what_contacts_say_of_them(grasp):
    """The contacts' forces are those on the block; the gripper's frame has the world's axes."""
    world, gripper, _ = grasp
    contacts, sample = world.contacts(), gripper.sample(0)
    for finger, force in ((LEFT_FINGER, sample.left_force), (RIGHT_FINGER, sample.right_force)):
        on_block = contacts.force[contacts.second == finger].sum(axis=0)
        assert np.linalg.norm(on_block) > 10
        np.testing.assert_allclose(force, -on_block, atol=1e-9)


def test_fingers_stay_as_far_from_the_middle_as_each_other(grasp):
    """Pushed at from one side, they do not slide along: the hand carries the block sideways."""
    world, gripper, _ = grasp
    run(gripper, world, np.array([[0, 0.0005, 0]] * 2 + [[0, 0, 0]]))
    fingers = [world.data.joint(f"{side}_finger").qpos[0] for side in ("left", "right")]
    np.testing.assert_allclose(fingers[0], fingers[1], atol=5e-5)
    run(gripper, world, np.array([[0, -0.0005, 0]] * 2 + [[0, 0, 0]]))


def test_a_block_goes_with_the_hand_that_holds_it_and_stays_when_let_go(grasp):
    world, gripper, target = grasp
    before, hand_before = world.pose[target, :3], gripper.position
    run(gripper, world, np.array([[-0.004, 0, 0]] * 4 + [[0, 0, 0]] * 2))
    moved = world.pose[target, :3] - before
    np.testing.assert_allclose(moved[0], -0.016, atol=5e-4)
    np.testing.assert_allclose(moved, gripper.position - hand_before, atol=5e-4)
    gripper.release()
    run(gripper, world, np.zeros((20, 3)))
    left = world.pose[target, :3]
    assert gripper.width > world.blocks.size[target, 1] + 0.002
    run(gripper, world, np.array([[-0.004, 0, 0]] * 3))
    np.testing.assert_allclose(world.pose[target, :2], left[:2], atol=5e-4)


def test_fingers_that_close_on_nothing_meet():
    """Also when they are thrown together with all their force at once."""
    world, gripper = hand()
    gripper.close()
    run(gripper, world, np.zeros((12, 3)))
    assert gripper.width == pytest.approx(0.0, abs=0.002)


def test_a_part_of_the_grip_presses_in_part():
    world, gripper = hand()
    fingers = [world.model.actuator(f"{side}_finger").id for side in ("left", "right")]
    for part in (0.25, 1.0):
        gripper.close(part)
        np.testing.assert_allclose(world.data.ctrl[fingers], part * CONFIG.grip_force)
    gripper.release()
    assert (world.data.ctrl[fingers] < 0).all()
