"""A force-capped velocity servo on one block: the pull of the selection data, without a robot."""

import numpy as np
from jaxtyping import Float

from jenga_data.sim.world import World


class BlockServo:
    """Pushes at a block's centre so that it keeps a commanded velocity, with no more force than allowed.

    Proportional and integral action, F = clip(k_p e + k_i ∫ e dt) with e the velocity error, so that friction leaves
    no lasting error; the integral stops at the cap. It acts once a physics step and is stable for a free block while
    k_p dt / m < 1 and k_i dt^2 / m << 1. A velocity actuator of MuJoCo is not: where its force is capped its damping
    is no longer implicit, and with a gain that reaches the cap it throws a free block to and fro.
    """

    def __init__(
        self, world: World, block: int, gains: tuple[float, float], force_limit: Float[np.ndarray, "3"]
    ) -> None:
        """Args:
        gains: k_p [N s/m] and k_i [N/m].
        force_limit: cap along the world's x, y, z [N].
        """
        self._world = world
        self._body = world.model.body(f"block_{block}").id
        first = int(world.model.body(f"block_{block}").dofadr[0])
        self._velocity = slice(first, first + 3)
        self._gains = gains
        self._limit: list[float] = np.asarray(force_limit, float).tolist()
        self._integral = [0.0, 0.0, 0.0]
        self._wanted = [0.0, 0.0, 0.0]
        self._on = True
        self.force = np.zeros(3)
        """What it exerts at present [N]."""

    def command(self, velocity: Float[np.ndarray, "3"]) -> None:
        """The velocity to keep from now on [m/s]."""
        self._wanted = np.asarray(velocity, float).tolist()

    def let_go(self) -> None:
        """Exert no force from now on."""
        self._on = False
        self.force = np.zeros(3)
        self._world.data.xfrc_applied[self._body] = 0.0

    def step(self) -> None:
        """One physics step with the servo's force."""
        if self._on:
            self.force = np.array(self._force())
            self._world.data.xfrc_applied[self._body, :3] = self.force
        self._world.step()

    def _force(self) -> list[float]:
        """The force of this step [N]. Plain numbers: for three of them numpy takes ten times as long."""
        k_p, k_i = self._gains
        gain = k_i * self._world.model.opt.timestep
        force = []
        velocity = self._world.data.qvel[self._velocity].tolist()
        for axis, (wanted, now, limit) in enumerate(zip(self._wanted, velocity, self._limit, strict=True)):
            error = wanted - now
            self._integral[axis] = _clip(self._integral[axis] + gain * error, limit)
            force.append(_clip(k_p * error + self._integral[axis], limit))
        return force


def _clip(value: float, limit: float) -> float:
    """What is no number stays none, so that broken physics are seen."""
    return min(max(value, -limit), limit)
