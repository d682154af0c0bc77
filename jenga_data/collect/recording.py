"""Writing a running world into a log, frame by frame."""

from collections import deque
from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from jenga_data.episode import CONTROL_STEP_NS, Action, Frame, GripperSample, Phase, Result, RobotState
from jenga_data.geometry import clear_of_others, in_table_frame
from jenga_data.outcome import THRESHOLDS, Verdict, collapsed, judge
from jenga_data.sim.world import World

FELT = 64
"""Touch samples that are kept at hand: a quarter of a second."""


@runtime_checkable
class Recorder(Protocol):
    """What an episode needs of a log; `jenga_data.log.writer.EpisodeWriter` is one."""

    def frame(self, frame: Frame) -> None: ...
    def action(self, action: Action) -> None: ...
    def gripper(self, sample: GripperSample) -> None: ...
    def phase(self, phase: Phase) -> None: ...
    def finish(self, result: Result) -> None: ...


class Recording:
    """Counts the frames of one world, hands each to the recorder and keeps what the verdict needs."""

    def __init__(
        self, world: World, recorder: Recorder, target: int, robot: Callable[[], RobotState] | None = None
    ) -> None:
        """Args:
        robot: gives the robot's present state, where there is one.
        """
        self.world = world
        self.target = target
        self._robot = robot
        self._table = [world.table_angle]
        self._recorder = recorder
        self._start_ns = world.time_ns
        self._clear: list[bool] = []
        self.phase_name = ""
        """The phase that runs."""
        self.felt: deque[GripperSample] = deque(maxlen=FELT)
        """What the fingers felt of late."""
        self.poses: list[Float[np.ndarray, "block 7"]] = []
        self._snap()

    @property
    def frame(self) -> int:
        """Number of the latest frame."""
        return len(self.poses) - 1

    def clear_frame(self) -> int:
        """First of the latest frames in which the target is clear of the tower, -1 if it is not clear now."""
        first = len(self._clear)
        while first and self._clear[first - 1]:
            first -= 1
        return first if first < len(self._clear) else -1

    def stood_for(self, seconds: float) -> bool:
        """Whether the target has been clear for so long."""
        return self.clear_frame() >= 0 and (self.frame - self.clear_frame()) * CONTROL_STEP_NS >= seconds * 1e9

    def target_x(self, frame: int = -1) -> float:
        """Where the target was along x [m]; by default, where it is."""
        return float(self.poses[frame][self.target, 0])

    def distance_clear(self) -> float:
        """How far along -x the target has come since it was clear [m], 0 if it is not."""
        clear = self.clear_frame()
        return self.target_x(clear) - self.target_x() if clear >= 0 else 0.0

    def has_collapsed(self) -> bool:
        """Whether a block but the target has dropped by now."""
        return bool(collapsed(self.poses[0], self.poses[-1], self.target, THRESHOLDS.drop))

    def time_ns(self) -> int:
        return self.world.time_ns - self._start_ns

    def phase(self, name: str) -> None:
        """Begin a phase."""
        self.phase_name = name
        self._recorder.phase(Phase(self.frame, self.time_ns(), name))

    def advance(self, substep: Callable[[int], None], steps: int) -> None:
        """Run `substep(i)` for each physics step of one control step, then record the frame."""
        for i in range(steps):
            substep(i)
        self._snap()

    def action(
        self,
        frame: int,
        displacement: Float[np.ndarray, "3"],
        reached: Float[np.ndarray, "3"],
        wanted: Float[np.ndarray, "3"] | None = None,
    ) -> None:
        """Record what was commanded from `frame` on, once it is known what came of it; `wanted` is what the policy
        asked for before it was put on the limits, if that differs."""
        same = wanted is None or np.array_equal(wanted, displacement)
        asked = None if same else np.array(wanted, float)
        self._recorder.action(Action(frame, frame * CONTROL_STEP_NS, displacement, reached, asked))

    def gripper(self, sample: GripperSample) -> None:
        self.felt.append(sample)
        self._recorder.gripper(sample)

    def verdict(self) -> Verdict:
        pose = np.stack(self.poses)
        turned = np.array(self._table) - self._table[0]
        if turned.any() and np.isfinite(pose).all():
            pose = in_table_frame(pose, turned)
        return judge(pose, self.world.blocks.size, self.target, CONTROL_STEP_NS * 1e-9)

    def finish(self, cause: str = "") -> Result:
        result = Result(self.verdict(), cause)
        self._recorder.finish(result)
        return result

    def _snap(self) -> None:
        pose = self.world.pose
        with np.errstate(all="ignore"):  # broken physics give numbers beyond all bounds; the verdict says so
            clear = bool(clear_of_others(pose, self.world.blocks.size, self.target))
            twist, self.contacts = self.world.twist, self.world.contacts()
        self.poses.append(pose)
        self._clear.append(clear)
        if len(self.poses) > 1:
            self._table.append(self.world.table_angle)
        state, robot = self.world.integration_state(), self._robot and self._robot()
        turned = self._table[-1] - self._table[0]
        self._recorder.frame(
            Frame(self.frame, self.time_ns(), pose, twist, self.contacts, state, turned, robot or None)
        )
