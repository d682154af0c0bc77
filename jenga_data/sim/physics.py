"""How the simulation is set up: frozen records, stored with every episode. Light to import, for the command line."""

from dataclasses import dataclass

from jenga_data.clock import CONTROL_STEP_NS, TOUCH_STEP_NS
from jenga_data.errors import JengaError


@dataclass(frozen=True)
class PhysicsConfig:
    """Solver and contact settings. Elliptic cones, Newton's method and a sparse Jacobian always."""

    timestep_ns: int = 2_000_000
    """Physics step [ns]; must divide the 4 ms between two touch samples."""
    integrator: str = "implicitfast"
    """MuJoCo integrator: discrete or implicitfast."""
    impratio: float = 3.0
    """Ratio of frictional to normal constraint impedance; higher creeps less."""
    friction: float = 0.3
    """Sliding friction of wood on wood and on the table; public simulators use 0.3 to 0.5."""
    time_constant: float = 0.01
    """Time constant of a contact [s], MuJoCo's solref[0]."""
    damping_ratio: float = 2.0
    """Damping ratio of a contact, MuJoCo's solref[1]."""
    impedance: float = 0.995
    """Constraint impedance (MuJoCo's solimp, constant over penetration, so that contacts are linear springs)."""
    sleep_tolerance: float = 1e-2
    """Speed below which a tower that may sleep falls asleep (MuJoCo's own measure, about m/s)."""

    def __post_init__(self) -> None:
        if self.timestep_ns <= 0 or TOUCH_STEP_NS % self.timestep_ns:
            raise JengaError(
                f"physics.timestep-ns is {self.timestep_ns}; allowed: a divisor of {TOUCH_STEP_NS}, e.g. 2000000"
            )
        if self.integrator not in ("discrete", "implicitfast"):
            raise JengaError(f"physics.integrator is {self.integrator!r}; allowed: discrete, implicitfast")
        if self.friction <= 0 or self.impratio <= 0:
            raise JengaError("physics.friction and physics.impratio must be positive")
        if not 0 < self.impedance < 1:
            raise JengaError(f"physics.impedance is {self.impedance}; allowed: between 0 and 1, e.g. 0.995")

    @property
    def contact_stiffness(self) -> float:
        """Spring constant of a contact point over the effective mass of the two bodies [1/s^2].

        At rest a constraint's force f obeys R f = k r with R = (1 - d) / d * (1/m1 + 1/m2) and
        k = 1 / (d * time_constant * damping_ratio)^2 (MuJoCo, "Computation", constraint model).
        """
        d = self.impedance
        return d / (1 - d) / (d * self.time_constant * self.damping_ratio) ** 2

    @property
    def steps_a_frame(self) -> int:
        return CONTROL_STEP_NS // self.timestep_ns

    @property
    def steps_a_touch(self) -> int:
        return TOUCH_STEP_NS // self.timestep_ns


@dataclass(frozen=True)
class GripperConfig:
    """A parallel-jaw gripper with flat fingers on three force-limited slides, without an arm."""

    grip_force: float = 15.0
    """Force of each finger [N]."""
    finger_friction: float = 1.0
    """Rubber-like fingertips on wood."""
    pad: tuple[float, float, float] = (0.016, 0.008, 0.011)
    """Fingertip size along x, y, z [m]: shorter than the 2 cm that stick out, lower than a block."""
    opening: float = 0.034
    """Distance between the open fingertips [m]."""
    stiffness: float = 2.0e4
    """Position stiffness of the slides that carry the hand [N/m]."""
    force_limit: float = 60.0
    """Largest force of each slide [N]."""
    mass: float = 0.7
    """Mass of the hand [kg], as a Franka hand's."""
