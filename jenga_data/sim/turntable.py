"""Turning the table under a sleeping tower: smoothly, and rigidly with all that stands on it.

Soft contacts creep under the changing forces of a turn, which real wood does not do. So the tower sleeps while it is
turned and keeps its place on the table to the last bit. What that leaves out is the friction that the acceleration
needs: `friction_needed`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil

import numpy as np
from jaxtyping import Float

from jenga_data.clock import CONTROL_STEP_NS
from jenga_data.friction import friction_share
from jenga_data.scenery import TURNTABLE_RADIUS
from jenga_data.sim.physics import PhysicsConfig
from jenga_data.sim.world import World
from jenga_data.statics import PlanarPose, solve
from jenga_data.tower import TowerState, turn_poses

TURN_SECONDS = 4.0
"""For half a turn [s]."""
_INSTANTS = 17
"""At which a profile's need of friction is looked at."""


@dataclass(frozen=True)
class MinimumJerk:
    """A turn by `angle` [rad] within `seconds` [s], at rest before and after it.

    phi(t) = angle (10 s^3 - 15 s^4 + 6 s^5) with s = t / seconds is the motion between two points at rest whose
    squared jerk, integrated over time, is least (Flash and Hogan 1985, J. Neurosci. 5(7), 1688-1703, eq. 3). Rate and
    acceleration are zero at both ends; the largest are 1.875 angle / seconds and 5.774 angle / seconds^2.
    """

    angle: float
    seconds: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.angle) and 0 < self.seconds < np.inf):
            raise ValueError(f"a turn by {self.angle} rad in {self.seconds} s; allowed: finite, and more than 0 s")

    def at(self, time: float) -> tuple[float, float, float]:
        """Angle [rad], rate [rad/s] and acceleration [rad/s^2] at `time` [s] since the start."""
        s = min(max(time / self.seconds, 0.0), 1.0)
        return (
            self.angle * (10 - 15 * s + 6 * s * s) * s**3,
            self.angle * 30 * s**2 * (1 - s) ** 2 / self.seconds,
            self.angle * 60 * s * (1 - s) * (1 - 2 * s) / self.seconds**2,
        )


class WokenError(ValueError):
    """Something touched the tower while the table turned."""


class Turntable:
    """The turntable of a `World`."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._drive = world.model.actuator("turntable").id
        _, stiffness, damping = -world.model.actuator("turntable").biasprm[:3]
        self._lead = damping / stiffness  # [s]
        inertia = world.model.dof_M0[world.model.joint("turntable").dofadr[0]]  # of rotor and table
        self._inertia = inertia / stiffness  # [s^2]

    @property
    def angle(self) -> float:
        """[rad]"""
        return self._world.table_angle

    @property
    def set_point(self) -> float:
        """Where the drive holds the table [rad]; while it turns, what makes it follow: its lag is fed forward."""
        return float(self._world.data.ctrl[self._drive])

    def turn(self, angle: float, seconds: float = TURN_SECONDS) -> Iterator[None]:
        """Turn table and tower by `angle` [rad], one physics step each time the iterator is asked.

        A step steps the world, so that whatever is awake moves on; at the end of every control step table and blocks
        are put where the profile has them then, rotated from where they were at the start. The state is that of a
        table which turns: poses, twists, and a set point whose drive keeps up the motion's acceleration. After the
        last step all is at rest and asleep, and the drive holds the new angle. With `Recording.advance`:

            motion = turntable.turn(np.pi)
            for _ in range(whole_frames(TURN_SECONDS)):
                recording.advance(lambda _: next(motion), steps_a_frame)

        Args:
            seconds: how long it takes, rounded up to whole control steps.

        Raises:
            ValueError: a block is awake or does not stand on the turntable.
            WokenError: later, at the end of a control step: a block was woken by a touch.
        """
        self._check()
        return self._steps(MinimumJerk(angle, whole_frames(seconds) * CONTROL_STEP_NS * 1e-9))

    def _check(self) -> None:
        if awake := self._world.awake_blocks:
            raise ValueError(f"blocks {awake} are awake; allowed: a tower that sleeps, see World.allow_sleep")
        where = self._world.pose[:, :3]
        beside = np.flatnonzero((np.linalg.norm(where[:, :2], axis=1) > TURNTABLE_RADIUS) | (where[:, 2] < 0))
        if len(beside):
            raise ValueError(f"blocks {beside.tolist()} lie beside the turntable; they would not turn with it")

    def _steps(self, profile: MinimumJerk) -> Iterator[None]:
        world = self._world
        pose, table, set_point = world.pose, self.angle, self.set_point
        timestep = world.model.opt.timestep
        count = round(profile.seconds / timestep)
        every = round(CONTROL_STEP_NS * 1e-9 / timestep)
        for k in range(1, count + 1):
            world.halt()
            world.step()
            if k % every:
                yield
                continue
            if awake := world.awake_blocks:
                raise WokenError(f"blocks {awake} were woken while the table turned: something touched them")
            angle, rate, acceleration = profile.at(k / count * profile.seconds)
            turned = turn_poses(pose, angle)
            world.move_asleep(turned, turning(turned, rate), (table + angle, rate))
            world.data.ctrl[self._drive] = set_point + angle + self._lead * rate + self._inertia * acceleration
            if k == count:
                world.halt()  # a rate of -0.0 would wake the tower
            yield


def whole_frames(seconds: float) -> int:
    """Control steps that `seconds` take, the last one begun counted as whole."""
    return ceil(seconds * 1e9 / CONTROL_STEP_NS - 1e-6)


def turning(pose: Float[np.ndarray, "block 7"], rate: float) -> Float[np.ndarray, "block 6"]:
    """Twists [m/s, rad/s] of bodies that turn about the world's z at `rate` [rad/s]."""
    twist = np.zeros((len(pose), 6))
    twist[:, 0], twist[:, 1], twist[:, 5] = -rate * pose[:, 1], rate * pose[:, 0], rate
    return twist


def friction_needed(state: TowerState, profile: MinimumJerk, physics: PhysicsConfig) -> float:
    """The share of the friction that is there which a turn needs to carry the tower along; from 1 on it would slide.

    This is what turning a tower rigidly leaves out. At an instant of the profile a block at r from the axis needs the
    tangential acceleration alpha r and the centripetal omega^2 r, and alpha about its own centre; `friction_share`
    distributes the forces over the contacts. The largest share over the profile's instants is returned.

    Args:
        state: a tower at rest whose blocks lie along x or y, that is, turned by a multiple of 90 degrees.

    Raises:
        ValueError: the tower is in no equilibrium by computation, so that its normal forces are not known.
    """
    w, x, y, z = state.pose[:, 3:].T
    planar = PlanarPose(state.pose[:, :2], np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    rest = solve(state.blocks, state.layout, planar, physics.contact_law)
    if not rest.stands:
        raise ValueError("this tower is in no equilibrium by computation")
    most = 0.0
    for time in np.linspace(0.0, profile.seconds, _INSTANTS):
        _, rate, alpha = profile.at(float(time))
        across = np.stack([-planar.xy[:, 1], planar.xy[:, 0]], axis=1)
        acceleration = alpha * across - rate**2 * planar.xy
        spin = np.full(len(state.blocks), alpha)
        most = max(most, friction_share(state.blocks, planar, rest, acceleration, spin, physics.friction))
    return most
