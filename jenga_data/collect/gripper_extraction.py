"""Extraction rollouts of a gripper without an arm, in front of a target that sticks out already."""

import numpy as np
from jaxtyping import Float

from jenga_data.collect.attempt import Attempt
from jenga_data.collect.config import ExtractionConfig
from jenga_data.collect.extraction import SLIP, Pull, View
from jenga_data.collect.observe import observe
from jenga_data.collect.recording import Recorder, Recording
from jenga_data.collect.stage import Stage
from jenga_data.episode import Result
from jenga_data.sim.gripper import Gripper, add_gripper
from jenga_data.sim.scene import add_tower, base_spec, xml_with_start
from jenga_data.sim.world import World

_APPROACH = 0.04
_APPROACH_FRAMES = 10
_GRASP_FRAMES = 8


def gripper_scene(config: ExtractionConfig, stage: Stage) -> tuple[World, Gripper]:
    """The tower with the open gripper in front of the end that sticks out."""
    spec = base_spec(config.physics)
    add_tower(spec, stage.blocks, stage.state.pose, stage.target, config.physics)
    grasp = stage.state.pose[stage.target, :3].copy()
    grasp[0] -= stage.blocks.size[stage.target, 0] / 2 - config.sticks_out / 2
    add_gripper(spec, grasp - [_APPROACH, 0, 0], config.gripper, config.physics)
    world = World(spec, stage.blocks, stage.layout)
    return world, Gripper(world, config.gripper)


class GripperAttempt(Attempt):
    """The open gripper comes, closes around the end that sticks out, and pulls."""

    def __init__(self, config: ExtractionConfig, stage: Stage) -> None:
        self._world, self._gripper = gripper_scene(config, stage)
        self._physics, self._target = config.physics, stage.target
        self.scene = xml_with_start(self._world.spec, self._world.data)

    def to_grasp(self, recorder: Recorder) -> None:
        self.recording = recording = Recording(self._world, recorder, self._target)
        self._world.allow_sleep(True)  # nothing touches the tower yet; the fingers will wake it
        recording.phase("approach")
        self._move(np.array([_APPROACH, 0.0, 0.0]), _APPROACH_FRAMES)
        self._move(np.zeros(3), 1)
        recording.phase("grasp")
        for frame in range(_GRASP_FRAMES):
            self._gripper.close((frame + 1) / _GRASP_FRAMES)
            self._move(np.zeros(3), 1)
        # As far apart as the target is wide: on it, and not on air or on two blocks.
        self.grasped = bool(abs(self._gripper.width - self._world.blocks.size[self._target, 1]) < SLIP)
        self._world.allow_sleep(False)

    @property
    def view(self) -> View:
        return View(self.recording, self._gripper, self._physics.steps_a_frame)

    def finish(self, pull: Pull) -> Result:
        cause = "grasp_missed"
        if self.grasped:
            self.recording.phase("pull")
            cause = pull.run(self.recording, self._gripper, self._substep, self._physics.steps_a_frame)
        self.recording.phase("observe")
        observe(self.recording, self._physics, self._hold)
        return self.recording.finish(cause)

    def _substep(self, i: int) -> None:
        self._gripper.drive(i / self._physics.steps_a_frame)
        self._world.step()
        if (i + 1) % self._physics.steps_a_touch == 0:
            self.recording.gripper(self._gripper.sample(self.recording.time_ns()))

    def _hold(self, i: int) -> None:
        if i == 0:
            self._gripper.begin(np.zeros(3))
        self._substep(i)

    def _move(self, displacement: Float[np.ndarray, "3"], frames: int) -> None:
        for _ in range(frames):
            self._gripper.begin(displacement / frames)
            self.recording.advance(self._substep, self._physics.steps_a_frame)
