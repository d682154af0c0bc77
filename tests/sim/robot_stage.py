"""The robot in front of a short tower, ready for any skill."""

from dataclasses import dataclass, replace

import numpy as np
from kept_record import Kept
from short_tower import PHYSICS, SPAWN, short_tower

from jenga_data.collect.config import ExtractionConfig
from jenga_data.collect.recording import Recording
from jenga_data.collect.skills import Skills
from jenga_data.episode import GripperSample
from jenga_data.sim.robot import Robot, add_workplace
from jenga_data.sim.scene import add_tower, base_spec
from jenga_data.sim.world import World

CONFIG = ExtractionConfig(spawn=SPAWN)
LOOSE = replace(CONFIG, side=0.0001, slowest=0.004, fastest=0.006)
"""A tower of four levels is light: a pull that goes up and down as much as in the data takes its upper levels along."""
ARM, GRIPPER = CONFIG.robot.arm, CONFIG.gripper


class RobotKept(Kept):
    """Keeps what the fingers feel too, and is opened as a log is."""

    def __init__(self) -> None:
        super().__init__()
        self.samples: list[GripperSample] = []

    def __enter__(self) -> "RobotKept":
        return self

    def __exit__(self, *error: object) -> None:
        return None

    def gripper(self, sample: GripperSample) -> None:
        self.samples.append(sample)


@dataclass(frozen=True, eq=False)
class Workplace:
    """A robot, its world and its skills; frames are kept in `log`."""

    world: World
    robot: Robot
    recording: Recording
    skills: Skills
    log: RobotKept


def workplace(
    config: ExtractionConfig = CONFIG, level: int = 2, slot: int = 1, make_skills: type[Skills] = Skills
) -> Workplace:
    """A sleeping tower of four levels; the target of an even level lies along x, so that nothing needs to be turned."""
    tower = short_tower()
    target = int(tower.layout.grid[level, slot])
    spec = base_spec(PHYSICS)
    add_tower(spec, tower.blocks, tower.pose, target, PHYSICS)
    add_workplace(spec, config.robot.arm, config.gripper, PHYSICS)
    world = World(spec, tower.blocks, tower.layout)
    robot, log = Robot(world, config.robot.arm, config.gripper), RobotKept()
    world.step(150)
    world.allow_sleep(True)
    while not world.asleep:
        world.step()
        assert world.time_ns < 2e9
    recording = Recording(world, log, target, robot.state)
    return Workplace(world, robot, recording, make_skills(robot, recording, config), log)


def put(world: World, body: str, position: tuple[float, float, float] | np.ndarray) -> None:
    """Put a free body somewhere, at rest, as it is turned."""
    joint = world.data.joint(body)
    joint.qpos[:3], joint.qvel[:] = position, 0.0
