"""Setting the stage of an episode: a tower that stands by itself in the simulator, its target turned along x."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jenga_data.blocks import Blocks
from jenga_data.collect.config import CollectConfig, ExtractionConfig, SelectionConfig, SpawnConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.rest import at_rest
from jenga_data.collect.spawn import GrownTower, grow_tower, shifted
from jenga_data.errors import JengaError
from jenga_data.sim.physics import PhysicsConfig
from jenga_data.sim.scene import add_tower, base_spec
from jenga_data.sim.world import World
from jenga_data.tower import Layout, TowerState, quarter_turns_for


@dataclass(frozen=True, eq=False)
class Stage:
    """A standing tower with the target chosen. `turn` is the number of quarter turns that bring `face` of the target
    to -x, made already or yet to be made; `tries` counts the towers it took."""

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

    @classmethod
    def of(cls, standing: TowerState, target: int, face: int, tries: int = 1) -> "Stage":
        """Turn a tower so that `face` of `target` is at -x; it must stand as it was grown, and not be turned yet."""
        turn = quarter_turns_for(standing.layout, target, face)
        return cls(standing.turned(turn), target, turn, face, tries)


def set_stage(config: CollectConfig, seed: int, number: int) -> Stage:
    """Grow towers of a random round until one stands in the simulator, with a legal target and its face drawn.

    A robot finds the tower as it was grown. Without one the target is turned along x, and where a gripper is to pull
    it sticks out at the face that will be pulled, as after a push from behind.

    Raises:
        JengaError: no tower stood in `spawn.tries` tries.
    """
    spawn = config.spawn
    round_number = int(episode_rng(seed, number, "round").integers(spawn.first_round, spawn.last_round + 1))
    choice = episode_rng(seed, number, "target")
    chosen: list[tuple[int, int]] = []

    def prepare(grown: GrownTower) -> GrownTower | None:
        target, face = int(choice.choice(grown.layout.legal_targets())), int(choice.integers(2))
        if isinstance(config, SelectionConfig) and config.pull:
            target, face = another_target(grown.layout, target, config.pull, episode_rng(seed, number, "others"))
        chosen.append((target, face))
        if isinstance(config, ExtractionConfig) and config.body == "gripper":
            return shifted(grown, target, config.sticks_out * (1 if face else -1), config.physics.contact_law)
        return grown

    state, tries = standing_tower(
        spawn,
        config.physics,
        round_number,
        episode_rng(seed, number, "tower"),
        prepare,
        f"seed {seed}, number {number}",
    )
    target, face = chosen[-1]
    if isinstance(config, ExtractionConfig) and config.body == "robot":
        return Stage(state, target, quarter_turns_for(state.layout, target, face), face, tries)
    return Stage.of(state, target, face, tries)


def another_target(layout: Layout, first: int, pull: int, rng: np.random.Generator) -> tuple[int, int]:
    """The target and face of pull 1 and on of a tower whose pull 0 has the target `first`: all are different.

    Args:
        rng: the tower's; the same for all of its pulls.

    Raises:
        JengaError: the tower has not so many legal targets.
    """
    others = rng.permutation(np.setdiff1d(layout.legal_targets(), first))
    if pull > len(others):
        raise JengaError(f"pull is {pull}; this tower of round {layout.round} has pulls 0 to {len(others)}")
    return int(others[pull - 1]), int(rng.integers(2, size=len(others))[pull - 1])


def standing_tower(
    spawn: SpawnConfig,
    physics: PhysicsConfig,
    round_number: int,
    rng: np.random.Generator,
    prepare: Callable[[GrownTower], GrownTower | None] = lambda grown: grown,
    name: str = "",
) -> tuple[TowerState, int]:
    """Grow towers until one stands in the simulator, and how many tries that took.

    Args:
        prepare: what to do with a grown tower before it has to stand, None where that cannot be done.

    Raises:
        JengaError: none stood in `spawn.tries` tries; `name` says whose they were.
    """
    for tries in range(1, spawn.tries + 1):
        grown = grow_tower(spawn, physics.contact_law, round_number, rng)
        ready = None if grown is None else prepare(grown)
        pose = None if ready is None else standing_pose(spawn, physics, ready)
        if ready is not None and pose is not None:
            return TowerState(ready.blocks, ready.layout, pose, np.zeros((len(ready.blocks), 6))), tries
    raise JengaError(
        f"{name}: no tower of round {round_number} stood in {spawn.tries} tries; "
        "raise spawn.tries or spawn.creep-allowance"
    )


def standing_pose(
    spawn: SpawnConfig, physics: PhysicsConfig, tower: GrownTower, sleep: bool = True
) -> Float[np.ndarray, "block 7"] | None:
    """Where the blocks come to rest, or None if something moves by more than the creep allowance.

    Args:
        sleep: whether the tower may sleep once it is at rest; it then moves no more, and is not watched any longer.
    """
    spec = base_spec(physics)
    add_tower(spec, tower.blocks, tower.pose, target=-1, physics=physics)
    world = World(spec, tower.blocks, tower.layout)
    frame = physics.steps_a_frame * physics.timestep_ns * 1e-9
    world.step(round(spawn.settle / frame) * physics.steps_a_frame)
    poses = [world.pose]
    for _ in range(round(spawn.stand / frame)):
        world.step(physics.steps_a_frame)
        poses.append(world.pose)
        if not np.linalg.norm(poses[-1][:, :3] - poses[0][:, :3], axis=1).max() <= spawn.creep_allowance:
            return None
        if sleep and at_rest(poses):
            break
    return world.pose
