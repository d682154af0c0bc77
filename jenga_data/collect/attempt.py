"""A rollout in two parts: what comes before the pull is the same whoever pulls, so that several can share it."""

from abc import ABC, abstractmethod

from jenga_data.collect.config import NOBODY, Actor, ExtractionConfig
from jenga_data.collect.extraction import Pull, View
from jenga_data.collect.recording import Recorder, Recording
from jenga_data.collect.rollout import OpenLog, header_of
from jenga_data.collect.stage import Stage
from jenga_data.episode import Result, RobotModel


class Attempt(ABC):
    """One tower with what will pull at it. First `to_grasp`, then `finish`; between them `copy.deepcopy` gives an
    attempt that goes on by itself, to the same bytes."""

    scene: str
    """MJCF of the scene, its keyframe the state before anything happened."""
    robot_model: RobotModel | None = None
    recording: Recording
    grasped = False
    """Whether the fingers are on the target. Where they are not, all pulls end in the same way."""

    @abstractmethod
    def to_grasp(self, recorder: Recorder) -> None:
        """Everything up to and with the grasp."""

    @property
    @abstractmethod
    def view(self) -> View:
        """World, recording and hand as a policy sees them."""

    @abstractmethod
    def finish(self, pull: Pull) -> Result:
        """The pull, if the target was grasped, and everything after it; the recorder is told the result."""


def attempt_of(config: ExtractionConfig, stage: Stage, careful: bool = False) -> Attempt:
    """The attempt that `config.body` makes at the target of `stage`.

    Args:
        careful: whether a robot pushes with `careful_push.CarefulSkills`.
    """
    if config.body == "robot":
        from jenga_data.collect.careful_push import CarefulSkills
        from jenga_data.collect.robot_extraction import RobotAttempt  # loads inverse kinematics
        from jenga_data.collect.skills import Skills

        return RobotAttempt(config, stage, CarefulSkills if careful else Skills)
    from jenga_data.collect.gripper_extraction import GripperAttempt

    return GripperAttempt(config, stage)


def run_attempt(
    attempt: Attempt,
    pull: Pull,
    config: ExtractionConfig,
    seed: int,
    number: int,
    stage: Stage,
    open_log: OpenLog,
    actor: Actor = NOBODY,
) -> Result:
    """Both parts, one after the other, logged as they go."""
    header = header_of(config, seed, number, stage, actor, attempt.robot_model)
    with open_log(header, attempt.scene) as log:
        attempt.to_grasp(log)
        return attempt.finish(pull)
