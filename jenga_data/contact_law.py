"""The normal force of a contact point at rest, as MuJoCo's soft constraints have it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class ContactLaw:
    """Force over the effective mass m1 m2 / (m1 + m2) of the two bodies [m/s^2], as a function of how deep they sink.

    At rest a constraint's force f obeys R f = k r with R = (1 - d) / d * (1/m1 + 1/m2) and
    k = d / (d_full * time constant * damping ratio)^2, and the impedance d grows from `touch` to `full` over `width`
    along two parabolas (MuJoCo, chapter "Computation", constraint model; chapter "Modeling", solver parameters).
    With touch = full it is a linear spring.
    """

    rate: float
    """1 / (d_full * time constant * damping ratio)^2 [1/s^2]."""
    touch: float
    full: float
    width: float
    """[m]"""

    @classmethod
    def linear(cls, stiffness: float) -> "ContactLaw":
        """A spring of `stiffness` over the effective mass [1/s^2]."""
        return cls(rate=2 * stiffness, touch=0.5, full=0.5, width=1.0)

    def force(self, sink: Float[np.ndarray, " contact"]) -> Float[np.ndarray, " contact"]:
        """Zero where nothing sinks."""
        sink = np.maximum(0.0, sink)
        d, _ = self._impedance(sink)
        return self.rate * d**2 / (1 - d) * sink

    def stiffness(self, sink: Float[np.ndarray, " contact"]) -> Float[np.ndarray, " contact"]:
        """Derivative of `force` [1/s^2]."""
        d, slope = self._impedance(np.maximum(0.0, sink))
        tangent = d**2 / (1 - d) + d * (2 - d) / (1 - d) ** 2 * slope * np.maximum(0.0, sink)
        return np.where(sink > 0, self.rate * tangent, 0.0)

    def _impedance(
        self, sink: Float[np.ndarray, " contact"]
    ) -> tuple[Float[np.ndarray, " contact"], Float[np.ndarray, " contact"]]:
        """d and its derivative by the depth."""
        x = np.minimum(sink / self.width, 1.0)
        y = np.where(x < 0.5, 2 * x**2, 1 - 2 * (1 - x) ** 2)
        slope = np.where(x < 0.5, 4 * x, 4 * (1 - x)) / self.width
        return self.touch + (self.full - self.touch) * y, (self.full - self.touch) * slope
