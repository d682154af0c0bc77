"""The arm as a carrier of the hand: inverse kinematics, planned paths and joint position control."""

from copy import copy
from dataclasses import dataclass
from typing import Any

import mink
import mujoco
import numpy as np
from jaxtyping import Float

from jenga_data import palette
from jenga_data.errors import UnreachableError
from jenga_data.sim.fingers import Fingers, add_fingers
from jenga_data.sim.panda import JOINTS, add_arm, limits
from jenga_data.sim.physics import ArmConfig, GripperConfig, PhysicsConfig
from jenga_data.sim.scene import wood_contact
from jenga_data.sim.set_point import PERIOD, SetPoint
from jenga_data.sim.world import World

_PALM = 0.065
"""Depth of the palm between flange and fingers [m]."""
_MOUNT = -np.pi / 4
"""The hand is turned by this about the flange's axis, as the maker's own [rad]."""
_TOUCHING = (("link_0", "link_1"), ("link_5", "link_7"), ("link_6", "flange"), ("link_7", "flange"), ("link_7", "hand"))
_MOVING = 1e-3
"""A set point that moves slower has no direction [m/s]."""
_REACHED, _ALIGNED = 2e-5, 2e-4
"""A pose is solved to so many metres and radians."""
_ITERATIONS = 60


def add_robot(spec: mujoco.MjSpec, arm: ArmConfig, gripper: GripperConfig, physics: PhysicsConfig) -> None:
    """Add the arm with its hand: bodies `link_0` to `link_7`, `flange`, `hand`, `left_finger`, `right_finger`."""
    contact = wood_contact(physics)
    flange = add_arm(spec, np.array(arm.base), arm.yaw, contact)
    _add_hand(spec, flange, gripper, contact)
    add_fingers(spec, spec.body("hand"), gripper, physics, solid=True)
    # Neighbours overlap at their joint, these also across the one between them.
    for first, second in _TOUCHING:
        spec.add_exclude(name=f"{first} {second}", bodyname1=first, bodyname2=second)


def _add_hand(spec: mujoco.MjSpec, flange: mujoco.MjsBody, gripper: GripperConfig, contact: dict[str, object]) -> None:
    """A palm whose frame lies between the fingertips: x along the flange's z, y to the left finger."""
    forward, left = np.array([0.0, 0.0, 1.0]), np.array([np.cos(_MOUNT), np.sin(_MOUNT), 0.0])
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.stack([forward, left, np.cross(forward, left)], axis=1).ravel())
    reach = _PALM + gripper.finger_length
    hand = flange.add_body(name="hand", pos=[0, 0, reach], quat=quaternion, gravcomp=1)
    hand.add_geom(
        name="palm", type=mujoco.mjtGeom.mjGEOM_BOX, size=[_PALM / 2, 0.05, 0.03],
        pos=[-gripper.finger_length - _PALM / 2, 0, 0], mass=gripper.mass, rgba=[*palette.STEEL, 1.0], **contact,
    )  # fmt: skip
    hand.add_site(name="grasp")


@dataclass(frozen=True, eq=False)
class Path:
    """What the joints do to take the hand along set points, one a control period."""

    point: Float[np.ndarray, "knot 3"]
    speed: Float[np.ndarray, "knot 3"]
    joint: Float[np.ndarray, "knot 7"]
    velocity: Float[np.ndarray, "knot 7"]


class Kinematics:
    """Joint angles for a place of the hand, which always points along the world's x with its left finger at +y.

    Solved by differential inverse kinematics (mink): of all ways to bend the elbow the one near the home posture.
    """

    def __init__(self, arm: ArmConfig, gripper: GripperConfig) -> None:
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        _add_hand(spec, add_arm(spec, np.array(arm.base), arm.yaw, {}), gripper, {})
        self._configuration = mink.Configuration(spec.compile())
        model = self._configuration.model
        self._place = mink.FrameTask("grasp", "site", position_cost=1.0, orientation_cost=0.3)
        posture = mink.PostureTask(model, cost=1e-3)
        posture.set_target(np.array(arm.posture))
        self._tasks = [self._place, posture]
        self._limits = [mink.ConfigurationLimit(model)]
        self._data = mujoco.MjData(model)
        self.home = self._solved(np.array(arm.home), np.array(arm.posture), iterations=400)

    def __deepcopy__(self, memo: dict[int, Any]) -> "Kinematics":
        """Itself: between two calls it holds nothing that the next one does not set."""
        return self

    def path(
        self, start: Float[np.ndarray, "7"], point: Float[np.ndarray, "knot 3"], velocity: Float[np.ndarray, "knot 3"]
    ) -> Path:
        """The joints' way along set points of the hand [m] with its velocities there [m/s].

        Raises:
            UnreachableError: a point is out of reach, or a joint would be too fast on the way.
        """
        joint, rate = np.empty((len(point), JOINTS)), np.empty((len(point), JOINTS))
        before = start
        for k, (where, speed) in enumerate(zip(point, velocity, strict=True)):
            joint[k] = before = self._solved(where, before)
            jacobian = self._configuration.get_frame_jacobian("grasp", "site")
            # The site's axes are the world's, so the twist needs no turning.
            rate[k] = np.linalg.lstsq(jacobian, np.concatenate([speed, np.zeros(3)]), rcond=None)[0]
        between = np.diff(joint, axis=0, prepend=start[None]) / PERIOD
        fastest = np.maximum(np.abs(between), np.abs(rate)) / limits("speed")
        if (fastest > 1).any():
            k, worst = np.unravel_index(fastest.argmax(), fastest.shape)
            raise UnreachableError(
                f"joint {worst + 1} would move at {fastest[k, worst]:.2f} of its speed limit on the way to "
                f"{_text(point[k])} m; allowed: at most 1"
            )
        return Path(point, velocity, joint, rate)

    def place(self, joint: Float[np.ndarray, "7"]) -> Float[np.ndarray, "3"]:
        """Where these joint angles take the point between the fingertips [m]."""
        self._configuration.update(joint)
        return self._configuration.get_transform_frame_to_world("grasp", "site").translation()

    def torque(
        self, joint: Float[np.ndarray, "7"], velocity: Float[np.ndarray, "7"], acceleration: Float[np.ndarray, "7"]
    ) -> Float[np.ndarray, "7"]:
        """What this motion takes, gravity apart [N m]: the arm's inverse dynamics."""
        data = self._data
        data.qpos[:], data.qvel[:], data.qacc[:] = joint, velocity, acceleration
        mujoco.mj_inverse(self._configuration.model, data)
        return data.qfrc_inverse - data.qfrc_constraint

    def _solved(
        self, where: Float[np.ndarray, "3"], near: Float[np.ndarray, "7"], iterations: int = _ITERATIONS
    ) -> Float[np.ndarray, "7"]:
        configuration = self._configuration
        configuration.update(near)
        self._place.set_target(mink.SE3.from_translation(where))
        error = np.full(6, np.inf)
        for _ in range(iterations):
            step = mink.solve_ik(configuration, self._tasks, 1.0, "daqp", damping=1e-9, limits=self._limits)
            configuration.integrate_inplace(np.clip(step, -0.3, 0.3), 1.0)
            error = self._place.compute_error(configuration)
            if np.abs(error[:3]).max() < _REACHED and np.abs(error[3:]).max() < _ALIGNED:
                return configuration.q.copy()
        raise UnreachableError(
            f"the arm cannot take the hand to {_text(where)} m: the best is {np.linalg.norm(error[:3]) * 1e3:.2g} mm "
            f"and {np.degrees(np.linalg.norm(error[3:])):.2g} degrees away"
        )


def _text(point: Float[np.ndarray, "3"]) -> str:
    return "({:.3f}, {:.3f}, {:.3f})".format(*point)


class Arm(Fingers):
    """The arm of a `World` whose scene has one, with its hand. Positions are those of the point between the
    fingertips; forces are in the gripper's frame, whose axes are the world's but for the arm's bending."""

    def __init__(self, world: World, arm: ArmConfig, gripper: GripperConfig) -> None:
        super().__init__(world, gripper)
        model = world.model
        self._kinematics = Kinematics(arm, gripper)
        self._drives = [model.actuator(f"joint_{i + 1}").id for i in range(JOINTS)]
        self._qpos = qpos = [model.joint(f"joint_{i + 1}").qposadr[0] for i in range(JOINTS)]
        self._qvel = [model.joint(f"joint_{i + 1}").dofadr[0] for i in range(JOINTS)]
        self._stiffness, self._damping = limits("stiffness"), limits("damping")
        world.data.qpos[qpos] = self._kinematics.home
        world.data.ctrl[self._drives] = self._kinematics.home
        mujoco.mj_forward(model, world.data)
        self._joints = SetPoint(self._kinematics.home)
        self._line = SetPoint(self.position)

    @property
    def set_point(self) -> Float[np.ndarray, "3"]:
        """Where the running period ends [m]."""
        return self._line.knot

    def error(self, part: float) -> tuple[float, float]:
        """How far the hand is from where it should be at `part` (0 to 1) of the running period: across its way and
        along it [m]."""
        where, velocity, _ = self._line.at(part)
        off, speed = self.position - where, np.linalg.norm(velocity)
        along = float(off @ velocity / speed) if speed > _MOVING else 0.0
        across = off - along * velocity / speed if speed > _MOVING else off
        return float(np.linalg.norm(across)), abs(along)

    def plan(self, point: Float[np.ndarray, "knot 3"], velocity: Float[np.ndarray, "knot 3"]) -> Path:
        """The joints' way from the present set point along others, one a control period.

        Raises:
            UnreachableError: before anything moves.
        """
        return self._kinematics.path(self._joints.knot, point, velocity)

    def begin_knot(self, path: Path, k: int) -> None:
        """Start the control period that ends at a path's knot."""
        self._joints.begin(path.joint[k], path.velocity[k])
        self._line.begin(path.point[k], path.speed[k])

    def begin(self, displacement: Float[np.ndarray, "3"]) -> None:
        """Start a control period at whose end the set point is to be `displacement` [m] further on.

        Raises:
            UnreachableError: it cannot get there; nothing has changed then.
        """
        way = np.asarray(displacement, float)
        self.begin_knot(self.plan((self.set_point + way)[None], (way / PERIOD)[None]), 0)

    def stop(self, part: float) -> None:
        """Stay at once where the arm is to be at `part` of the running period."""
        self._joints.stop(part)
        self._line.stop(part)

    def drive(self, part: float) -> None:
        """Command the joints for the physics step that begins at `part` (0 to 1) of the running period.

        The controller's damping and the arm's inverse dynamics are fed forward: a motion as planned has no lag.
        """
        position, velocity, acceleration = self._joints.at(part)
        forward = self._damping * velocity + self._kinematics.torque(position, velocity, acceleration)
        self._world.data.ctrl[self._drives] = position + forward / self._stiffness

    def remember(self) -> tuple[SetPoint, ...]:
        """The set points between two periods, for `recall`."""
        return copy(self._joints), copy(self._line)

    def recall(self, memory: tuple[SetPoint, ...]) -> None:
        self._joints, self._line = copy(memory[0]), copy(memory[1])

    def take_up_rest(self) -> None:
        """Find the set points of an arm that was put to rest some periods ago in the state of its drives."""
        joint = self._world.data.ctrl[self._drives]
        self._joints.stand(joint, np.zeros(JOINTS))
        self._line.stand(self._kinematics.place(joint), np.zeros(3))

    def forget(self, moving: bool) -> None:
        """Take the set points to be where the arm is, going on as fast as it goes; or else stop arm and set points."""
        data = self._world.data
        if not moving:
            data.qvel[self._qvel] = 0.0
        joint, rate = data.qpos[self._qpos], data.qvel[self._qvel]
        self._joints.stand(joint, rate)
        place = self._kinematics.place(joint)
        ahead = self._kinematics.place(joint + rate * PERIOD)
        self._line.stand(place, (ahead - place) / PERIOD)
