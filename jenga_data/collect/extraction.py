"""Extraction rollouts: a gripper grasps the block that sticks out and pulls it over T actions (paper, section II-C)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from jenga_data.collect.config import NOBODY, PULL_FRAMES, Actor, ExtractionConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.observe import let_sleep
from jenga_data.collect.recording import Recording
from jenga_data.collect.rollout import OpenLog
from jenga_data.collect.stage import set_stage
from jenga_data.episode import Result
from jenga_data.errors import UnreachableError
from jenga_data.tower import TowerState

MAX_STEP_CHANGE = 0.013
"""a_x may change by so much from one period to the next [m]: 13 m/s^2, the arm's limit, over 32 ms."""
LIMITS = np.array([0.02, 0.001, 0.001])
"""Largest displacement a period along x, y, z [m] (paper, sections II-A and II-C)."""

SLIP = 0.005
"""What moves by more in the fingers is not held [m]."""
_AWAY = 0.05
"""A controller stops when the target is clear by so much [m]: nothing can fall onto it."""


@runtime_checkable
class Hand(Protocol):
    """What pulls: a gripper that floats, or an arm's."""

    @property
    def position(self) -> Float[np.ndarray, "3"]: ...
    def begin(self, displacement: Float[np.ndarray, "3"]) -> None: ...


@runtime_checkable
class Policy(Protocol):
    """Chooses the displacement of the end effector for the next control period."""

    def act(self, state: TowerState, target: int) -> Float[np.ndarray, "3"]: ...


@dataclass(frozen=True, eq=False)
class View:
    """What a policy may look at beside the tower, and must not change: the running world, what the recording knows
    (`recording.felt` are the latest fingertip samples), and the hand; `steps` are physics steps a control step."""

    recording: Recording
    hand: Hand
    steps: int


@runtime_checkable
class Onlooker(Protocol):
    """A policy that looks at more than the tower: it is shown the rest once, when the target has been grasped."""

    def enter(self, view: View) -> None: ...


@runtime_checkable
class Proposer(Protocol):
    """A policy that keeps to limits of its own: `wanted` is what it would have done without them, for the log."""

    wanted: Float[np.ndarray, "3"]


class RandomPull:
    """Pulls along -x at a speed drawn for the episode, with noise: what the dynamics data are made of."""

    def __init__(self, config: ExtractionConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._rng = rng
        self._mean = float(np.exp(rng.uniform(np.log(config.slowest), np.log(config.fastest))))

    def act(self, state: TowerState, target: int) -> Float[np.ndarray, "3"]:
        forward = self._mean * (1 + self._config.speed_noise * self._rng.normal())
        return np.array([-forward, *self._rng.uniform(-self._config.side, self._config.side, 2)])


def executable(wanted: Float[np.ndarray, "3"], previous: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The nearest action that the arm can make: within the paper's limits, and within the arm's acceleration."""
    action = np.clip(wanted, -LIMITS, LIMITS)
    action[0] = np.clip(action[0], previous[0] - MAX_STEP_CHANGE, previous[0] + MAX_STEP_CHANGE)
    return action


def run_extraction(
    config: ExtractionConfig,
    seed: int,
    number: int,
    open_log: OpenLog,
    policy: Policy | None = None,
    actor: Actor = NOBODY,
) -> Result:
    """Run one rollout and log it.

    Args:
        policy: who pulls, named by `actor`, and no longer than it takes to get the block clear; without one a
            `RandomPull` makes all T actions.
    """
    from jenga_data.collect.attempt import attempt_of, run_attempt

    stage = set_stage(config, seed, number)
    puller = policy or RandomPull(config, episode_rng(seed, number, "policy"))
    pull = Pull(puller, all_actions=policy is None)
    return run_attempt(attempt_of(config, stage), pull, config, seed, number, stage, open_log, actor)


class Pull:
    """T actions of a policy, one a control step.

    It ends when the tower has collapsed or the target is well clear of it; `all_actions` makes them all, the hand at
    rest once the target is clear.
    """

    def __init__(self, policy: Policy, all_actions: bool) -> None:
        self._policy = policy
        self._all = all_actions

    def run(self, recording: Recording, hand: Hand, substep: Callable[[int], None], steps: int) -> str:
        """Execute the actions; returns the cause of a pull that went wrong."""
        if isinstance(self._policy, Onlooker):
            self._policy.enter(View(recording, hand, steps))
        held = recording.poses[-1][recording.target, :3] - hand.position
        action = np.zeros(3)
        for _ in range(PULL_FRAMES):
            away = recording.distance_clear() > _AWAY
            if recording.has_collapsed() or (away and not self._all):
                break
            before, frame = hand.position, recording.frame
            try:
                act = self._policy.act(recording.world.tower_state(), recording.target)
                action = executable(np.zeros(3) if away else act, action)
                hand.begin(action)
            except UnreachableError:
                return "out_of_reach"
            wanted = self._policy.wanted if isinstance(self._policy, Proposer) else act
            recording.advance(substep, steps)
            recording.action(frame, action, hand.position - before, action if away else wanted)
            if recording.clear_frame() >= 0:
                let_sleep(recording)
        slip = recording.poses[-1][recording.target, :3] - hand.position - held
        if np.linalg.norm(slip) > SLIP:
            return "slipped"
        stopped = recording.has_collapsed() or recording.clear_frame() >= 0
        return "" if stopped else "out_of_time"
