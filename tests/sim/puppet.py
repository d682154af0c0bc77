"""A tower that moves as told, without physics, and a recording of it."""

import numpy as np
from kept_record import Kept
from short_tower import short_tower, world_of

from jenga_data.collect.recording import Recording
from jenga_data.episode import Contacts
from jenga_data.sim.physics import PhysicsConfig
from jenga_data.sim.world import World

PHYSICS = PhysicsConfig(timestep_ns=4_000_000)
STEPS = 8


class Puppet(World):
    """A tower that moves as told, without physics."""

    def __init__(self) -> None:
        template = world_of(short_tower())
        self.blocks, self.layout = template.blocks, template.layout
        self.shown = template.pose
        self.now_ns = 5_000_000
        self.allowed_at_ns: list[int] = []

    @property
    def pose(self) -> np.ndarray:
        return self.shown.copy()

    @property
    def twist(self) -> np.ndarray:
        return np.zeros((len(self.blocks), 6))

    @property
    def table_angle(self) -> float:
        return 0.0

    @property
    def time_ns(self) -> int:
        return self.now_ns

    def step(self, count: int = 1) -> None:
        self.now_ns += count * PHYSICS.timestep_ns

    def allow_sleep(self, allowed: bool) -> None:
        self.allowed_at_ns.append(self.now_ns)

    def contacts(self) -> Contacts:
        return Contacts(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)))

    def integration_state(self) -> np.ndarray:
        return np.array([float(self.now_ns)])


class Stage:
    """A recording of a puppet, and what happens to it."""

    def __init__(self) -> None:
        self.world = Puppet()
        self.target = int(self.world.layout.grid[0, 1])
        self.kept = Kept()
        self.recording = Recording(self.world, self.kept, self.target)

    def wait(self, frames: int) -> None:
        for _ in range(frames):
            self.recording.advance(lambda _: self.world.step(), STEPS)

    def move(self, block: int, *by: float) -> None:
        self.world.shown[block, :3] += by
