"""What a collection run is: together with a seed and a number it decides an episode down to the last bit."""

import hashlib
from dataclasses import asdict, dataclass, field
from typing import Any

import msgspec

from jenga_data.errors import JengaError
from jenga_data.sim.physics import ArmConfig, GripperConfig, PhysicsConfig

LAST_ROUND = 15
"""The paper spawns towers between rounds 1 and 15 (section II-A)."""
PULL_FRAMES = 51
"""T, the number of actions of an extraction (paper, section II-C)."""


@dataclass(frozen=True)
class SpawnConfig:
    """How towers come about."""

    distribution: str = "measured"
    """Which real set the blocks are drawn from: measured, measured-second, nominal."""
    wedge: bool = False
    """Whether blocks are a little higher at one end, as real ones are, and not boxes."""
    first_round: int = 1
    last_round: int = LAST_ROUND
    """Rounds are drawn uniformly from these, both included; the paper uses 1 to 15."""
    position_sigma: float = 0.0003
    """Error of a block's position when it is put down, across and along [m]."""
    yaw_sigma: float = 0.002
    """Error of a block's direction when it is put down [rad]."""
    load_limit: float = 3.0
    """A player takes no block on which more than this weight rests [N]: friction holds it above and below. A third of
    a fresh tower's weight on its lowest level is 3.4 N."""
    settle: float = 0.064
    """Time to come to rest before anything is judged [s]; a tower is put near its computed equilibrium."""
    stand: float = 2.0
    """Time over which the tower must then stand by itself [s]; it is watched until it is at rest."""
    creep_allowance: float = 0.002
    """No block may move by more in that time [m]."""
    tries: int = 20
    """Towers to try before giving up."""

    def __post_init__(self) -> None:
        if not 1 <= self.first_round <= self.last_round <= LAST_ROUND:
            raise JengaError(
                f"rounds {self.first_round}-{self.last_round}; allowed: first <= last, both from 1 to {LAST_ROUND}"
            )


@dataclass(frozen=True)
class SelectionConfig:
    """A pull without a robot: a force-capped velocity servo on the target's centre (paper, section II-B)."""

    speed: float = 0.1
    """Speed along -x [m/s]."""
    noise: float = 0.001
    """Standard deviation of the speeds along y and z, drawn anew each control step [m/s]. Over a pull of a second they
    walk 0.18 mm, as far as the heights of blocks spread. With ten times as much two pulls of one block ended
    differently in 4 of 26 cases, with this in 1 of 24: the tower has to decide the outcome, not the noise."""
    gains: tuple[float, float] = (4.0, 400.0)
    """Proportional [N s/m] and integral [N/m] gain of the servo."""
    force_limit: float = 2.0
    """Cap of the force along x [N]: the upper end of a fingertip's light touch (1 to 2 N). A careful player pulls no
    harder, and with 3 N nearly nothing is stuck any more: what does not come is torn out with what lies on it."""
    side_force_limit: float = 0.5
    """Cap of the force along y and z [N], 2.6 times a block's weight."""
    pull_seconds: float = 3.0
    """The servo gives up after so long [s]; a loose block is out after 0.8 s."""
    patience: float = 0.32
    """It gives up sooner when the target has not moved along -x by `least_progress` in so long [s]..."""
    least_progress: float = 0.003
    """...so far [m]: a person does not pull on at what does not move."""
    pull: int = 0
    """Which pull of the tower: 0 pulls the target of the tower's one (J, b, f), 1 and on pull other legal ones of the
    same tower, each another."""
    spawn: SpawnConfig = field(default_factory=SpawnConfig)
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)

    kind = "selection"

    def __post_init__(self) -> None:
        if min(self.speed, self.force_limit, self.pull_seconds, self.patience) <= 0:
            raise JengaError("speed, force-limit, pull-seconds and patience must be positive")
        if self.pull < 0:
            raise JengaError(f"pull is {self.pull}; allowed: 0 or more")


@dataclass(frozen=True)
class RobotConfig:
    """How the robot does what comes before and after the pull."""

    speed: float = 0.4
    """Of the hand on its way through the air [m/s]; the maker's limit is 1.7."""
    acceleration: float = 3.0
    """Most of the hand there [m/s^2]; the maker's limit is 13."""
    approach_speed: float = 0.15
    """Of the hand near the tower [m/s]."""
    push_speed: float = 0.05
    """Of the stick against the target [m/s]."""
    push_distance: float = 0.02
    """How far the target is pushed out [m] (paper, section II-A)..."""
    push_tolerance: float = 0.003
    """...and how far it may fall short [m]."""
    push_force: float = 3.0
    """The push stops when it takes more [N]: a loose block takes up to 1.5, and with more a tight one drags
    along what lies on it."""
    arm: ArmConfig = field(default_factory=ArmConfig)

    def __post_init__(self) -> None:
        if min(self.speed, self.acceleration, self.approach_speed, self.push_speed, self.push_force) <= 0:
            raise JengaError("the robot's speeds, acceleration and push-force must be positive")
        if not 0 < self.push_tolerance < self.push_distance <= 0.03:
            raise JengaError(
                f"push-distance {self.push_distance}, push-tolerance {self.push_tolerance}; "
                "allowed: 0 < push-tolerance < push-distance <= 0.03"
            )


@dataclass(frozen=True)
class ExtractionConfig:
    """A pull by a gripper over T actions, each a displacement of the end effector (paper, section II-C)."""

    body: str = "robot"
    """What pulls: "robot", an arm that first turns the table and pushes the target out with a stick, or "gripper", a
    hand without an arm in front of a target that sticks out already."""

    slowest: float = 0.001
    """Each episode draws its mean displacement a step along -x log-uniformly between this [m]..."""
    fastest: float = 0.017
    """...and this [m]."""
    speed_noise: float = 0.2
    """Standard deviation of a step's displacement along x, as a part of the mean."""
    side: float = 0.001
    """Displacements along y and z are uniform within this [m]; the paper's 0.1 cm."""
    sticks_out: float = 0.02
    """How far the target sticks out at -x before it is grasped [m], where no robot pushes it out."""
    spawn: SpawnConfig = field(default_factory=SpawnConfig)
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    gripper: GripperConfig = field(default_factory=GripperConfig)
    robot: RobotConfig = field(default_factory=RobotConfig)

    kind = "extraction"

    def __post_init__(self) -> None:
        if self.body not in ("robot", "gripper"):
            raise JengaError(f"body is {self.body!r}; allowed: robot, gripper")
        if not 0 < self.slowest <= self.fastest <= 0.02:
            raise JengaError(f"slowest {self.slowest}, fastest {self.fastest}; allowed: 0 < slowest <= fastest <= 0.02")


CollectConfig = SelectionConfig | ExtractionConfig

SEED_LIMIT = 900_000
"""Seeds from here on are reserved for evaluation."""


def check_seed(seed: int) -> None:
    """Refuse a seed that no collection may have.

    Raises:
        JengaError: it is negative, or reserved.
    """
    if not 0 <= seed < SEED_LIMIT:
        raise JengaError(f"seed is {seed}; allowed: 0 to {SEED_LIMIT - 1} (higher ones are reserved for evaluation)")


def config_dict(config: CollectConfig) -> dict[str, Any]:
    """The configuration as plain JSON values, with its kind."""
    return {"kind": config.kind, **asdict(config)}  # msgspec would leave out what `config_from_dict` filled in


def config_from_dict(values: dict[str, Any]) -> CollectConfig:
    """The inverse of `config_dict`, also of `recipe`.

    Raises:
        JengaError: an unknown kind, or a field of another name or type.
    """
    kinds: dict[str, type[SelectionConfig] | type[ExtractionConfig]] = {
        "selection": SelectionConfig,
        "extraction": ExtractionConfig,
    }
    rest = {name: value for name, value in values.items() if name not in ("kind", "controller")}
    if not isinstance(kind := values.get("kind"), str) or kind not in kinds:
        raise JengaError(f"unknown kind of collection {kind!r}; allowed: {', '.join(kinds)}")
    try:
        config = msgspec.convert(rest, kinds[kind])
    except msgspec.ValidationError as error:
        raise JengaError(f"this configuration cannot be read: {error}") from None
    if unknown := _fields_beyond(asdict(config), rest):
        raise JengaError(f"this {kind} configuration has fields that this jenga does not know: {', '.join(unknown)}")
    return config


def _fields_beyond(known: dict[str, Any], given: dict[str, Any]) -> list[str]:
    """Fields that only `given` has, with their path: msgspec passes over them."""
    beyond = [name for name in given if name not in known]
    for name, value in given.items():
        if isinstance(value, dict) and isinstance(known.get(name), dict):
            beyond += [f"{name}.{field}" for field in _fields_beyond(known[name], value)]
    return beyond


@dataclass(frozen=True)
class Actor:
    """Who chooses the actions where it is not the collection's own policy: a controller, and its model's hash."""

    controller: dict[str, Any] = field(default_factory=dict)
    checkpoint: str = ""


NOBODY = Actor()
"""The collection's own policy acts."""


def recipe(config: CollectConfig, actor: Actor = NOBODY) -> dict[str, Any]:
    """The configuration of an episode as its log holds it: plain JSON values, with the controller if one acts."""
    return config_dict(config) | ({"controller": actor.controller} if actor.controller else {})


def episode_key(config: CollectConfig, seed: int, number: int, actor: Actor = NOBODY) -> str:
    """The name of an episode: a hash of (config, seed, number), and of who acts if a controller does."""
    parts = [recipe(config, actor), seed, number, actor.checkpoint]
    return hashlib.sha256(msgspec.json.encode(parts, order="deterministic")).hexdigest()[:20]
