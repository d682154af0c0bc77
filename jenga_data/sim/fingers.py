"""The two flat fingers of a parallel-jaw gripper: how they look, how they grip and what they feel."""

from copy import copy

import mujoco
import numpy as np
from jaxtyping import Float

from jenga_data import palette
from jenga_data.episode import GripperSample
from jenga_data.sim.physics import GripperConfig, PhysicsConfig
from jenga_data.sim.scene import wood_contact
from jenga_data.sim.set_point import SetPoint
from jenga_data.sim.world import World

_PAD_IMPEDANCE = 0.999
"""Of a fingertip's contact: stiffer than wood on wood, so that what is held does not creep out of the hand."""
_OPENING_FORCE = 1.0
"""Of each finger when the hand opens [N]."""
_SIDES = (("left", 1.0), ("right", -1.0))


def add_fingers(
    spec: mujoco.MjSpec, hand: mujoco.MjsBody, gripper: GripperConfig, physics: PhysicsConfig, solid: bool
) -> None:
    """Add fingers to a hand whose frame sits between the fingertips: x away from the hand, y to the left finger.

    A drive presses each; a gear keeps them as far from the middle as each other. Joints, actuators and bodies are
    named `left_finger` and `right_finger`, their tips' geoms `left_pad` and `right_pad`.

    Args:
        solid: whether what is behind the tips touches things too.
    """
    pad = np.array(gripper.pad) / 2
    pad_contact = wood_contact(physics) | {
        "friction": [gripper.finger_friction, 0.01, 0.0001],
        "solimp": [_PAD_IMPEDANCE, _PAD_IMPEDANCE, 0.001, 0.5, 2.0],
    }
    behind = wood_contact(physics) if solid else {"contype": 0, "conaffinity": 0}
    bar = (gripper.finger_length - pad[0]) / 2  # set back from the tip's face, so that only tips grip
    for name, side in _SIDES:
        finger = hand.add_body(name=f"{name}_finger", pos=[0, side * (gripper.opening / 2 + pad[1]), 0], gravcomp=1)
        finger.add_joint(
            name=f"{name}_finger", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, -side, 0], range=[0, gripper.opening / 2],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE, damping=gripper.finger_damping,
            solimp_limit=[0.99, 0.999, 0.001, 0.5, 2.0],
        )  # fmt: skip
        finger.add_geom(
            name=f"{name}_pad", type=mujoco.mjtGeom.mjGEOM_BOX, size=pad, mass=0.02, rgba=[*palette.RUBBER, 1.0],
            priority=1, **pad_contact,
        )  # fmt: skip
        finger.add_geom(
            name=f"{name}_bar", type=mujoco.mjtGeom.mjGEOM_BOX, size=[bar, 0.003, pad[2]],
            pos=[-pad[0] - bar, side * 0.002, 0],
            mass=0.02, rgba=[*palette.STEEL, 1.0], **behind,
        )  # fmt: skip
        motor = spec.add_actuator(name=f"{name}_finger", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=f"{name}_finger")
        motor.set_to_motor()
        motor.ctrlrange = [-gripper.grip_force, gripper.grip_force]
        motor.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
    gear = spec.add_equality(
        name="fingers", type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1="left_finger", name2="right_finger", solref=[0.004, 1.0], solimp=[0.99, 0.999, 0.001, 0.5, 2.0],
    )  # fmt: skip
    gear.data[:2] = [0.0, 1.0]
    # Fingers that close on nothing stop at their joints' ends: thrown through each other, they would be held apart
    # from the wrong side.
    spec.add_exclude(name="fingers", bodyname1="left_finger", bodyname2="right_finger")


class Fingers:
    """The fingers of a `World` whose scene has some."""

    def __init__(self, world: World, config: GripperConfig) -> None:
        self._world = world
        self._finger_drives = [world.model.actuator(f"{side}_finger").id for side, _ in _SIDES]
        self._finger_qpos = [world.model.joint(f"{side}_finger").qposadr[0] for side, _ in _SIDES]
        self._finger_pads = np.array([world.model.geom(f"{side}_pad").id for side, _ in _SIDES])
        self._site = world.model.site("grasp").id
        self._grip_force = config.grip_force
        self._opening = config.opening
        self.release()

    @property
    def position(self) -> Float[np.ndarray, "3"]:
        """Of the point between the fingertips [m]."""
        return self._world.kinematics().site_xpos[self._site].copy()

    @property
    def set_point(self) -> Float[np.ndarray, "3"]:
        """Where the running period ends [m]."""
        raise NotImplementedError

    def begin(self, displacement: Float[np.ndarray, "3"]) -> None:
        """Start a control period at whose end the set point is to be `displacement` [m] further on."""
        raise NotImplementedError

    def drive(self, part: float) -> None:
        """Command the drives for the physics step that begins at `part` (0 to 1) of the running period."""
        raise NotImplementedError

    def preview(self, actions: Float[np.ndarray, "period 3"], steps: int) -> Float[np.ndarray, "substep drive"]:
        """What all drives of the world would be told in `steps` physics steps of each period, if these displacements
        were made from now on [m]. Nothing has changed afterwards.

        Raises:
            UnreachableError: the hand cannot make one of them.
        """
        ahead, control = copy(self), self._world.data.ctrl
        for name, value in vars(self).items():
            if isinstance(value, SetPoint):
                setattr(ahead, name, copy(value))
        before, told = control.copy(), []
        try:
            for action in actions:
                ahead.begin(action)
                for step in range(steps):
                    ahead.drive(step / steps)
                    told.append(control.copy())
        finally:
            control[:] = before
        return np.array(told).reshape(-1, len(before))

    @property
    def pose(self) -> Float[np.ndarray, "7"]:
        """Of the gripper's frame: position [m] and wxyz quaternion."""
        out, now = np.empty(7), self._world.kinematics()
        out[:3] = now.site_xpos[self._site]
        mujoco.mju_mat2Quat(out[3:], now.site_xmat[self._site])
        return out

    def sample(self, time_ns: int) -> GripperSample:
        """Pose, opening and fingertip forces at this moment."""
        left, right = self.felt()
        return GripperSample(time_ns=time_ns, pose=self.pose, width=self.width, left_force=left, right_force=right)

    @property
    def width(self) -> float:
        """Distance between the fingertips [m]."""
        return float(self._opening - self._world.data.qpos[self._finger_qpos].sum())

    def close(self, part: float = 1.0) -> None:
        """Press the fingers together with a part of the grip force (0 to 1) from now on; raise it slowly so as not to
        hit what they close on."""
        self._world.data.ctrl[self._finger_drives] = part * self._grip_force

    def release(self) -> None:
        """Drive the fingers apart, gently."""
        self._world.data.ctrl[self._finger_drives] = -_OPENING_FORCE

    def felt(self) -> Float[np.ndarray, "2 3"]:
        """The force on the left and the right fingertip, by whatever it touches, in the gripper's frame [N]."""
        data = self._world.data
        contact, force = data.contact, np.zeros((2, 3))
        touching = np.flatnonzero(np.isin(contact.geom, self._finger_pads).any(1) & (contact.efc_address >= 0))
        for i in touching.tolist():
            first, second = contact.geom[i]
            address = contact.efc_address[i]
            on_second = contact.frame[i].reshape(3, 3).T @ data.efc_force[address : address + 3]
            for k, pad in enumerate(self._finger_pads):
                force[k] += on_second * (int(second == pad) - int(first == pad))
        return force @ data.site_xmat[self._site].reshape(3, 3)
