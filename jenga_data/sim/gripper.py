"""Driving the free-floating gripper: smooth set points, grip, and what its fingertips feel."""

import numpy as np
from jaxtyping import Float

from jenga_data.clock import CONTROL_STEP_NS
from jenga_data.episode import LEFT_FINGER, RIGHT_FINGER, Contacts, GripperSample
from jenga_data.sim.physics import GripperConfig
from jenga_data.sim.world import World

PERIOD = CONTROL_STEP_NS * 1e-9
"""One control period [s]."""


_OPENING_FORCE = 1.0
"""Of each finger when the hand opens [N]."""


class Gripper:
    """The hand of a `World` whose scene has one. It points along +x; its frame has the world's axes, its left finger
    at +y. Positions are those of the point between the fingertips."""

    def __init__(self, world: World, config: GripperConfig) -> None:
        self._world = world
        self._site = world.model.site("grasp").id
        self._slides = [world.model.actuator(f"hand_{axis}").id for axis in "xyz"]
        self._fingers = [world.model.actuator(f"{side}_finger").id for side in ("left", "right")]
        self._finger_joints = [world.model.joint(f"{side}_finger").qposadr[0] for side in ("left", "right")]
        self._origin = self.position
        self._lead = 2 * np.sqrt(config.mass / config.stiffness)  # damping over stiffness [s]
        self._grip_force = config.grip_force
        self._opening = config.opening
        self._set_point = self.position
        self._velocity = self._start_velocity = np.zeros(3)
        self._from = np.zeros(3)
        self._action = np.zeros(3)
        self.release()

    @property
    def position(self) -> Float[np.ndarray, "3"]:
        return self._world.data.site_xpos[self._site].copy()

    @property
    def width(self) -> float:
        """Distance between the fingertips [m]."""
        return float(self._opening - self._world.data.qpos[self._finger_joints].sum())

    def close(self, part: float = 1.0) -> None:
        """Press the fingers together with a part of the grip force (0 to 1) from now on; raise it slowly so as not to
        hit the block."""
        self._world.data.ctrl[self._fingers] = part * self._grip_force

    def release(self) -> None:
        """Drive the fingers apart, gently."""
        self._world.data.ctrl[self._fingers] = -_OPENING_FORCE

    def begin(self, displacement: Float[np.ndarray, "3"]) -> None:
        """Start a control period at whose end the set point is to be `displacement` [m] further on."""
        self._from = self._set_point.copy()
        self._start_velocity = self._velocity
        self._action = np.asarray(displacement, float)
        self._velocity = self._action / PERIOD

    def drive(self, part: float) -> None:
        """Command the set point at `part` (0 to 1) of the running period.

        The set point follows the cubic that starts with the velocity of the last period and ends with that of this
        one, so that velocity is continuous. The damping's share is fed forward: a constant speed has no lag.
        """
        s, v0, a = part, self._start_velocity * PERIOD, self._action
        offset = v0 * (s**3 - 2 * s**2 + s) + a * (3 * s**2 - 2 * s**3) + a * (s**3 - s**2)
        rate = (v0 * (3 * s**2 - 4 * s + 1) + a * (6 * s - 6 * s**2) + a * (3 * s**2 - 2 * s)) / PERIOD
        self._set_point = self._from + offset
        self._world.data.ctrl[self._slides] = self._set_point - self._origin + self._lead * rate

    def sample(self, time_ns: int, contacts: Contacts) -> GripperSample:
        """Pose, opening and fingertip forces at this moment."""

        def felt(finger: int) -> Float[np.ndarray, "3"]:
            return -contacts.force[contacts.second == finger].sum(axis=0)

        return GripperSample(
            time_ns=time_ns,
            pose=np.concatenate([self.position, [1.0, 0.0, 0.0, 0.0]]),
            width=self.width,
            left_force=felt(LEFT_FINGER),
            right_force=felt(RIGHT_FINGER),
        )
