"""The servo keeps its speed, holds what is free, and never exceeds its force."""

from dataclasses import replace

import numpy as np
import pytest

from jenga_data.blocks import sample_blocks
from jenga_data.collect.config import SelectionConfig
from jenga_data.sim.physics import PhysicsConfig
from jenga_data.sim.scene import add_tower, base_spec
from jenga_data.sim.servo import BlockServo
from jenga_data.sim.world import World
from jenga_data.tower import Layout

CONFIG = SelectionConfig()
LIMIT = np.array([CONFIG.force_limit, CONFIG.side_force_limit, CONFIG.side_force_limit])


@pytest.fixture
def world() -> World:
    """One level of three blocks, 20 cm above the table."""
    blocks = sample_blocks("nominal", np.random.default_rng(0), count=3)
    pose = np.zeros((3, 7))
    pose[:, 1], pose[:, 2], pose[:, 3] = [-0.1, 0.0, 0.1], 0.2, 1.0
    spec = base_spec(PhysicsConfig())
    add_tower(spec, blocks, pose, 1, PhysicsConfig())
    return World(spec, blocks, Layout.fresh(np.arange(3)))


def run(world: World, servo: BlockServo, seconds: float) -> np.ndarray:
    poses = []
    for _ in range(round(seconds / world.model.opt.timestep)):
        servo.step()
        poses.append(world.pose[1, :3])
    return np.array(poses)


def test_a_free_block_keeps_the_commanded_speed_and_then_stands_still(world: World) -> None:
    servo = BlockServo(world, 1, CONFIG.gains, LIMIT)
    servo.command(np.array([-0.1, 0.0, 0.0]))
    run(world, servo, 0.2)
    assert world.twist[1, 0] == pytest.approx(-0.1, rel=0.02)
    servo.command(np.zeros(3))
    run(world, servo, 0.2)
    held = run(world, servo, 1.0)
    assert np.ptp(held, axis=0).max() < 1e-4  # gravity included, in 1 s


def test_a_weak_servo_pushes_with_its_limit_and_no_more(world: World) -> None:
    limit = np.full(3, 0.05)  # a quarter of the block's weight
    servo = BlockServo(world, 1, CONFIG.gains, limit)
    servo.command(np.array([0.0, 0.0, 0.3]))
    run(world, servo, 0.1)
    body = world.model.body("block_1").id
    assert world.data.xfrc_applied[body, 2] == pytest.approx(0.05)
    mass = world.blocks.mass[1]
    assert world.twist[1, 2] == pytest.approx((0.05 / mass - 9.81) * 0.1, rel=0.05)


def test_after_letting_go_the_block_falls_freely(world: World) -> None:
    servo = BlockServo(world, 1, CONFIG.gains, LIMIT)
    run(world, servo, 0.1)
    servo.let_go()
    before = world.twist[1, 2]
    run(world, servo, 0.1)
    assert world.twist[1, 2] - before == pytest.approx(-0.981, rel=0.02)


def test_patience_that_is_not_positive_is_refused() -> None:
    from jenga_data.errors import JengaError

    with pytest.raises(JengaError, match="patience must be positive"):
        replace(CONFIG, patience=0.0)


def test_no_axis_exceeds_its_limit_and_no_torque_or_other_block_is_touched(world: World) -> None:
    servo = BlockServo(world, 1, CONFIG.gains, LIMIT)
    servo.command(np.array([-5.0, 5.0, 5.0]))
    body = world.model.body("block_1").id
    largest = np.zeros(3)
    for _ in range(60):
        servo.step()
        largest = np.maximum(largest, np.abs(world.data.xfrc_applied[body, :3]))
    np.testing.assert_array_equal(largest, LIMIT)
    assert not world.data.xfrc_applied[body, 3:].any()
    assert not np.delete(world.data.xfrc_applied, body, axis=0).any()


def test_time_at_the_limit_is_not_made_up_for_later(world: World) -> None:
    """The integral stops at the cap, or the block would be pulled on for long after it may stop."""
    servo = BlockServo(world, 1, CONFIG.gains, np.array([0.01, 0.5, 0.5]))
    body = world.model.body("block_1").id
    servo.command(np.array([-0.3, 0.0, 0.0]))
    run(world, servo, 0.1)
    assert world.data.xfrc_applied[body, 0] == pytest.approx(-0.01)
    servo.command(world.twist[1, :3] + [0.05, 0, 0])
    run(world, servo, 0.004)
    assert world.data.xfrc_applied[body, 0] > 0
