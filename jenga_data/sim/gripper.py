"""A gripper that floats: three force-limited slides carry the hand in place of an arm."""

from copy import copy

import mujoco
import numpy as np
from jaxtyping import Float

from jenga_data import palette
from jenga_data.sim.fingers import Fingers, add_fingers
from jenga_data.sim.physics import GripperConfig, PhysicsConfig
from jenga_data.sim.set_point import PERIOD, SetPoint
from jenga_data.sim.world import World


def add_gripper(
    spec: mujoco.MjSpec, position: Float[np.ndarray, "3"], gripper: GripperConfig, physics: PhysicsConfig
) -> None:
    """Add a hand that points along +x, its fingertips open around `position` (the point between them)."""
    hand = spec.worldbody.add_body(name="hand", pos=position, gravcomp=1)
    damping = 2 * np.sqrt(gripper.stiffness * gripper.mass)
    for axis, name in enumerate("xyz"):
        hand.add_joint(name=f"hand_{name}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[float(axis == k) for k in range(3)])
        drive = spec.add_actuator(name=f"hand_{name}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=f"hand_{name}")
        drive.set_to_position(kp=gripper.stiffness, kv=damping)
        drive.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        drive.forcerange = [-gripper.force_limit, gripper.force_limit]
    hand.add_geom(
        name="palm", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.03, 0.05, 0.02], pos=[-gripper.finger_length - 0.03, 0, 0],
        mass=gripper.mass, rgba=[*palette.STEEL, 1.0], contype=0, conaffinity=0,
    )  # fmt: skip
    hand.add_site(name="grasp")
    add_fingers(spec, hand, gripper, physics, solid=False)


class Gripper(Fingers):
    """The hand of a `World` whose scene has one. It points along +x; its frame has the world's axes. Positions are
    those of the point between the fingertips."""

    def __init__(self, world: World, config: GripperConfig) -> None:
        super().__init__(world, config)
        self._slides = [world.model.actuator(f"hand_{axis}").id for axis in "xyz"]
        self._qvel = [world.model.joint(f"hand_{axis}").dofadr[0] for axis in "xyz"]
        self._origin = self.position
        self._lead = 2 * np.sqrt(config.mass / config.stiffness)  # damping over stiffness [s]
        self._set_point = SetPoint(self.position)

    @property
    def set_point(self) -> Float[np.ndarray, "3"]:
        """Where the running period ends [m]."""
        return self._set_point.knot

    def begin(self, displacement: Float[np.ndarray, "3"]) -> None:
        """Start a control period at whose end the set point is to be `displacement` [m] further on."""
        way = np.asarray(displacement, float)
        self._set_point.begin(self._set_point.knot + way, way / PERIOD)

    def drive(self, part: float) -> None:
        """Command the set point for the physics step that begins at `part` (0 to 1) of the running period.

        The damping's share is fed forward: a constant speed has no lag.
        """
        position, velocity, _ = self._set_point.at(part)
        self._world.data.ctrl[self._slides] = position - self._origin + self._lead * velocity

    def remember(self) -> tuple[SetPoint, ...]:
        """The set point between two periods, for `recall`."""
        return (copy(self._set_point),)

    def recall(self, memory: tuple[SetPoint, ...]) -> None:
        self._set_point = copy(memory[0])

    def take_up_rest(self) -> None:
        """Find the set point of a hand that was put to rest some periods ago in the state of its drives."""
        self._set_point.stand(self._world.data.ctrl[self._slides] + self._origin, np.zeros(3))

    def forget(self, moving: bool) -> None:
        """Take the set point to be where the hand is, going on as fast as it goes; or else stop hand and set point."""
        if not moving:
            self._world.data.qvel[self._qvel] = 0.0
        self._set_point.stand(self.position, self._world.data.qvel[self._qvel])
