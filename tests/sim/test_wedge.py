"""Blocks that are higher at one end: drawn, carried, simulated, logged."""

from dataclasses import replace

import numpy as np
import pytest

from jenga_data.blocks import GRAVITY, Blocks, sample_blocks
from jenga_data.collect.config import SpawnConfig
from jenga_data.collect.spawn import grow_tower
from jenga_data.geometry import rotation_matrices
from jenga_data.sim.physics import PhysicsConfig
from jenga_data.sim.scene import add_tower, base_spec
from jenga_data.sim.world import World
from jenga_data.statics import PlanarPose, solve
from jenga_data.tower import Layout

PHYSICS = PhysicsConfig()


def wedges(*wedge: float) -> Blocks:
    """Nominal blocks with these wedges [m]."""
    return replace(sample_blocks("nominal", np.random.default_rng(0), len(wedge)), wedge=np.array(wedge, float))


def test_wedges_follow_what_was_measured_and_change_nothing_else():
    boxes = sample_blocks("measured", np.random.default_rng(3), 20_000)
    blocks = sample_blocks("measured", np.random.default_rng(3), 20_000, wedge=True)
    np.testing.assert_array_equal(blocks.size, boxes.size)
    np.testing.assert_array_equal(blocks.mass, boxes.mass)
    assert not boxes.wedge.any()
    assert np.abs(blocks.wedge).max() <= 0.25e-3
    assert blocks.wedge.std() == pytest.approx(0.07e-3, rel=0.03)
    assert abs(blocks.wedge.mean()) < 2e-6


def test_the_name_of_a_tower_knows_its_wedges():
    assert wedges(0, 0).tower == sample_blocks("nominal", np.random.default_rng(0), 2).tower
    assert wedges(0, 1e-5).tower != wedges(0, 0).tower != wedges(0, -1e-5).tower


def test_a_block_on_a_wedge_leans_as_the_wedge_does():
    """Two blocks, one on the other along x: both solver and simulator tilt the upper one by wedge over length."""
    wedge = 2e-4
    blocks = wedges(wedge, 0.0)
    layout = Layout(np.array([[-1, 0, -1], [-1, 1, -1]]))
    planar = PlanarPose(np.zeros((2, 2)), np.zeros(2))
    computed = solve(blocks, layout, planar, PHYSICS.contact_law)
    assert computed.stands
    assert computed.pitch[1] == pytest.approx(-wedge / blocks.size[0, 0], rel=0.02)
    assert computed.load_on(0) == pytest.approx(blocks.mass[1] * GRAVITY, rel=1e-4)

    pose = np.zeros((2, 7))
    pose[:, 2], pose[:, 3] = computed.z, 1.0
    pose[:, 5] = computed.pitch / 2
    spec = base_spec(PHYSICS)
    add_tower(spec, blocks, pose, -1, PHYSICS)
    world = World(spec, blocks, layout)
    world.step(250)
    raised = rotation_matrices(world.pose[1, 3:])[2, 0]
    assert raised == pytest.approx(wedge / blocks.size[0, 0], rel=0.05)
    assert world.pose[:, 2] == pytest.approx(computed.z, abs=2e-5)
    pairs = set(zip(world.contacts().first.tolist(), world.contacts().second.tolist(), strict=True))
    assert (1, 0) in pairs


def test_a_wedge_weighs_what_its_box_weighs():
    blocks = wedges(2e-4, 0.0)
    spec = base_spec(PHYSICS)
    pose = np.tile([0.0, 0, 0, 1, 0, 0, 0], (2, 1))
    pose[:, 2] = 0.0075, 0.1
    add_tower(spec, blocks, pose, -1, PHYSICS)
    model = World(spec, blocks, Layout(np.array([[0, 1, -1]]))).model
    wedge, box = model.body("block_0"), model.body("block_1")
    assert wedge.mass[0] == pytest.approx(box.mass[0])
    np.testing.assert_allclose(np.sort(wedge.inertia), np.sort(box.inertia), rtol=1e-4)
    np.testing.assert_allclose(wedge.ipos, 0, atol=1e-9)


def test_a_grown_tower_of_wedges_starts_at_rest():
    tower = grow_tower(SpawnConfig(wedge=True), PHYSICS.contact_law, 3, np.random.default_rng(1))
    assert tower is not None
    assert tower.blocks.wedge.std() > 4e-5
    spec = base_spec(PHYSICS)
    add_tower(spec, tower.blocks, tower.pose, -1, PHYSICS)
    world = World(spec, tower.blocks, tower.layout)
    world.step(100)
    assert np.linalg.norm(world.pose[:, :3] - tower.pose[:, :3], axis=1).max() < 3e-4
