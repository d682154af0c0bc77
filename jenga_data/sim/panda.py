"""The arm: a Franka Emika Panda from its maker's published figures, with shapes of our own.

Kinematics (modified Denavit-Hartenberg parameters) and limits: Franka Control Interface documentation, "Robot and
interface specifications", https://frankaemika.github.io/docs/control_parameters.html. Masses, centres of mass and
inertias: identified by Gaz et al. 2019, "Dynamic Identification of the Franka Emika Panda Robot With Retrieval of
Feasible Parameters Using Penalty-Based Optimization", IEEE RA-L 4(4), which the maker's description package uses too.
Reflected inertias of the rotors: published by the maker for the FR3, the arm's successor with the same drives.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from jenga_data import palette

JOINTS = 7
FLANGE = 0.107
"""From joint 7 to the flange, along its axis [m]."""


@dataclass(frozen=True)
class Joint:
    """A joint and the link that it moves. The frame sits in the joint, its z along the axis.

    `a` [m], `d` [m], `alpha` [rad]: modified DH parameters of the step from the joint before. Limits in rad, rad/s,
    rad/s^2 and N m; `armature` [kg m^2]; `mass` [kg], `centre` [m], `inertia` about it: xx, yy, zz, xy, xz, yz
    [kg m^2]. `stiffness` [N m/rad] and `damping` [N m s/rad] are of the position controller.
    """

    a: float
    d: float
    alpha: float
    lower: float
    upper: float
    speed: float
    acceleration: float
    torque: float
    armature: float
    mass: float
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]
    stiffness: float
    damping: float


_90 = np.pi / 2
PANDA = (
    Joint(
        0, 0.333, 0, -2.8973, 2.8973, 2.175, 15, 87, 0.606, 4.970684, (0.003875, 0.002081, -0.04762),
        (0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169), 6000, 300,
    ),
    Joint(
        0, 0, -_90, -1.7628, 1.7628, 2.175, 7.5, 87, 0.606, 0.646926, (-0.003141, -0.02872, 0.003495),
        (0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704), 6000, 300,
    ),
    Joint(
        0, 0.316, _90, -2.8973, 2.8973, 2.175, 10, 87, 0.462, 3.228604, (0.027518, 0.039252, -0.066502),
        (0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805), 5000, 250,
    ),
    Joint(
        0.0825, 0, _90, -3.0718, -0.0698, 2.175, 12.5, 87, 0.462, 3.587895, (-0.05317, 0.104419, 0.027454),
        (0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641), 5000, 250,
    ),
    Joint(
        -0.0825, 0.384, -_90, -2.8973, 2.8973, 2.61, 15, 12, 0.206, 1.225946, (-0.011953, 0.041065, -0.038437),
        (0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229), 2000, 60,
    ),
    Joint(
        0, 0, _90, -0.0175, 3.7525, 2.61, 20, 12, 0.206, 1.666555, (0.060149, -0.014117, -0.010517),
        (0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341), 2000, 60,
    ),
    Joint(
        0.088, 0, _90, -2.8973, 2.8973, 2.61, 20, 12, 0.206, 0.735522, (0.010517, -0.004252, 0.061597),
        (0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741), 2000, 60,
    ),
)  # fmt: skip

_WHITE = (*palette.ARM, 1.0)
_DARK = (*palette.JOINT, 1.0)
_Point = tuple[float, float, float]
_SHAPES: tuple[tuple[tuple[_Point, _Point, float], ...], ...] = (
    (((0, 0, -0.19), (0, 0, 0), 0.062),),
    (((0, 0, -0.05), (0, 0, 0.05), 0.06), ((0, 0, 0), (0, -0.17, 0), 0.058)),
    (((0, 0, -0.12), (0, 0, -0.02), 0.056), ((0, 0, -0.02), (0.0825, 0.02, 0), 0.05)),
    (((0, 0, -0.04), (0, 0, 0.04), 0.052), ((0, 0, 0), (-0.0825, 0.11, 0), 0.05)),
    (((0, 0, -0.255), (0, 0, -0.12), 0.052), ((0, 0.06, -0.12), (0, 0.055, -0.01), 0.038)),
    (((0, 0, -0.035), (0, 0, 0.035), 0.046), ((0, 0, 0), (0.088, 0, 0), 0.044)),
    (((0, 0, -0.02), (0, 0, 0.055), 0.042),),
)
"""Capsules of each link in its frame: from, to, radius [m]."""


def limits(name: str) -> Float[np.ndarray, "7"]:
    """One of the figures of `Joint` for all joints."""
    return np.array([getattr(joint, name) for joint in PANDA], float)


def add_arm(
    spec: mujoco.MjSpec, base: Float[np.ndarray, "3"], yaw: float, contact: dict[str, object]
) -> mujoco.MjsBody:
    """Add the arm with its foot at `base` [m], turned by `yaw` [rad] about z; the body of its flange.

    Joints and their position actuators are named `joint_1` to `joint_7`, bodies `link_0` to `link_7` and `flange`.
    """
    foot = spec.worldbody.add_body(name="link_0", pos=base, quat=[np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)])
    foot.add_geom(
        name="link_0", type=mujoco.mjtGeom.mjGEOM_CYLINDER, fromto=[0, 0, 0, 0, 0, 0.14], size=[0.075, 0, 0],
        rgba=_WHITE, **contact,
    )  # fmt: skip
    foot.add_geom(
        name="link_0_back", type=mujoco.mjtGeom.mjGEOM_BOX, pos=[-0.08, 0, 0.04], size=[0.07, 0.06, 0.04],
        rgba=_WHITE, **contact,
    )  # fmt: skip
    body = foot
    for i, (joint, capsules) in enumerate(zip(PANDA, _SHAPES, strict=True)):
        # Modified DH: Rot_x(alpha) Trans_x(a) Rot_z(theta) Trans_z(d).
        cos, sin = np.cos(joint.alpha), np.sin(joint.alpha)
        body = body.add_body(
            name=f"link_{i + 1}",
            pos=[joint.a, -sin * joint.d, cos * joint.d],
            quat=[np.cos(joint.alpha / 2), np.sin(joint.alpha / 2), 0, 0],
            mass=joint.mass,
            ipos=joint.centre,
            fullinertia=joint.inertia,
            explicitinertial=True,
            gravcomp=1,
        )
        body.add_joint(
            name=f"joint_{i + 1}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1], range=[joint.lower, joint.upper],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE, armature=joint.armature,
        )  # fmt: skip
        drive = spec.add_actuator(
            name=f"joint_{i + 1}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=f"joint_{i + 1}",
            forcelimited=mujoco.mjtLimited.mjLIMITED_TRUE, forcerange=[-joint.torque, joint.torque],
        )  # fmt: skip
        drive.set_to_position(kp=joint.stiffness, kv=joint.damping)
        for k, (start, end, radius) in enumerate(capsules):
            body.add_geom(
                name=f"link_{i + 1}_{k}", type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[*start, *end],
                size=[radius, 0, 0], rgba=_DARK if k == 0 and i % 2 else _WHITE, mass=0, **contact,
            )  # fmt: skip
    flange = body.add_body(name="flange", pos=[0, 0, FLANGE])
    flange.add_geom(
        name="flange", type=mujoco.mjtGeom.mjGEOM_CYLINDER, fromto=[0, 0, -0.02, 0, 0, 0], size=[0.032, 0, 0],
        rgba=_DARK, mass=0, **contact,
    )  # fmt: skip
    return flange
