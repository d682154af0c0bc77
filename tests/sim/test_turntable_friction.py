"""How much friction a turn needs: of towers, and of a block whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest
from short_tower import PHYSICS, short_tower

from jenga_data.blocks import GRAVITY, Blocks, sample_blocks
from jenga_data.collect.config import SpawnConfig
from jenga_data.collect.spawn import GrownTower, grow_tower
from jenga_data.friction import friction_share
from jenga_data.sim.turntable import TURN_SECONDS, MinimumJerk, friction_needed
from jenga_data.statics import Equilibrium, PlanarPose
from jenga_data.tower import TowerState

HALF_TURN = MinimumJerk(np.pi, TURN_SECONDS)


def state_of(tower: GrownTower) -> TowerState:
    return TowerState(tower.blocks, tower.layout, tower.pose, np.zeros((len(tower.blocks), 6)))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_half_a_turn_in_4_seconds_needs_a_twentieth_of_the_friction_of_a_played_tower(seed):
    rng = np.random.default_rng(seed)
    grown = None
    while grown is None:
        grown = grow_tower(SpawnConfig(), PHYSICS.contact_law, 15, rng)
    assert grown.layout.round == 15
    assert 0.002 < friction_needed(state_of(grown), HALF_TURN, PHYSICS) < 0.05


def test_needed_friction_goes_with_one_over_the_square_of_the_time_and_one_over_the_friction():
    state = state_of(short_tower(round_number=2))
    needed = friction_needed(state, HALF_TURN, PHYSICS)
    quick, smooth = MinimumJerk(np.pi, TURN_SECONDS / 10), replace(PHYSICS, friction=PHYSICS.friction / 2)
    assert friction_needed(state, quick, PHYSICS) == pytest.approx(100 * needed, rel=1e-5)
    assert friction_needed(state, HALF_TURN, smooth) == pytest.approx(2 * needed, rel=1e-5)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_needed_friction_is_that_of_the_turned_tower(turns):
    state = state_of(short_tower(round_number=2))
    there = friction_needed(state.turned(turns), HALF_TURN, PHYSICS)
    assert there == pytest.approx(friction_needed(state, HALF_TURN, PHYSICS), rel=1e-3)


def resting_block() -> tuple[Blocks, PlanarPose, Equilibrium]:
    """A block alone at the origin: four corners carry it."""
    blocks = sample_blocks("nominal", np.random.default_rng(0), 1)
    corner = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) * blocks.size[0, :2] / 2
    flat = PlanarPose(np.zeros((1, 2)), np.zeros(1))
    force = np.full(4, blocks.mass[0] * GRAVITY / 4)
    none = np.zeros(1)
    rest = Equilibrium(none, none, none, np.zeros(4, np.int64), np.full(4, -1), force, corner, True)
    return blocks, flat, rest


@pytest.mark.parametrize("direction", [[1.0, 0.0], [0.6, 0.8], [-0.1, 0.5]])
def test_a_block_that_is_accelerated_needs_acceleration_over_gravity(direction):
    blocks, flat, rest = resting_block()
    share = friction_share(blocks, flat, rest, np.array([direction]), np.zeros(1), 0.3)
    expected = np.linalg.norm(direction) / (0.3 * GRAVITY)
    assert expected * (1 - 1e-9) <= share <= expected * 1.02


def test_a_block_that_is_spun_is_held_at_its_corners():
    blocks, flat, rest = resting_block()
    share = friction_share(blocks, flat, rest, np.zeros((1, 2)), np.ones(1), 0.3)
    length, width, _ = blocks.size[0]
    expected = (length**2 + width**2) / 12 / (0.3 * GRAVITY * np.hypot(length, width) / 2)
    assert expected * (1 - 1e-9) <= share <= expected * 1.02


def test_a_tower_that_falls_has_no_known_friction():
    state = state_of(short_tower())
    pose = state.pose.copy()
    pose[state.layout.level == 3, 0] += 0.05
    with pytest.raises(ValueError, match="in no equilibrium"):
        friction_needed(replace(state, pose=pose), HALF_TURN, PHYSICS)
