"""How the arm moves in a recorded rollout: along straight lines, frame by frame, watched for what it touches."""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float

from jenga_data.collect.causes import Failure
from jenga_data.collect.config import ExtractionConfig
from jenga_data.collect.observe import let_sleep
from jenga_data.collect.recording import Recording
from jenga_data.episode import TABLE
from jenga_data.sim.arm import Path
from jenga_data.sim.robot import Robot
from jenga_data.sim.set_point import PERIOD
from jenga_data.sim.turntable import MinimumJerk, whole_frames

_SMOOTH = 5
"""Touch samples whose mean is the force of a push: it hits the block with a spike of one."""


class Motion:
    """The moving parts of one robot in one recorded rollout, and what they may touch at present."""

    def __init__(self, robot: Robot, recording: Recording, config: ExtractionConfig) -> None:
        self._robot, self._recording = robot, recording
        self._config, self._physics = config.robot, config.physics
        self._arm, self._world, self._target = robot.arm, robot.world, recording.target
        self.may_touch: frozenset[int] = frozenset()
        """Blocks that hand or stick are meant to touch at present."""
        self._felt = [0.0] * _SMOOTH
        self._most_force = np.inf
        self.stopped = False
        """Whether the last guarded motion met too much force."""
        self.left_alone: int | None = 0
        """The frame from which on nothing touches the tower, which may sleep then; None while something does."""
        self._woken = False
        self.cause = ""
        """The first of `CAUSES` that was noted."""

    def note(self, cause: str) -> None:
        """Something went wrong that need not end the rollout; "" is nothing."""
        self.cause = self.cause or cause

    def substep(self, i: int, step: Callable[[], object] | None = None) -> None:
        """One physics step of a control period that was begun; `step` steps the world, `World.step` by default."""
        self._arm.drive(i / self._physics.steps_a_frame)
        (step or self._world.step)()
        if (i + 1) % self._physics.steps_a_touch == 0:
            sample = self._arm.sample(self._recording.time_ns())
            self._recording.gripper(sample)
            self._felt = [*self._felt[1 - _SMOOTH :], -float(sample.left_force[0] + sample.right_force[0])]
            if np.mean(self._felt) > self._most_force:
                self._arm.stop((i + 1) / self._physics.steps_a_frame)
                self.stopped, self._most_force = True, np.inf

    def frame(self, turning: Iterator[None] | None = None) -> None:
        """One control period that was begun.

        Raises:
            Failure: the arm collided, or touched a block that it should not.
        """
        step = self._world.step if turning is None else turning.__next__
        self._recording.advance(lambda i: self.substep(i, step), self._physics.steps_a_frame)
        if self.left_alone is not None:
            let_sleep(self._recording, self.left_alone)
        self._watch()
        if self._woken:
            raise Failure("bumped")

    def touch(self, *blocks: int) -> None:
        """From now on these blocks may be touched, and the tower stays awake."""
        self.may_touch, self.left_alone = frozenset(blocks), None
        self._world.allow_sleep(False)

    def leave_alone(self) -> None:
        """From now on nothing may touch the tower."""
        self.may_touch, self.left_alone = frozenset(), self._recording.frame

    def _watch(self) -> None:
        if self._robot.collides():
            raise Failure("self_collision")
        contacts = self._recording.contacts
        touched = set(contacts.first[contacts.second < TABLE].tolist())
        if touched - self.may_touch and not self._recording.has_collapsed():  # what falls may fall on the hand
            raise Failure("grasp_two_blocks" if self._target in self.may_touch else "bumped")

    def watching(self, i: int) -> None:
        """One physics step of looking on, whatever happens."""
        if i == 0:
            self._arm.begin(np.zeros(3))
        self.substep(i)

    def hold(self, frames: int = 1, turning: Iterator[None] | None = None) -> None:
        """Stay where the hand is."""
        for _ in range(frames):
            self._arm.begin(np.zeros(3))
            self.frame(turning)

    def straight(
        self, *through: Float[np.ndarray, "3"], speed: float = np.inf, acceleration: float | None = None
    ) -> Path:
        """A path from the present set point along straight lines, each from rest to rest with least jerk.

        Args:
            speed: no faster [m/s].
            acceleration: nor with more of it [m/s^2]; by default the configured one.

        Raises:
            UnreachableError: it leads out of reach.
        """
        acceleration = acceleration or self._config.acceleration
        points, velocities, start = [], [], self._arm.set_point
        for end in through:
            way = np.asarray(end) - start
            length = float(np.linalg.norm(way))
            if length < 1e-9:
                continue
            # Largest speed and acceleration of least jerk: 1.875 d / T and 5.774 d / T^2.
            seconds = max(1.875 * length / speed, np.sqrt(5.774 * length / acceleration))
            frames = whole_frames(seconds)
            profile = MinimumJerk(1.0, frames * PERIOD)
            for k in range(1, frames + 1):
                part, rate, _ = profile.at(k * PERIOD)
                points.append(start + part * way)
                velocities.append(rate * way)
            start = np.asarray(end)
        return self._arm.plan(np.array(points).reshape(-1, 3), np.array(velocities).reshape(-1, 3))

    def follow(self, path: Path, force: float = np.inf) -> None:
        """Go along a path, until what pushes the hand back along -x is more than `force` [N] or the tower falls."""
        self._most_force, self.stopped = force, False
        for k in range(len(path.point)):
            self._arm.begin_knot(path, k)
            self.frame()
            if self.stopped or (np.isfinite(force) and self._recording.has_collapsed()):
                break
        self._most_force = np.inf
