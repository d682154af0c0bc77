"""The robot's workplace around the tower: arm and hand, turntable, push-stick in its holder, and a tray."""

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from jenga_data import palette
from jenga_data.episode import RobotModel, RobotState
from jenga_data.scenery import TABLE_TOP
from jenga_data.sim.arm import Arm, add_robot
from jenga_data.sim.panda import JOINTS, limits
from jenga_data.sim.physics import ArmConfig, GripperConfig, PhysicsConfig
from jenga_data.sim.scene import wood_contact
from jenga_data.sim.solids import link_of
from jenga_data.sim.turntable import Turntable
from jenga_data.sim.world import World

STICK_LENGTH = 0.14
STICK_WIDTH = 0.008
"""A square rod [m], thinner than a block is high: it can follow a block into its slot."""
_STICK_MASS = 0.006
STICK_PLACE = np.array([-0.17, -0.16, 0.02])
"""The stick's middle in its holder [m]; it lies along x."""
STICK_GRIP = 0.012
"""The fingers hold it so far from its rear end [m]."""
STICK_REACH = STICK_LENGTH - STICK_GRIP
"""From the fingertips' middle to the stick's tip [m]."""
TRAY = np.array([-0.24, 0.12, -0.035])
"""Middle of the tray's top [m]: pulled blocks are put down there."""
_TRAY_SIZE = np.array([0.07, 0.05])
_LINKS = (
    *(f"link_{i}" for i in range(JOINTS + 1)), "flange", "hand", "left_finger", "right_finger", "stick", "holder",
    "tray",
)  # fmt: skip


def add_workplace(spec: mujoco.MjSpec, arm: ArmConfig, gripper: GripperConfig, physics: PhysicsConfig) -> None:
    """Add the arm, the free body `stick` in the fixed `holder`, and the `tray`."""
    add_robot(spec, arm, gripper, physics)
    contact = wood_contact(physics)
    steel = {"type": mujoco.mjtGeom.mjGEOM_BOX, "rgba": [*palette.STEEL, 1.0], **contact}
    stick = spec.worldbody.add_body(name="stick", pos=STICK_PLACE)
    stick.sleep = mujoco.mjtSleepPolicy.mjSLEEP_ALLOWED
    stick.add_freejoint(name="stick")
    stick.add_geom(
        name="stick", type=mujoco.mjtGeom.mjGEOM_BOX, size=[STICK_LENGTH / 2, STICK_WIDTH / 2, STICK_WIDTH / 2],
        mass=_STICK_MASS, rgba=[*palette.ORANGE, 1.0], **contact,
    )  # fmt: skip
    holder = spec.worldbody.add_body(name="holder", pos=[*STICK_PLACE[:2], TABLE_TOP])
    seat = STICK_PLACE[2] - STICK_WIDTH / 2 - TABLE_TOP
    wall, gap = 0.003, STICK_WIDTH / 2 + 0.0015
    for k, x in enumerate((-0.01, 0.05)):
        holder.add_geom(name=f"holder_{k}", pos=[x, 0, seat / 2], size=[0.006, 0.012, seat / 2], **steel)
        for side in (-1, 1):
            holder.add_geom(
                name=f"holder_{k}_{'left' if side > 0 else 'right'}", pos=[x, side * (gap + wall), seat + 0.006],
                size=[0.006, wall, 0.006], **steel,
            )  # fmt: skip
    tray = spec.worldbody.add_body(name="tray", pos=[*TRAY[:2], TABLE_TOP])
    height = TRAY[2] - TABLE_TOP
    tray.add_geom(name="tray", pos=[0, 0, height / 2], size=[*_TRAY_SIZE / 2, height / 2], **steel)


class Robot:
    """The robot of a `World` whose scene has a workplace."""

    def __init__(self, world: World, arm: ArmConfig, gripper: GripperConfig) -> None:
        self.world = world
        self.arm = Arm(world, arm, gripper)
        self.turntable = Turntable(world)
        model = world.model
        self._bodies = [model.body(name).id for name in _LINKS]
        self._joints = tuple(f"joint_{i + 1}" for i in range(JOINTS))
        self._qpos = [model.joint(name).qposadr[0] for name in self._joints]
        self._qvel = [model.joint(name).dofadr[0] for name in self._joints]
        self._stick = model.body("stick").id
        self._own = self._geoms_of(*_LINKS[1 : JOINTS + 3])
        self._fixed = self._geoms_of("world", "link_0", "holder", "tray", "turntable")

    def model(self) -> RobotModel:
        links = tuple(link_of(self.world.model, name) for name in _LINKS)
        return RobotModel(self._joints, links)

    def state(self) -> RobotState:
        data, now = self.world.data, self.world.kinematics()
        return RobotState(
            position=data.qpos[self._qpos],
            velocity=data.qvel[self._qvel],
            torque=data.qfrc_actuator[self._qvel],
            link_pose=np.concatenate([now.xpos[self._bodies], now.xquat[self._bodies]], axis=1),
        )

    def _geoms_of(self, *bodies: str) -> Bool[np.ndarray, " geom"]:
        model = self.world.model
        return np.isin(model.geom_bodyid, [model.body(name).id for name in bodies])

    @property
    def stick(self) -> Float[np.ndarray, "3"]:
        """Where the stick's middle is [m]."""
        return self.world.kinematics().xpos[self._stick].copy()

    def collides(self) -> bool:
        """Whether a link of the arm touches another, or something that stands on the table."""
        geom = self.world.data.contact.geom
        own = self._own[geom]
        return bool((own.all(1) | (own.any(1) & self._fixed[geom].any(1))).any())

    def margins(self) -> dict[str, float]:
        """How near the joints are to the maker's limits: degrees from the nearest end, shares of speed and torque."""
        state = self.state()
        ends = np.minimum(state.position - limits("lower"), limits("upper") - state.position)
        return {
            "angle": float(np.degrees(ends.min())),
            "speed": float((np.abs(state.velocity) / limits("speed")).max()),
            "torque": float((np.abs(state.torque) / limits("torque")).max()),
        }
