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
        return self.force_and_stiffness(sink)[0]

    def stiffness(self, sink: Float[np.ndarray, " contact"]) -> Float[np.ndarray, " contact"]:
        """Derivative of `force` [1/s^2]."""
        return self.force_and_stiffness(sink)[1]

    def force_and_stiffness(
        self, sink: Float[np.ndarray, " contact"]
    ) -> tuple[Float[np.ndarray, " contact"], Float[np.ndarray, " contact"]]:
        """Both at once: where one is needed, the other costs little."""
        deep = np.maximum(0.0, sink)
        d, slope = self._impedance(deep)
        secant = self.rate * d**2 / (1 - d)
        tangent = secant + self.rate * d * (2 - d) / (1 - d) ** 2 * slope * deep
        return secant * deep, np.where(sink > 0, tangent, 0.0)

    def _impedance(
        self, sink: Float[np.ndarray, " contact"]
    ) -> tuple[Float[np.ndarray, " contact"], Float[np.ndarray, " contact"]]:
        """d and its derivative by the depth."""
        x = np.minimum(sink / self.width, 1.0)
        rising, rest = x < 0.5, 1.0 - x
        y = np.where(rising, 2 * x**2, 1 - 2 * rest**2)
        grown = self.full - self.touch
        return self.touch + grown * y, 4 * grown / self.width * np.where(rising, x, rest)
