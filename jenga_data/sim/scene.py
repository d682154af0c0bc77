"""The scene as an MjSpec: table, turntable and tower."""

import mujoco
import numpy as np
from jaxtyping import Float

from jenga_data import palette
from jenga_data.blocks import Blocks
from jenga_data.scenery import COLUMN_RADIUS, TABLE_CENTRE, TABLE_SIZE, TABLE_TOP, TURNTABLE_HEIGHT, TURNTABLE_RADIUS
from jenga_data.sim.physics import PhysicsConfig

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


def base_spec(physics: PhysicsConfig) -> mujoco.MjSpec:
    """An empty table with the solver settings."""
    spec = mujoco.MjSpec()
    spec.modelname = "jenga"
    spec.compiler.degree = False
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
        name="table", type=mujoco.mjtGeom.mjGEOM_BOX, size=np.array(TABLE_SIZE) / 2,
        pos=TABLE_CENTRE, rgba=[*palette.TABLE, 1.0], **wood_contact(physics),
    )  # fmt: skip
    spec.worldbody.add_geom(
        name="column", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[COLUMN_RADIUS, 0, 0],
        fromto=[0, 0, TABLE_TOP, 0, 0, -TURNTABLE_HEIGHT], rgba=_STEEL, contype=0, conaffinity=0,
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
        name="turntable", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[TURNTABLE_RADIUS, TURNTABLE_HEIGHT / 2, 0],
        pos=[0, 0, -TURNTABLE_HEIGHT / 2], mass=_TURNTABLE_MASS, rgba=_STEEL, **wood_contact(physics),
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


def xml_with_start(spec: mujoco.MjSpec, data: mujoco.MjData) -> str:
    """The scene as MJCF, its keyframe 0 the given state; plain MuJoCo loads it."""
    for key in list(spec.keys):
        spec.delete(key)
    spec.add_key(name="start", qpos=data.qpos.copy(), qvel=data.qvel.copy(), ctrl=data.ctrl.copy(), time=0.0)
    return spec.to_xml()
