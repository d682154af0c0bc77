"""Setting the stage of an episode: a tower that stands by itself in the simulator, its target turned along x."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jenga_data.blocks import Blocks
from jenga_data.collect.config import CollectConfig, ExtractionConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.spawn import GrownTower, grow_tower, shifted
from jenga_data.errors import JengaError
from jenga_data.sim.scene import add_tower, base_spec
from jenga_data.sim.world import World
from jenga_data.tower import Layout, TowerState, quarter_turns_for


@dataclass(frozen=True, eq=False)
class Stage:
    """A standing tower, turned, with the target chosen. `tries` counts the towers it took."""

    state: TowerState
    target: int
    turn: int
    face: int
    tries: int

    @property
    def blocks(self) -> Blocks:
        return self.state.blocks

    @property
    def layout(self) -> Layout:
        return self.state.layout


def set_stage(config: CollectConfig, seed: int, number: int) -> Stage:
    """Grow towers of a random round until one stands in the simulator, with a legal target and its face drawn.

    For an extraction the target then sticks out at the face that will be pulled, as after a push from behind.

    Raises:
        JengaError: no tower stood in `spawn.tries` tries.
    """
    spawn, stiffness = config.spawn, config.physics.contact_stiffness
    round_number = int(episode_rng(seed, number, "round").integers(spawn.first_round, spawn.last_round + 1))
    rng, choice = episode_rng(seed, number, "tower"), episode_rng(seed, number, "target")
    for tries in range(1, spawn.tries + 1):
        grown = grow_tower(spawn, stiffness, round_number, rng)
        if grown is None:
            continue
        target, face = int(choice.choice(grown.layout.legal_targets())), int(choice.integers(2))
        if isinstance(config, ExtractionConfig):
            grown = shifted(grown, target, config.sticks_out * (1 if face else -1), stiffness)
        pose = _standing_pose(config, grown) if grown is not None else None
        if grown is not None and pose is not None:
            turn = quarter_turns_for(grown.layout, target, face)
            state = TowerState(grown.blocks, grown.layout, pose, np.zeros((len(grown.blocks), 6)))
            return Stage(state.turned(turn), target, turn, face, tries)
    raise JengaError(
        f"seed {seed}, number {number}: no tower of round {round_number} stood in {spawn.tries} tries; "
        "raise spawn.tries or spawn.creep-allowance"
    )


def _standing_pose(config: CollectConfig, tower: GrownTower) -> Float[np.ndarray, "block 7"] | None:
    """Where the blocks come to rest, or None if something moves by more than the creep allowance."""
    spec = base_spec(config.physics)
    add_tower(spec, tower.blocks, tower.pose, target=-1, physics=config.physics)
    world = World(spec, tower.blocks, tower.layout)
    frame = config.physics.steps_a_frame * config.physics.timestep_ns * 1e-9
    for _ in range(round(config.spawn.settle / frame)):
        world.step(config.physics.steps_a_frame)
    settled = world.pose
    for watched in range(round(config.spawn.stand / frame)):
        world.allow_sleep(watched >= round(config.spawn.awake / frame))
        world.step(config.physics.steps_a_frame)
        if np.linalg.norm(world.pose[:, :3] - settled[:, :3], axis=1).max() > config.spawn.creep_allowance:
            return None
        if world.asleep:
            break
    return world.pose
