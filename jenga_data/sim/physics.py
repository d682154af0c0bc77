"""How the simulation is set up: frozen records, stored with every episode. Light to import, for the command line."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jenga_data.clock import CONTROL_STEP_NS, TOUCH_STEP_NS
from jenga_data.errors import JengaError

if TYPE_CHECKING:
    from jenga_data.contact_law import ContactLaw


@dataclass(frozen=True)
class PhysicsConfig:
    """Solver and contact settings. Elliptic cones, Newton's method and a sparse Jacobian always."""

    timestep_ns: int = 2_000_000
    """Physics step [ns]; must divide the 4 ms between two touch samples."""
    integrator: str = "implicitfast"
    """MuJoCo integrator: discrete or implicitfast."""
    impratio: float = 5.0
    """Ratio of frictional to normal constraint impedance; higher creeps less."""
    friction: float = 0.3
    """Sliding friction of wood on wood and on the table; public simulators use 0.3 to 0.5."""
    time_constant: float = 0.004
    """Time constant of a contact [s], MuJoCo's solref[0]."""
    damping_ratio: float = 6.0
    """Damping ratio of a contact, MuJoCo's solref[1]. With 4 a loose block that rocks on two others is kicked about
    for ever and creeps by 0.1 mm/s; with 6 it comes to rest."""
    touch_impedance: float = 0.9
    """Constraint impedance of a contact that just touches, MuJoCo's solimp[0]: low, so that contacts come and go
    softly. With a constant impedance loose blocks rattle and creep, and the solver takes twice the iterations."""
    impedance: float = 0.999
    """Constraint impedance of a contact that is loaded, MuJoCo's solimp[1]."""
    impedance_width: float = 7e-5
    """Depth over which one grows into the other [m], MuJoCo's solimp[2]."""
    sleep_tolerance: float = 1e-2
    """Speed below which a tower that may sleep falls asleep (MuJoCo's own measure, about m/s)."""

    def __post_init__(self) -> None:
        if self.timestep_ns <= 0 or TOUCH_STEP_NS % self.timestep_ns:
            raise JengaError(
                f"physics.timestep-ns is {self.timestep_ns}; allowed: a divisor of {TOUCH_STEP_NS}, e.g. 2000000"
            )
        if self.integrator not in ("discrete", "implicitfast"):
            raise JengaError(f"physics.integrator is {self.integrator!r}; allowed: discrete, implicitfast")
        if not (self.friction > 0 and self.impratio > 0):
            raise JengaError("physics.friction and physics.impratio must be positive")
        if not 0 < self.touch_impedance <= self.impedance < 1:
            raise JengaError(
                f"physics.touch-impedance is {self.touch_impedance}, physics.impedance is {self.impedance}; "
                "allowed: 0 < touch-impedance <= impedance < 1, e.g. 0.9 and 0.999"
            )

    @property
    def contact_law(self) -> "ContactLaw":
        """What these settings make of a contact at rest."""
        from jenga_data.contact_law import ContactLaw

        rate = 1 / (self.impedance * self.time_constant * self.damping_ratio) ** 2
        return ContactLaw(rate, self.touch_impedance, self.impedance, self.impedance_width)

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
    finger_length: float = 0.06
    """From the middle of the fingertips to the palm [m]: what reaches over the turntable."""
    finger_damping: float = 40.0
    """Of each finger's slide [N s/m]: with all its force it closes at 0.4 m/s."""
    stiffness: float = 2.0e4
    """Position stiffness of the slides that carry the hand [N/m]."""
    force_limit: float = 60.0
    """Largest force of each slide [N]."""
    mass: float = 0.7
    """Mass of the hand [kg], as a Franka hand's."""


@dataclass(frozen=True)
class ArmConfig:
    """Where the arm stands. Its base is beside the line of the pull: so the hand can point along +x at any height."""

    base: tuple[float, float, float] = (-0.35, -0.5, -0.08)
    """The foot, on the table [m]."""
    yaw: float = 1.5707963267948966
    """The base's heading [rad]: along +y."""
    home: tuple[float, float, float] = (-0.32, -0.16, 0.06)
    """Where the hand is at first [m]."""
    posture: tuple[float, float, float, float, float, float, float] = (0.1, 0.1, -0.1, -2.2, -1.4, 1.6, 1.7)
    """Joint angles [rad]; of all postures for a place of the hand the one near this is taken. With them every joint
    stays 45 degrees or more from its limits in the whole workspace."""
