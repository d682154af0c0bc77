"""Extraction rollouts of the whole robot: turn, push with the stick, turn, grasp, pull (paper, section II-A)."""

from collections.abc import Callable

import numpy as np

from jenga_data.collect.causes import Failure
from jenga_data.collect.config import NOBODY, Actor, ExtractionConfig
from jenga_data.collect.extraction import Pull
from jenga_data.collect.observe import observe
from jenga_data.collect.recording import Recording
from jenga_data.collect.rollout import OpenLog, header_of
from jenga_data.collect.skills import Skills
from jenga_data.collect.stage import Stage
from jenga_data.episode import Result
from jenga_data.errors import UnreachableError
from jenga_data.sim.robot import Robot, add_workplace
from jenga_data.sim.scene import add_tower, base_spec, xml_with_start
from jenga_data.sim.world import World

MakeSkills = Callable[[Robot, Recording, ExtractionConfig], Skills]


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
    """Run the rollout that begins at `stage`, a tower as it was grown, and log it.

    Args:
        make_skills: for who wants to watch them.
    """
    world, robot = robot_scene(config, stage)
    header = header_of(config, seed, number, stage, actor, robot.model())

    with open_log(header, xml_with_start(world.spec, world.data)) as log:
        recording = Recording(world, log, stage.target, robot.state)
        skills = make_skills(robot, recording, config)
        world.allow_sleep(True)  # nothing touches the tower yet
        try:
            _rollout(skills, recording, robot, stage, pull, config)
        except Failure as failure:
            skills.note(failure.cause)
        except UnreachableError:
            skills.note("out_of_reach")
        recording.phase("observe")
        observe(recording, config.physics, skills.watching)
        return recording.finish(skills.cause)


def robot_scene(config: ExtractionConfig, stage: Stage) -> tuple[World, Robot]:
    """The tower in the robot's workplace, the arm at its home."""
    spec = base_spec(config.physics)
    add_tower(spec, stage.blocks, stage.state.pose, stage.target, config.physics)
    add_workplace(spec, config.robot.arm, config.gripper, config.physics)
    world = World(spec, stage.blocks, stage.layout)
    return world, Robot(world, config.robot.arm, config.gripper)


def _rollout(
    skills: Skills, recording: Recording, robot: Robot, stage: Stage, pull: Pull, config: ExtractionConfig
) -> None:
    """Everything up to the last release.

    Raises:
        Failure: what ended it.
        UnreachableError: so did a way that the arm cannot go.
    """
    quarter = np.pi / 2
    recording.phase("turn")
    if first := (stage.turn + 3) % 4 - 1:  # quarter turns that bring the face to be pulled to +x
        skills.turn(first * quarter)
    recording.phase("take_stick")
    skills.take_stick()
    recording.phase("push")
    skills.push()
    recording.phase("turn_back")
    skills.turn(2 * quarter, skills.way_home_with_stick())
    skills.let_go_of_stick()
    skills.grasp()
    recording.phase("pull")
    went_wrong = pull.run(recording, robot.arm, skills.substep, config.physics.steps_a_frame)
    skills.note(went_wrong)
    if recording.clear_frame() >= 0 and not went_wrong:
        recording.phase("put_down")
        skills.put_down()
    else:
        recording.phase("release")
        skills.draw_back()
