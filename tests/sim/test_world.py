# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from short_tower import PHYSICS, SPAWN, short_tower, world_of

from jenga_data.blocks import GRAVITY, sample_blocks
from jenga_data.episode import TABLE, Contacts
from jenga_data.sim.scene import add_tower, base_spec
from jenga_data.sim.servo import BlockServo
from jenga_data.sim.world import World
from jenga_data.tower import Layout

TARGET_LEVEL = 1


def pulled() -> tuple[World, BlockServo]:
    """A tower in which a block is being pulled."""
    world = world_of(short_tower())
    world.step(50)
    target = int(world.layout.grid[TARGET_LEVEL, 1])
    servo = BlockServo(world, target, (4.0, 400.0), np.array([3.0, 0.5, 0.5]))
    servo.command(np.array([0.0, -0.1, 0.0]))  # blocks of level 1 lie along y
    return world, servo


@pytest.fixture(scope="module")
def resting() -> World:
    """A tower that has come to rest, awake. Read only."""
    world = world_of(short_tower())
    world.step(150)
    return world


def asleep() -> World:
    world = world_of(short_tower())
    world.step(150)
    world.allow_sleep(True)
    for _ in range(40):
        world.step(16)
        if world.asleep:
            return world
    raise AssertionError("the tower does not fall asleep")


def force_on(contacts: Contacts, blocks: int) -> np.ndarray:
    total = np.zeros((blocks, 3))
    np.add.at(total, contacts.first, contacts.force)
    between = contacts.second >= 0
    np.add.at(total, contacts.second[between], -contacts.force[between])
    return total


# --- going back ----------------------------------------------------------------------------------------------------


def test_restoring_any_state_repeats_the_same_bytes():
    """At rest, when the pull begins, and in the middle of it; in the same world and in another one."""
    world, servo = pulled()
    states, forces = [world.integration_state()], []
    for _ in range(20):
        servo.step()
        forces.append(world.data.xfrc_applied.copy())
        states.append(world.integration_state())
    assert np.abs(states[-1] - states[0]).max() > 1e-3
    for again in (world, world_of(short_tower())):
        for start in (13, 0, 7):
            again.restore(states[start])
            assert again.integration_state().tobytes() == states[start].tobytes()
            for force, state in zip(forces[start:], states[start + 1 :], strict=True):
                again.data.xfrc_applied[:] = force
                again.step()
                assert again.integration_state().tobytes() == state.tobytes()


def test_a_restored_state_has_its_poses_contacts_and_time():
    world, servo = pulled()
    pose, time_ns, state = world.pose, world.time_ns, world.integration_state()
    world.step()
    contacts = world.contacts()  # a step computes the forces at its beginning
    for _ in range(20):
        servo.step()
    world.restore(state)
    np.testing.assert_array_equal(world.pose, pose)
    assert world.time_ns == time_ns
    restored = world.contacts()
    np.testing.assert_array_equal(restored.first, contacts.first)
    np.testing.assert_array_equal(restored.second, contacts.second)
    np.testing.assert_allclose(restored.force, contacts.force, atol=1e-12)


# --- what is handed out --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "read",
    [
        lambda world: world.pose,
        lambda world: world.twist,
        lambda world: world.integration_state(),
        lambda world: world.contacts().force,
        lambda world: world.tower_state().pose,
    ],
    ids=["pose", "twist", "integration_state", "contacts", "tower_state"],
)
def test_what_is_handed_out_is_the_callers_own(read: Callable[[World], np.ndarray]):
    world, servo = pulled()
    handed_out = read(world)
    kept = handed_out.copy()
    for _ in range(5):
        servo.step()
    np.testing.assert_array_equal(handed_out, kept)
    assert not np.array_equal(read(world), kept)
    now = world.integration_state()
    read(world)[:] = 7.0
    np.testing.assert_array_equal(world.integration_state(), now)


def test_contacts_of_a_sleeping_tower_are_the_callers_own():
    world = asleep()
    world.contacts().force[:] = 7.0
    assert world.contacts().force.max() < 7.0


# --- motion --------------------------------------------------------------------------------------------------------


def test_twist_is_the_change_of_the_pose_in_the_world():
    """Both parts, of blocks that fly and tumble: a step turns a block by its angular velocity after the step."""
    rng = np.random.default_rng(0)
    blocks, layout = sample_blocks("measured", rng, 6), Layout.fresh(np.arange(6))
    x, y, z, w = Rotation.random(6, rng).as_quat().T
    pose = np.column_stack([np.arange(6) * 0.2, np.zeros(6), np.ones(6), w, x, y, z])
    spec = base_spec(PHYSICS)
    add_tower(spec, blocks, pose, -1, PHYSICS)
    world = World(spec, blocks, layout)
    world.data.qvel[:] = rng.normal(0, 3, world.model.nv)
    for _ in range(20):
        before = world.pose
        world.step()
        after, seconds = world.pose, world.model.opt.timestep
        turn = Rotation.from_quat(after[:, [4, 5, 6, 3]]) * Rotation.from_quat(before[:, [4, 5, 6, 3]]).inv()
        np.testing.assert_allclose(world.twist[:, :3], (after[:, :3] - before[:, :3]) / seconds, atol=1e-9)
        np.testing.assert_allclose(world.twist[:, 3:], turn.as_rotvec() / seconds, atol=1e-9)
    assert np.linalg.norm(world.twist[:, 3:], axis=1).min() > 1


def test_time_is_a_whole_number_of_steps_although_seconds_do_not_add_up():
    world = world_of(short_tower(1))
    for steps in range(1, 1500):
        world.step()
        assert world.time_ns == steps * PHYSICS.timestep_ns


def test_a_tower_is_put_somewhere_at_rest():
    world, servo = pulled()
    for _ in range(20):
        servo.step()
    pose = world.pose + np.array([0.01, 0, 0, 0, 0, 0, 0])
    world.set_tower(pose)
    np.testing.assert_array_equal(world.pose, pose)
    assert not world.twist.any()
    np.testing.assert_allclose(world.data.xpos[-len(pose) :], pose[:, :3], atol=1e-12)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_turned_tower_stands_as_it_stood(resting, turns):
    world = world_of(short_tower())
    turned = resting.tower_state().turned(turns).pose
    world.set_tower(turned)
    world.step(125)
    assert np.linalg.norm(world.pose[:, :3] - turned[:, :3], axis=1).max() < 1e-4


# --- contacts ------------------------------------------------------------------------------------------------------


def test_contact_forces_carry_each_block_of_a_tower_at_rest():
    """Newton's third law holds, or the sum over the two ends of each pair would not balance every block.

    A loose block rattles by some micrometres, so that each moment is a few mN off; over a fifth of a second that
    comes to nothing.
    """
    world = world_of(short_tower())
    world.step(150)
    weight = world.blocks.mass * GRAVITY
    total, table, steps = np.zeros((len(weight), 3)), np.zeros(3), 100
    for _ in range(steps):
        world.step()
        contacts = world.contacts()
        on_table = contacts.second == TABLE
        np.testing.assert_array_equal(np.unique(world.layout.level[contacts.first[on_table]]), [0])
        total += force_on(contacts, len(weight)) / steps
        table += contacts.force[on_table].sum(axis=0) / steps
    np.testing.assert_allclose(total, np.column_stack([0 * weight, 0 * weight, weight]), atol=0.0005)
    np.testing.assert_allclose(table, [0, 0, weight.sum()], atol=0.001)


def test_contact_forces_are_those_of_mujoco_also_while_blocks_move():
    world, servo = pulled()
    for _ in range(60):
        servo.step()
    expected = np.zeros((len(world.blocks), 3))
    local = np.zeros(6)
    for i, contact in enumerate(world.data.contact):
        mujoco.mj_contactForce(world.model, world.data, i, local)
        in_world = contact.frame.reshape(3, 3).T @ local[:3]  # of the first geom on the second
        for geom, sign in zip(contact.geom, (-1, 1), strict=True):
            name = world.model.geom(geom).name
            if name.startswith("block_"):
                expected[int(name.removeprefix("block_"))] += sign * in_world
    assert np.abs(expected[:, :2]).max() > 0.02
    np.testing.assert_allclose(force_on(world.contacts(), len(world.blocks)), expected, atol=1e-12)


def test_each_pair_comes_once_the_block_first():
    world, servo = pulled()
    servo.step()
    contacts = world.contacts()
    pairs = list(zip(contacts.first.tolist(), contacts.second.tolist(), strict=True))
    assert len(set(pairs)) == len(pairs)
    assert (contacts.first > contacts.second).all()
    assert contacts.first.min() >= 0


def test_blocks_in_the_air_touch_nothing():
    world = world_of(short_tower())
    world.set_tower(world.pose + np.array([0, 0, 0.1, 0, 0, 0, 0]) * np.arange(1, 13)[:, None])
    contacts = world.contacts()
    assert len(contacts.first) == len(contacts.second) == len(contacts.force) == 0


def test_a_tower_that_sleeps_while_a_block_beside_it_moves_keeps_its_contacts():
    world = world_of(short_tower())
    apart = world.layout.grid[-1, 2]
    pose = world.pose
    pose[apart, :3] = [0.0, 0.3, world.blocks.size[apart, 2] / 2]
    world.set_tower(pose)
    world.step(150)
    world.allow_sleep(True)
    while not world.asleep:
        world.step(16)
        assert world.time_ns < 5e9
    every = world.contacts()
    world.data.xfrc_applied[world.model.body(f"block_{apart}").id, 2] = 1.0
    world.step(20)
    assert not world.asleep
    assert world.twist[apart, 2] > 0.1
    moving = world.contacts()
    in_tower = every.first != apart
    np.testing.assert_array_equal(moving.first, every.first[in_tower])
    np.testing.assert_array_equal(moving.second, every.second[in_tower])
    np.testing.assert_array_equal(moving.force, every.force[in_tower])


def test_a_sleeping_tower_has_the_contacts_that_it_had_awake():
    world = world_of(short_tower())
    world.step(150)
    before = world.contacts()
    world = asleep()
    contacts = world.contacts()
    assert world.asleep
    weight = world.blocks.mass * GRAVITY
    np.testing.assert_allclose(force_on(contacts, 12)[:, 2], weight, atol=0.005)
    assert set(zip(contacts.first, contacts.second, strict=True)) >= {
        pair
        for pair, force in zip(zip(before.first, before.second, strict=True), before.force, strict=True)
        if force[2] > 0.05
    }
    np.testing.assert_array_equal(world.contacts().force, contacts.force)


# --- sleep ---------------------------------------------------------------------------------------------------------


def test_a_sleeping_tower_keeps_still_and_asking_for_its_contacts_does_not_wake_it():
    world = asleep()
    before = world.pose
    world.contacts()
    world.step(100)
    np.testing.assert_array_equal(world.pose, before)
    assert world.asleep


def test_a_touch_wakes_the_tower_and_so_does_forbidding_sleep():
    touched, forbidden = asleep(), asleep()
    touched.data.xfrc_applied[touched.model.body("block_5").id, 2] = 1.0
    touched.step(2)
    assert not touched.asleep
    forbidden.allow_sleep(False)
    forbidden.contacts()
    forbidden.step(2)
    assert not forbidden.asleep


def test_a_tower_does_not_sleep_unless_it_may():
    world = world_of(short_tower())
    world.step(round(SPAWN.stand * 1e9 / PHYSICS.timestep_ns))
    assert not world.asleep
