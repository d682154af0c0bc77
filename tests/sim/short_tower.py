"""Towers of a few levels: the same code as for 18 of them, in a fiftieth of the time."""

import numpy as np
from short_towers import short_towers

from jenga_data.collect.config import CollectConfig, ExtractionConfig, SelectionConfig, SpawnConfig
from jenga_data.collect.rollout import OpenLog
from jenga_data.collect.spawn import GrownTower, grow_tower
from jenga_data.collect.workers import run_one
from jenga_data.episode import Result
from jenga_data.sim.gripper import add_gripper
from jenga_data.sim.physics import GripperConfig, PhysicsConfig
from jenga_data.sim.scene import add_tower, base_spec
from jenga_data.sim.world import World

LEVELS = 4
PHYSICS = PhysicsConfig()
SPAWN = SpawnConfig(first_round=1, last_round=2, stand=0.32)
SELECTION = SelectionConfig(spawn=SPAWN)
EXTRACTION = ExtractionConfig(body="gripper", spawn=SPAWN)
"""Without an arm, which is quick."""


def run_short(config: CollectConfig, seed: int, number: int, open_log: OpenLog) -> Result:
    """`run_one` on a tower of four levels, also in a worker process."""
    with short_towers():
        return run_one(config, seed, number, open_log)


def short_tower(levels: int = LEVELS, round_number: int = 1, seed: int = 0) -> GrownTower:
    with short_towers(levels):
        tower = grow_tower(SpawnConfig(), PHYSICS.contact_law, round_number, np.random.default_rng(seed))
    assert tower is not None
    return tower


def world_of(tower: GrownTower, hand_before: int = -1, physics: PhysicsConfig = PHYSICS) -> World:
    """The tower as it was computed, with an open hand 3 cm in front of a block's end at -x if one is named."""
    spec = base_spec(physics)
    add_tower(spec, tower.blocks, tower.pose, hand_before, physics)
    if hand_before >= 0:
        position = tower.pose[hand_before, :3] - [tower.blocks.size[hand_before, 0] / 2 + 0.03, 0, 0]
        add_gripper(spec, position, GripperConfig(), physics)
    return World(spec, tower.blocks, tower.layout)
