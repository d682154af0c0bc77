"""Extraction rollouts of the whole robot: turn, push with the stick, turn, grasp, pull (paper, section II-A)."""

from collections.abc import Callable

import numpy as np

from jenga_data.collect.attempt import Attempt, run_attempt
from jenga_data.collect.causes import Failure
from jenga_data.collect.config import NOBODY, Actor, ExtractionConfig
from jenga_data.collect.extraction import Pull, View
from jenga_data.collect.observe import observe
from jenga_data.collect.recording import Recorder, Recording
from jenga_data.collect.rollout import OpenLog
from jenga_data.collect.skills import Skills
from jenga_data.collect.stage import Stage
from jenga_data.episode import Result
from jenga_data.errors import UnreachableError
from jenga_data.sim.robot import Robot, add_workplace
from jenga_data.sim.scene import add_tower, base_spec, xml_with_start
from jenga_data.sim.world import World

MakeSkills = Callable[[Robot, Recording, ExtractionConfig], Skills]


def robot_scene(config: ExtractionConfig, stage: Stage) -> tuple[World, Robot]:
    """The tower in the robot's workplace, the arm at its home."""
    spec = base_spec(config.physics)
    add_tower(spec, stage.blocks, stage.state.pose, stage.target, config.physics)
    add_workplace(spec, config.robot.arm, config.gripper, config.physics)
    world = World(spec, stage.blocks, stage.layout)
    return world, Robot(world, config.robot.arm, config.gripper)


class RobotAttempt(Attempt):
    """The arm turns the table, pushes the target out with a stick, turns back, grasps and pulls."""

    def __init__(self, config: ExtractionConfig, stage: Stage, make_skills: MakeSkills = Skills) -> None:
        """Args:
        make_skills: for who wants to watch them.
        """
        self._config, self._stage, self._make_skills = config, stage, make_skills
        self._world, self._robot = robot_scene(config, stage)
        self.robot_model = self._robot.model()
        self.scene = xml_with_start(self._world.spec, self._world.data)

    def to_grasp(self, recorder: Recorder) -> None:
        self.recording = Recording(self._world, recorder, self._stage.target, self._robot.state)
        self._skills = self._make_skills(self._robot, self.recording, self._config)
        self._world.allow_sleep(True)  # nothing touches the tower yet
        self.grasped = self._went_well(self._approach)

    @property
    def view(self) -> View:
        return View(self.recording, self._robot.arm, self._config.physics.steps_a_frame)

    def finish(self, pull: Pull) -> Result:
        if self.grasped:
            self._went_well(lambda: self._pull(pull))
        self.recording.phase("observe")
        observe(self.recording, self._config.physics, self._skills.watching)
        return self.recording.finish(self._skills.cause)

    def _went_well(self, part: Callable[[], None]) -> bool:
        """Do a part of the rollout; what ended it early is noted."""
        try:
            part()
        except Failure as failure:
            self._skills.note(failure.cause)
        except UnreachableError:
            self._skills.note("out_of_reach")
        else:
            return True
        return False

    def _approach(self) -> None:
        """Up to and with the grasp.

        Raises:
            Failure: what ended it.
            UnreachableError: so did a way that the arm cannot go.
        """
        quarter, recording, skills = np.pi / 2, self.recording, self._skills
        recording.phase("turn")
        if first := (self._stage.turn + 3) % 4 - 1:  # quarter turns that bring the face to be pulled to +x
            skills.turn(first * quarter)
        recording.phase("take_stick")
        skills.take_stick()
        recording.phase("push")
        skills.push()
        recording.phase("turn_back")
        skills.turn(2 * quarter, skills.way_home_with_stick())
        skills.let_go_of_stick()
        skills.grasp()

    def _pull(self, pull: Pull) -> None:
        """From the pull to the last release; raises as `_approach`."""
        recording, skills = self.recording, self._skills
        recording.phase("pull")
        went_wrong = pull.run(recording, self._robot.arm, skills.substep, self._config.physics.steps_a_frame)
        skills.note(went_wrong)
        if recording.clear_frame() >= 0 and not went_wrong:
            recording.phase("put_down")
            skills.put_down()
        else:
            recording.phase("release")
            skills.draw_back()


def run_with_robot(
    config: ExtractionConfig,
    seed: int,
    number: int,
    stage: Stage,
    open_log: OpenLog,
    pull: Pull,
    actor: Actor = NOBODY,
    make_skills: MakeSkills = Skills,
) -> Result:
    """Run the rollout that begins at `stage`, a tower as it was grown, and log it."""
    attempt = RobotAttempt(config, stage, make_skills)
    return run_attempt(attempt, pull, config, seed, number, stage, open_log, actor)
