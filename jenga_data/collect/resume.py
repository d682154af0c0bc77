"""A logged pull taken up again in the simulator, at any of its actions: what would have come of other ones?"""

from typing import Literal

import numpy as np
from jaxtyping import Float

from jenga_data.collect.config import ExtractionConfig, config_from_dict
from jenga_data.collect.gripper_extraction import gripper_scene
from jenga_data.collect.stage import Stage
from jenga_data.dataset.schema import POSE_STEP
from jenga_data.episode import Episode
from jenga_data.errors import JengaError
from jenga_data.sim.arm import Arm
from jenga_data.sim.gripper import Gripper
from jenga_data.sim.set_point import SetPoint
from jenga_data.sim.world import World

Known = Literal["poses", "poses and hand", "poses and velocities", "velocities and set point", "all"]
"""What a restart is told: where everything is, with nothing moving; the hand's and its target's velocity as well; those
of all blocks; and how far the hand lags behind its set point, that is how hard it pulls. Poses are rounded as in a
dataset's rows, but for "all", which goes on as the log does.
"""
KNOWN: tuple[Known, ...] = ("poses", "poses and hand", "poses and velocities", "velocities and set point", "all")


class Resumed:
    """The scene of a logged extraction with its own hand, arm included where there is one.

    Contacts need no memory: MuJoCo computes them from positions and velocities. The set points of the hand are not in
    the log. At the first action the hand is at rest, so they can be read off the drives there; from then on they
    follow from the actions alone.
    """

    def __init__(self, episode: Episode) -> None:
        """
        Raises:
            JengaError: the log is of another kind, or holds no action or no state of the simulator.
        """
        config = config_from_dict(episode.header.config)
        name = episode.header.key
        if not isinstance(config, ExtractionConfig) or not len(episode.action_frame):
            raise JengaError(f"episode {name} is no extraction with actions: there is no pull to take up again")
        header = episode.header
        stage = Stage(episode.tower_state(0), header.target, header.turn, header.face, tries=1)
        self.episode, self._steps = episode, config.physics.steps_a_frame
        self.world, self.hand = _scene(config, stage)
        if episode.sim_state.shape[1] != len(self.world.integration_state()):
            raise JengaError(f"episode {name} was logged by another simulator: collect it again")
        self.world.allow_sleep(False)
        self._memory = self._set_points()

    def _set_points(self) -> list[tuple[SetPoint, ...]]:
        """The hand's set points before each action."""
        self.world.restore(self.episode.sim_state[self.episode.action_frame[0]])
        self.hand.take_up_rest()
        memory = [self.hand.remember()]
        for action in self.episode.action[:-1]:
            self.hand.begin(action)
            memory.append(self.hand.remember())
        return memory

    def restart(self, number: int, known: Known = "all") -> None:
        """Go back to the state before action `number` of the episode, as far as it is `known`."""
        world, frame = self.world, self.episode.action_frame[number]
        world.restore(self.episode.sim_state[frame])
        if known == "all":
            self.hand.recall(self._memory[number])
            return
        twist = np.zeros_like(self.episode.twist[frame])
        if known in ("poses and velocities", "velocities and set point"):
            twist = self.episode.twist[frame]
        elif known == "poses and hand":
            twist[self.episode.header.target] = self.episode.twist[frame, self.episode.header.target]
        if known == "velocities and set point":
            self.hand.recall(self._memory[number])
        else:
            self.hand.forget(moving=known != "poses")
        world.set_tower(np.round(world.pose / POSE_STEP) * POSE_STEP)
        world.set_twist(twist)

    def play(self, actions: Float[np.ndarray, "step 3"]) -> Float[np.ndarray, "step block 7"]:
        """Make actions from the present state on; the tower's poses after each [m].

        Raises:
            UnreachableError: the arm cannot make one of them.
        """
        poses = []
        for action in actions:
            self.hand.begin(action)
            for step in range(self._steps):
                self.hand.drive(step / self._steps)
                self.world.step()
            poses.append(self.world.pose)
        return np.stack(poses)


def _scene(config: ExtractionConfig, stage: Stage) -> tuple[World, Gripper | Arm]:
    if config.body == "gripper":
        return gripper_scene(config, stage)
    from jenga_data.collect.robot_extraction import robot_scene  # loads inverse kinematics

    world, robot = robot_scene(config, stage)
    return world, robot.arm
