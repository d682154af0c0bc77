"""The scene as an MjSpec: table, turntable, tower, and a free-floating gripper."""

import mujoco
import numpy as np
from jaxtyping import Float

from jenga_data import palette
from jenga_data.blocks import Blocks
from jenga_data.sim.physics import GripperConfig, PhysicsConfig

TURNTABLE_RADIUS = 0.12
TABLE_TOP = 0.0
"""The tower's bottom stands at z = 0."""

TOP = "_top"
"""Ends the name of a wedge's upper half."""
_STEEL = (*palette.STEEL, 1.0)
_TURNTABLE_MASS = 3.5
"""A steel disc [kg]."""
_DRIVE_STIFFNESS = 4e3
"""Of the turntable's drive [N m/rad]: the torque of a pull at a block, about 0.1 N m, turns it by 2.5e-5 rad."""
_DRIVE_INERTIA = 0.025
"""What the drive's rotor weighs behind its gear [kg m^2], as much as the disc. Together they are fifty times as heavy
as a tower, and still slow enough for the physics step: their frequency on the drive is 280 rad/s."""
_PAD_IMPEDANCE = 0.999
"""Of a fingertip's contact: stiffer than wood on wood, so that what is held does not creep out of the hand."""


def base_spec(physics: PhysicsConfig) -> mujoco.MjSpec:
    """An empty table with the solver settings."""
    spec = mujoco.MjSpec()
    spec.modelname = "jenga"
    option = spec.option
    option.timestep = physics.timestep_ns * 1e-9
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    option.integrator = {
        "discrete": mujoco.mjtIntegrator.mjINT_DISCRETE,
        "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    }[physics.integrator]
    option.impratio = physics.impratio
    option.sleep_tolerance = physics.sleep_tolerance
    # MuJoCo answers numbers that are none with a silent reset: the tower would seem never to have moved.
    option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    spec.visual.headlight.ambient = [0.4, 0.4, 0.4]
    spec.worldbody.add_light(pos=[-0.5, -0.5, 1.5], dir=[0.3, 0.3, -1.0])
    spec.worldbody.add_geom(
        name="table", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.6, 0.6, 0.02], pos=[0, 0, TABLE_TOP - 0.03],
        rgba=[*palette.TABLE, 1.0], **wood_contact(physics),
    )  # fmt: skip
    _add_turntable(spec, physics)
    return spec


def _add_turntable(spec: mujoco.MjSpec, physics: PhysicsConfig) -> None:
    """A disc on a hinge about z, held by a geared drive: joint, actuator and geom are all named `turntable`."""
    body = spec.worldbody.add_body(name="turntable")
    # MuJoCo keeps awake what has an actuator, and then everything that stands on it.
    body.sleep = mujoco.mjtSleepPolicy.mjSLEEP_ALLOWED
    body.add_joint(name="turntable", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1], armature=_DRIVE_INERTIA)
    body.add_geom(
        name="turntable", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[TURNTABLE_RADIUS, 0.005, 0],
        pos=[0, 0, TABLE_TOP - 0.005], mass=_TURNTABLE_MASS, rgba=_STEEL, **wood_contact(physics),
    )  # fmt: skip
    drive = spec.add_actuator(name="turntable", trntype=mujoco.mjtTrn.mjTRN_JOINT, target="turntable")
    drive.set_to_position(kp=_DRIVE_STIFFNESS, kv=2 * np.sqrt(_DRIVE_STIFFNESS * _DRIVE_INERTIA))


def wood_contact(physics: PhysicsConfig) -> dict[str, object]:
    """Contact parameters of a wooden surface, as arguments of `add_geom`."""
    return {
        "condim": 3,
        "friction": [physics.friction, 0.005, 0.0001],
        "solref": [physics.time_constant, physics.damping_ratio],
        "solimp": [physics.touch_impedance, physics.impedance, physics.impedance_width, 0.5, 2.0],
    }


def add_tower(
    spec: mujoco.MjSpec, blocks: Blocks, pose: Float[np.ndarray, "block 7"], target: int, physics: PhysicsConfig
) -> None:
    """Add every block as a free body `block_N` with a box geom of the same name; -1 is no target.

    A wedge has a second geom, `block_N_top`.
    """
    colours = palette.block_colours(np.arange(len(blocks)), target if target >= 0 else None)
    for i in range(len(blocks)):
        body = spec.worldbody.add_body(name=f"block_{i}", pos=pose[i, :3], quat=pose[i, 3:])
        body.sleep = mujoco.mjtSleepPolicy.mjSLEEP_ALLOWED
        body.add_freejoint(name=f"block_{i}")
        look = {"rgba": [*colours[i], 1.0], **wood_contact(physics)}
        if blocks.wedge[i]:
            _add_wedge(body, f"block_{i}", blocks.size[i], blocks.wedge[i], blocks.mass[i], look)
        else:
            body.add_geom(
                name=f"block_{i}", type=mujoco.mjtGeom.mjGEOM_BOX, size=blocks.size[i] / 2, mass=blocks.mass[i], **look
            )


def _add_wedge(
    body: mujoco.MjsBody, name: str, size: Float[np.ndarray, "3"], wedge: float, mass: float, look: dict[str, object]
) -> None:
    """Two boxes of half the height, the upper one tilted: contacts between boxes are those that MuJoCo is best at."""
    half = size / 2 * [1, 1, 0.5]
    body.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=half, pos=[0, 0, -half[2]], mass=mass / 2, **look
    )  # fmt: skip
    tilt = -np.arctan2(wedge, size[0])  # about y: a positive wedge raises the +x end
    body.add_geom(
        name=f"{name}{TOP}", type=mujoco.mjtGeom.mjGEOM_BOX, size=half, pos=[0, 0, half[2]],
        quat=[np.cos(tilt / 2), 0, np.sin(tilt / 2), 0], mass=mass / 2, **look,
    )  # fmt: skip


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
    visual = {"contype": 0, "conaffinity": 0}
    hand.add_geom(
        name="palm", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.03, 0.05, 0.02], pos=[-0.075, 0, 0],
        mass=gripper.mass, rgba=_STEEL, **visual,
    )  # fmt: skip
    hand.add_site(name="grasp")
    pad = np.array(gripper.pad) / 2
    pad_contact = wood_contact(physics) | {
        "friction": [gripper.finger_friction, 0.01, 0.0001],
        "solimp": [_PAD_IMPEDANCE, _PAD_IMPEDANCE, 0.001, 0.5, 2.0],
    }
    for name, side in (("left", 1.0), ("right", -1.0)):
        finger = hand.add_body(name=f"{name}_finger", pos=[0, side * (gripper.opening / 2 + pad[1]), 0], gravcomp=1)
        finger.add_joint(
            name=f"{name}_finger", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, -side, 0], range=[0, gripper.opening / 2],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE, damping=5.0,
            solimp_limit=[0.99, 0.999, 0.001, 0.5, 2.0],
        )  # fmt: skip
        finger.add_geom(
            name=f"{name}_pad", type=mujoco.mjtGeom.mjGEOM_BOX, size=pad, mass=0.02, rgba=[*palette.RUBBER, 1.0],
            priority=1, **pad_contact,
        )  # fmt: skip
        finger.add_geom(
            name=f"{name}_link", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.0225, 0.004, 0.006], pos=[-0.03, 0, 0],
            mass=0.02, rgba=_STEEL, **visual,
        )  # fmt: skip
        motor = spec.add_actuator(name=f"{name}_finger", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=f"{name}_finger")
        motor.set_to_motor()
        motor.ctrlrange = [-gripper.grip_force, gripper.grip_force]
        motor.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
    # Fingers that close on nothing stop at their joints' ends: thrown through each other, they would be held apart
    # from the wrong side.
    spec.add_exclude(name="fingers", bodyname1="left_finger", bodyname2="right_finger")


def xml_with_start(spec: mujoco.MjSpec, data: mujoco.MjData) -> str:
    """The scene as MJCF, its keyframe 0 the given state; plain MuJoCo loads it."""
    for key in list(spec.keys):
        spec.delete(key)
    spec.add_key(name="start", qpos=data.qpos.copy(), qvel=data.qvel.copy(), ctrl=data.ctrl.copy(), time=0.0)
    return spec.to_xml()
