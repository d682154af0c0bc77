"""A running simulation. What leaves this file is the caller's own copy: MuJoCo's arrays are views that change."""

from collections.abc import Callable
from copy import copy, deepcopy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from jenga_data.blocks import Blocks
from jenga_data.episode import LEFT_FINGER, RIGHT_FINGER, ROBOT, TABLE, Contacts
from jenga_data.geometry import rotation_matrices
from jenga_data.sim.scene import TOP
from jenga_data.tower import Layout, TowerState, turn_poses

_SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
_DERIVED = (
    "xpos", "xquat", "xmat", "xipos", "ximat", "xanchor", "xaxis", "geom_xpos", "geom_xmat", "subtree_com", "cinert",
    "cdof",
)  # fmt: skip
"""What `mj_kinematics` and `mj_comPos` make of the positions of bodies and geoms."""
STATE_SPEC = int(mujoco.mjtState.mjSTATE_INTEGRATION)


_SAME_PLACE = 1e-9
"""What sleeps and has moved by less [m] has not moved."""


@dataclass(frozen=True, eq=False)
class _Resting:
    """The contacts of what sleeps, as they were when the turntable was at `table` [rad]."""

    asleep: Bool[np.ndarray, " block"]
    pose: Float[np.ndarray, "sleeper 7"]
    table: float
    contacts: Contacts

    def turned(self, angle: float) -> Contacts:
        """What they are now that all of it was turned rigidly."""
        cos, sin = np.cos(angle), np.sin(angle)
        force = self.contacts.force @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return Contacts(self.contacts.first, self.contacts.second, force if angle else self.contacts.force)


class World:
    """A compiled scene with a tower in it, and its state."""

    def __init__(self, spec: mujoco.MjSpec, blocks: Blocks, layout: Layout) -> None:
        self.spec = spec
        self.blocks = blocks
        self.layout = layout
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        joints = [self.model.joint(f"block_{i}") for i in range(len(blocks))]
        self._qpos = np.array([j.qposadr[0] for j in joints])[:, None] + np.arange(7)
        self._qvel = np.array([j.dofadr[0] for j in joints])[:, None] + np.arange(6)
        self._tree = self.model.body_treeid[[self.model.body(f"block_{i}").id for i in range(len(blocks))]]
        self._geom_id = _ids_of_geoms(self.model)
        self._state_size = mujoco.mj_stateSize(self.model, STATE_SPEC)
        self._rest: _Resting | None = None

    def __deepcopy__(self, memo: dict[int, Any]) -> "World":
        """A world that goes on from this moment by itself, to the same bytes, sleep included.

        A state vector would not do: what sleeps, and how long it has been quiet, is no part of it.
        """
        twin = self.__new__(type(self))
        memo[id(self)] = twin
        shared = {"spec", "blocks", "layout"}  # nobody changes them; `_elsewhere` is scratch, and made when needed
        for name, value in self.__dict__.items():
            if name in ("model", "data"):
                twin.__dict__[name] = copy(value)
            elif name != "_elsewhere":
                twin.__dict__[name] = value if name in shared else deepcopy(value, memo)
        return twin

    def step(self, count: int = 1) -> None:
        mujoco.mj_step(self.model, self.data, nstep=count)

    def allow_sleep(self, allowed: bool) -> None:
        """Let a tower that has come to rest sleep, or wake everything. A sleeping tower does not creep and costs
        almost nothing to step, but one that is slowly on its way to fall would be frozen too: allow it only after
        the tower was seen to be quiet while awake."""
        if allowed:
            self.model.opt.enableflags |= _SLEEP
        else:
            self.model.opt.enableflags &= ~_SLEEP

    @property
    def asleep(self) -> bool:
        """Whether every block sleeps."""
        return bool(self._asleep().all())

    @property
    def awake_blocks(self) -> list[int]:
        """Numbers of the blocks that do not sleep."""
        return np.flatnonzero(~self._asleep()).tolist()

    def _asleep(self) -> Bool[np.ndarray, " block"]:
        return self.data.tree_asleep[self._tree] >= 0

    @property
    def time_ns(self) -> int:
        """Simulated time as a whole number of steps, exact."""
        step_ns = round(self.model.opt.timestep * 1e9)
        return round(self.data.time * 1e9 / step_ns) * step_ns

    @property
    def pose(self) -> Float[np.ndarray, "block 7"]:
        return self.data.qpos[self._qpos].copy()

    @property
    def block_qpos(self) -> Int[np.ndarray, "block 7"]:
        """Where the blocks' poses stand in MuJoCo's `qpos`."""
        return self._qpos.copy()

    @property
    def table_angle(self) -> float:
        """Of the turntable [rad]."""
        return float(self.data.joint("turntable").qpos[0])

    @property
    def twist(self) -> Float[np.ndarray, "block 6"]:
        """Velocities in the world: MuJoCo keeps the angular part of a free joint in the body's frame."""
        velocity = self.data.qvel[self._qvel]
        rotation = rotation_matrices(self.data.qpos[self._qpos][:, 3:])
        return np.concatenate([velocity[:, :3], np.einsum("bij,bj->bi", rotation, velocity[:, 3:])], axis=1)

    def set_tower(self, pose: Float[np.ndarray, "block 7"]) -> None:
        """Put the blocks somewhere, at rest."""
        self.data.qpos[self._qpos] = pose
        self.data.qvel[self._qvel] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def set_twist(self, twist: Float[np.ndarray, "block 6"]) -> None:
        """Give the blocks other velocities, in the world as of `twist` [m/s, rad/s]."""
        rotation = rotation_matrices(self.data.qpos[self._qpos][:, 3:])
        self.data.qvel[self._qvel[:, :3]] = twist[:, :3]
        self.data.qvel[self._qvel[:, 3:]] = np.einsum("bji,bj->bi", rotation, twist[:, 3:])
        mujoco.mj_forward(self.model, self.data)

    def move_asleep(
        self, pose: Float[np.ndarray, "block 7"], twist: Float[np.ndarray, "block 6"], table: tuple[float, float]
    ) -> None:
        """Put the sleeping tower and its turntable somewhere without waking them.

        MuJoCo wakes what it finds at another place than it computed last, or with a velocity, when it steps. So the
        derived positions are computed apart and put in place here; the velocities are for whoever reads the state,
        and have to be taken away (`halt`) before the next step.

        Args:
            pose: where the blocks are.
            twist: velocities in the world, as of `twist` [m/s, rad/s].
            table: angle [rad] and rate [rad/s] of the turntable.
        """
        data = self.data
        rotation = rotation_matrices(pose[:, 3:])
        data.qpos[self._qpos] = pose
        data.qvel[self._qvel[:, :3]] = twist[:, :3]
        data.qvel[self._qvel[:, 3:]] = np.einsum("bji,bj->bi", rotation, twist[:, 3:])
        data.joint("turntable").qpos[0], data.joint("turntable").qvel[0] = table
        derived = self.kinematics()
        mujoco.mj_comPos(self.model, derived)
        for name in _DERIVED:
            getattr(data, name)[:] = getattr(derived, name)

    def kinematics(self) -> mujoco.MjData:
        """Where bodies, geoms and sites are at this moment; `data` has them one physics step late. Valid until it is
        asked for again."""
        self._elsewhere.qpos[:] = self.data.qpos
        flags = self.model.opt.enableflags
        self.allow_sleep(False)
        mujoco.mj_kinematics(self.model, self._elsewhere)
        self.model.opt.enableflags = flags
        return self._elsewhere

    @cached_property
    def _elsewhere(self) -> mujoco.MjData:
        return mujoco.MjData(self.model)

    def halt(self) -> None:
        """Take the velocities of the blocks and the turntable away."""
        self.data.qvel[self._qvel] = 0.0
        self.data.joint("turntable").qvel[0] = 0.0

    def tower_state(self) -> TowerState:
        return TowerState(self.blocks, self.layout, self.pose, self.twist)

    def contacts(self) -> Contacts:
        """Touching pairs that involve a block, with the summed force that `second` exerts on `first`.

        MuJoCo finds no contacts between what sleeps: those are what they would be if it woke up.
        """
        found = self._contacts(self.data)
        asleep = self._asleep()
        if not asleep.any():
            return found
        resting = self._resting_contacts(asleep)
        first, second = np.append(found.first, resting.first), np.append(found.second, resting.second)
        order = np.lexsort((second, first))
        return Contacts(first[order], second[order], np.concatenate([found.force, resting.force])[order])

    def _resting_contacts(self, asleep: Bool[np.ndarray, " block"]) -> Contacts:
        """Contacts between sleeping blocks and with the table, computed once for each time that they fall asleep."""
        table, where = self.table_angle, self.pose[asleep]
        if self._rest is not None and np.array_equal(self._rest.asleep, asleep):
            angle = table - self._rest.table
            if np.allclose(turn_poses(self._rest.pose, angle)[:, :3], where[:, :3], rtol=0, atol=_SAME_PLACE):
                return self._rest.turned(angle)
        every = self._contacts(self._awake())
        among = asleep[every.first] & np.where(every.second >= 0, asleep[every.second], every.second == TABLE)
        found = Contacts(every.first[among], every.second[among], every.force[among])
        self._rest = _Resting(asleep, where, table, found)
        return found

    def _awake(self) -> mujoco.MjData:
        """This moment, computed with nothing asleep."""
        data = mujoco.MjData(self.model)
        mujoco.mj_setState(self.model, data, self.integration_state(), STATE_SPEC)
        flags = self.model.opt.enableflags
        self.allow_sleep(False)
        mujoco.mj_forward(self.model, data)
        self.model.opt.enableflags = flags
        return data

    def _contacts(self, data: mujoco.MjData) -> Contacts:
        contact = data.contact
        address = contact.efc_address
        active = address >= 0
        body = self._geom_id[contact.geom[active]]
        rows = address[active][:, None] + np.arange(3)
        local = data.efc_force[rows]  # normal, then two tangents: elliptic cones keep them as they are
        on_second = np.einsum("ca,cax->cx", local, contact.frame[active].reshape(-1, 3, 3))
        swap = body[:, 0] < body[:, 1]  # the higher id, always a block, comes first
        first = np.where(swap, body[:, 1], body[:, 0])
        second = np.where(swap, body[:, 0], body[:, 1])
        on_first = np.where(swap[:, None], on_second, -on_second)
        keep = first >= 0
        pairs, where = np.unique(np.stack([first[keep], second[keep]], 1), axis=0, return_inverse=True)
        force = np.zeros((len(pairs), 3))
        np.add.at(force, where.ravel(), on_first[keep])
        return Contacts(pairs[:, 0], pairs[:, 1], force)

    def integration_state(self) -> Float[np.ndarray, " state"]:
        """All that decides how the simulation goes on (mjSTATE_INTEGRATION)."""
        state = np.empty(self._state_size)
        mujoco.mj_getState(self.model, self.data, state, STATE_SPEC)
        return state

    def restore(self, state: Float[np.ndarray, " state"]) -> None:
        """Go back to an `integration_state`; stepping on from there repeats the same bytes, unless something may
        sleep: what sleeps, and how long it has been quiet, is no part of MuJoCo's state."""
        mujoco.mj_setState(self.model, self.data, state, STATE_SPEC)
        mujoco.mj_forward(self.model, self.data)


def _ids_of_geoms(model: mujoco.MjModel) -> np.ndarray:
    names = [model.geom(i).name for i in range(model.ngeom)]
    special = {"table": TABLE, "turntable": TABLE, "tray": TABLE, "left_pad": LEFT_FINGER, "right_pad": RIGHT_FINGER}
    return np.array(
        [
            int(n.removeprefix("block_").removesuffix(TOP)) if n.startswith("block_") else special.get(n, ROBOT)
            for n in names
        ],
        np.int64,
    )


MakeWorld = Callable[[mujoco.MjSpec, Blocks, Layout], World]
"""Compiles a scene with a tower in it."""
