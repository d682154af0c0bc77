"""What the robot can do, skill by skill: the six key frames of a rollout as a state machine (paper, section II-A).

Each skill checks what it finds before and what it has done after; what went wrong has a name, the episode's cause.
The stick and the block are held by the fingers' friction alone.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from jenga_data.collect.causes import Failure
from jenga_data.collect.config import ExtractionConfig
from jenga_data.collect.extraction import SLIP
from jenga_data.collect.motion import Motion
from jenga_data.collect.recording import Recording
from jenga_data.geometry import rotation_matrices
from jenga_data.sim.arm import Path
from jenga_data.sim.robot import STICK_GRIP, STICK_LENGTH, STICK_PLACE, STICK_REACH, STICK_WIDTH, TRAY, Robot
from jenga_data.sim.set_point import PERIOD
from jenga_data.sim.turntable import WokenError, whole_frames

DRAGGED = 0.005
"""A push that moves another block by more [m] has dragged it; `jenga calibrate movable` has the same limit."""
_X, _Z = np.eye(3)[0], np.eye(3)[2]
_STICK_LIFT = 0.04
_DROP = 0.001
"""What is put down is let go so far above where it will lie [m]."""
_PUT_BACK = 0.005
"""The stick is back when it lies so near to where it lay [m]."""
_BEHIND = 0.05
"""The open hand comes from so far behind what it grasps [m]."""
_SAFE = 0.004
"""The stick's tip stops so far in front of the block [m], and pushes from there."""
_CLEARANCE = 0.002
"""Between the fingertips and the tower's face [m]."""
_LEAST_HOLD = 0.008
"""The fingertips must overlap a block's end by so much [m], half their length."""
_CLOSE_FRAMES = 8
_TURN_SECONDS = 4.0


class Skills(Motion):
    """The skills of one robot in one recorded rollout."""

    rest_seconds = 3.0
    """A tower that was touched gets so long to come to rest [s]."""

    def __init__(self, robot: Robot, recording: Recording, config: ExtractionConfig) -> None:
        super().__init__(robot, recording, config)
        self._pad, self._size = config.gripper.pad, robot.world.blocks.size[recording.target]

    def turn(self, angle: float, along: Path | None = None) -> None:
        """Turn the sleeping tower with its table, while the arm goes along a path.

        Raises:
            Failure: the tower does not come to rest, or something touched it.
        """
        self._settle()
        seconds = _TURN_SECONDS * max(abs(angle) / np.pi, 0.5)
        turning = self._watched_turn(self._robot.turntable.turn(angle, seconds))
        frames = whole_frames(seconds)
        done = 0 if along is None else min(len(along.point), frames)
        for k in range(done):
            assert along is not None
            self._arm.begin_knot(along, k)
            self.frame(turning)
        self.hold(frames - done, turning)
        if self._recording.has_collapsed():
            raise Failure("turn_toppled")
        if along is not None:
            for k in range(done, len(along.point)):
                self._arm.begin_knot(along, k)
                self.frame()

    def _watched_turn(self, turning: Iterator[None]) -> Iterator[None]:
        """A turn that notes it when the tower is woken: the frame, whose last step was made, is still recorded."""
        try:
            yield from turning
        except WokenError:
            self._woken = True
            yield

    def _settle(self) -> None:
        """Wait until the tower sleeps."""
        world, first = self._world, self._recording.frame
        while not world.asleep:
            if (self._recording.frame - first) * PERIOD > self.rest_seconds or self._recording.has_collapsed():
                raise Failure("unsettled")
            self.hold()

    def take_stick(self) -> None:
        """Grasp the stick in its holder from behind, and lift it."""
        place = self._stick_grip()
        self.follow(self.straight(place - _BEHIND * _X, place, speed=self._config.speed))
        self._close()
        if abs(self._arm.width - STICK_WIDTH) > 0.002:
            raise Failure("stick_missed")
        before = self._robot.stick
        self.follow(self.straight(place + _STICK_LIFT * _Z, speed=self._config.speed))
        if abs(self._robot.stick[2] - before[2] - _STICK_LIFT) > 0.003:
            raise Failure("stick_missed")

    def push(self) -> None:
        """Push the target in +x by the configured distance, as long as it takes no more than the configured force.

        The target may stick out all the same where `push_dragged_layer` or `push_stuck` is noted.

        Raises:
            Failure: `push_toppled`, or one of a motion.
        """
        config, recording, target = self._config, self._recording, self._target
        before = recording.poses[-1]
        ready = before[target, :3] - (self._size[0] / 2 + STICK_REACH + _SAFE) * _X
        self.follow(self.straight(ready - _BEHIND * _X, speed=config.speed))
        self.follow(self.straight(ready, speed=config.approach_speed))
        self.touch(*range(len(before)))
        forward = self.straight(ready + (_SAFE + config.push_distance) * _X, speed=config.push_speed)
        self.push_forward(forward)
        self.follow(self.straight(ready, speed=config.approach_speed))
        self.leave_alone()
        self.follow(self.straight(ready - _BEHIND * _X, speed=config.speed))
        after = recording.poses[-1]
        if recording.has_collapsed():
            raise Failure("push_toppled")
        if np.delete(np.linalg.norm(after[:, :3] - before[:, :3], axis=1), target).max() > DRAGGED:
            self.note("push_dragged_layer")
        if after[target, 0] - before[target, 0] < config.push_distance - config.push_tolerance:
            self.note("push_stuck")

    def push_forward(self, path: Path) -> None:
        """Go along the push's way, until it takes too much force."""
        self.follow(path, force=self._config.push_force)

    def way_home_with_stick(self) -> Path:
        """From anywhere to over the stick's holder, and down into it."""
        place = self._stick_grip()
        return self.straight(place + _STICK_LIFT * _Z, place + _DROP * _Z, speed=self._config.speed)

    def let_go_of_stick(self) -> None:
        """Open the fingers over the holder and draw back."""
        self._open()
        self.follow(self.straight(self._arm.set_point - _BEHIND * _X, speed=self._config.speed))
        if np.linalg.norm(self._robot.stick - STICK_PLACE) > _PUT_BACK:
            self.note("stick_lost")

    def sticks_out(self) -> float:
        """By how much the target's end at -x sticks out in front of everything that the fingers could touch [m]."""
        pose, size = self._recording.poses[-1], self._world.blocks.size
        end = pose[self._target, 0] - self._size[0] / 2
        near = np.abs(pose[:, 2] - pose[self._target, 2]) < (self._size[2] + self._pad[2]) / 2
        near[self._target] = False
        along = np.abs(1 - 2 * (pose[:, 5] ** 2 + pose[:, 6] ** 2))
        front = pose[:, 0] - np.where(along > 0.5, size[:, 0], size[:, 1]) / 2
        # A target that tipped out of its level has nothing beside it.
        return float(front[near].min(initial=end + self._config.push_distance) - end)

    def grasp(self) -> None:
        """Take the end of the target that sticks out at -x.

        Raises:
            Failure: it does not stick out far enough (`push_stuck`), or one of the grasp's own.
        """
        out, recording = self.sticks_out(), self._recording
        half = self._pad[0] / 2
        if out < _LEAST_HOLD + _CLEARANCE:
            raise Failure("push_stuck")
        place = self._near_end() + min(out / 2, out - _CLEARANCE - half) * _X
        recording.phase("approach")
        across = np.array([self._arm.set_point[0], *place[1:]])  # clear of the stick in its holder
        self.follow(self.straight(across, place - _BEHIND * _X, speed=self._config.speed))
        self.may_touch = frozenset({self._target})
        self.follow(self.straight(place, speed=self._config.approach_speed))
        recording.phase("grasp")
        self.touch(self._target)
        self._close()
        if recording.has_collapsed():
            raise Failure("approach_toppled")
        if self._arm.width - self._size[1] > SLIP:
            raise Failure("grasp_two_blocks")
        if self._arm.width - self._size[1] < -SLIP:
            raise Failure("grasp_missed")

    def holds(self) -> bool:
        """Whether the fingers are on the target."""
        return bool(abs(self._arm.width - self._size[1]) < SLIP)

    def put_down(self) -> None:
        """Carry the target away to the tray, put it down and draw back."""
        config, recording = self._config, self._recording
        self.left_alone = recording.clear_frame()
        held = recording.poses[-1][self._target, :3] - self._arm.set_point
        over = TRAY + (self._size[2] / 2 + _DROP) * _Z - held
        here = self._arm.set_point
        aside = np.array([min(here[0], over[0]), here[1], here[2]])
        high = np.array([over[0], over[1], max(over[2] + 0.03, here[2])])
        self.follow(self.straight(aside, high, over, speed=config.speed))
        if not self.holds():
            raise Failure("dropped")
        self.draw_back()

    def draw_back(self) -> None:
        """Open the fingers and leave."""
        self._open()
        self.follow(self.straight(self._arm.set_point - _BEHIND * _X, speed=self._config.approach_speed))
        self.leave_alone()

    def _near_end(self) -> Float[np.ndarray, "3"]:
        """The middle of the target's end at -x [m]."""
        pose = self._recording.poses[-1][self._target]
        along = rotation_matrices(pose[3:])[:, 0]
        return pose[:3] - np.sign(along[0]) * along * self._size[0] / 2

    def _stick_grip(self) -> Float[np.ndarray, "3"]:
        """Where the fingers hold the stick in its holder."""
        return STICK_PLACE - (STICK_LENGTH / 2 - STICK_GRIP) * _X

    def _close(self) -> None:
        for k in range(_CLOSE_FRAMES):
            self._arm.close((k + 1) / _CLOSE_FRAMES)
            self.hold()

    def _open(self) -> None:
        self._arm.release()
        self.hold(_CLOSE_FRAMES)
