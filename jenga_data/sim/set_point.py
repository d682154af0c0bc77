"""Set points that are continuous in velocity: one cubic a control period."""

import numpy as np
from jaxtyping import Float

from jenga_data.clock import CONTROL_STEP_NS

PERIOD = CONTROL_STEP_NS * 1e-9
"""One control period [s]."""


class SetPoint:
    """A point of any dimension that moves from knot to knot, one a control period.

    Between two knots it follows the cubic that has their positions and velocities (Hermite's).
    """

    def __init__(self, position: Float[np.ndarray, " axis"]) -> None:
        self.knot = np.asarray(position, float)
        """Where the running period ends."""
        self.knot_velocity = np.zeros_like(self.knot)
        self._from, self._from_velocity = self.knot, self.knot_velocity

    def begin(self, knot: Float[np.ndarray, " axis"], velocity: Float[np.ndarray, " axis"]) -> None:
        """Start a period that ends at `knot` with `velocity` [per s]."""
        self._from, self._from_velocity = self.knot, self.knot_velocity
        self.knot, self.knot_velocity = np.asarray(knot, float), np.asarray(velocity, float)

    def stand(self, position: Float[np.ndarray, " axis"], velocity: Float[np.ndarray, " axis"]) -> None:
        """Be at `position` with `velocity` [per s] when the next period starts."""
        self.knot = self._from = np.array(position, float)
        self.knot_velocity = self._from_velocity = np.array(velocity, float)

    def stop(self, part: float) -> None:
        """Stay at once where the set point is at `part` of the running period, for an emergency."""
        position, _, _ = self.at(part)
        self.knot = self._from = position
        self.knot_velocity = self._from_velocity = np.zeros_like(position)

    def at(
        self, part: float
    ) -> tuple[Float[np.ndarray, " axis"], Float[np.ndarray, " axis"], Float[np.ndarray, " axis"]]:
        """Position, velocity and acceleration at `part` (0 to 1) of the running period."""
        s, way = part, self.knot - self._from
        v0, v1 = self._from_velocity * PERIOD, self.knot_velocity * PERIOD
        square, cube = 3 * way - 2 * v0 - v1, v0 + v1 - 2 * way
        position = self._from + s * (v0 + s * (square + s * cube))
        velocity = (v0 + s * (2 * square + 3 * s * cube)) / PERIOD
        return position, velocity, (2 * square + 6 * s * cube) / PERIOD**2
