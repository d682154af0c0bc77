"""Fingertip forces in the loop: a pull that slows down, wiggles or gives up when they get erratic.

The paper's appendix shows them "significantly more erratic in the failed extraction case and smoother in the
successful extraction" and names their use in control as future work.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jenga_data.clock import CONTROL_STEP_NS, TOUCH_STEP_NS
from jenga_data.collect.extraction import Onlooker, Policy, Proposer, View
from jenga_data.errors import JengaError
from jenga_data.touch import Touch
from jenga_data.tower import TowerState

SAMPLES = CONTROL_STEP_NS // TOUCH_STEP_NS + 1
"""Touch samples of one control step, both ends included."""


@dataclass(frozen=True)
class TouchConfig:
    """What is erratic, and what is done about it.

    Forces change faster in a faster pull, so the limit grows with the speed. In 24 pulls of a gripper at 0.04 to 0.5
    m/s the steps of successes and of failures differed little: the defaults call rough what hardly any step of a
    success was, and are to be set on validation towers.
    """

    rough: float = 1000.0
    """Erraticness of the fingertip forces over the last control step [N/s] above which it was a rough one..."""
    rough_per_speed: float = 4000.0
    """...and what the speed of the pull adds to that [N/s per m/s]."""
    slow: float = 0.5
    """A rough step is followed by one of so much of the wanted displacement along x."""
    slowest: float = 0.001
    """...but of no less than this along -x [m]: a pull that stands still stays in the tower."""
    wiggle: float = 0.0003
    """After two rough steps in a row the hand moves to and fro sideways by so much [m]."""
    patience: int = 25
    """After so many rough steps in a row the hand stops for good; 0 for never."""

    def __post_init__(self) -> None:
        if not (self.rough > 0 and 0 < self.slow <= 1):
            raise JengaError(f"rough {self.rough}, slow {self.slow}; allowed: rough above 0, slow above 0 up to 1")
        if min(self.rough_per_speed, self.slowest, self.wiggle) < 0:
            raise JengaError(
                f"rough-per-speed {self.rough_per_speed}, slowest {self.slowest}, wiggle {self.wiggle}; "
                "allowed: 0 or more"
            )
        if self.patience < 0:
            raise JengaError(f"patience is {self.patience}; allowed: 0 or more")


class CarefulTouch:
    """Another policy, slowed down where the fingers feel that the tower comes along."""

    def __init__(self, policy: Policy, config: TouchConfig) -> None:
        self._policy, self._config = policy, config
        self._view: View | None = None
        self.rough_steps = 0
        """Rough control steps in a row."""
        self.wanted = np.zeros(3)

    def enter(self, view: View) -> None:
        self._view = view
        if isinstance(self._policy, Onlooker):
            self._policy.enter(view)

    def act(self, state: TowerState, target: int) -> Float[np.ndarray, "3"]:
        action = np.array(self._policy.act(state, target), float)
        self.wanted = np.array(self._policy.wanted if isinstance(self._policy, Proposer) else action, float)
        config = self._config
        limit = config.rough + config.rough_per_speed * abs(action[0]) / (CONTROL_STEP_NS * 1e-9)
        self.rough_steps = self.rough_steps + 1 if self.roughness() > limit else 0
        if config.patience and self.rough_steps >= config.patience:
            return np.zeros(3)
        if self.rough_steps:
            action[0] = self._slowed(action[0])
        if self.rough_steps >= 2:
            action[1] += config.wiggle * (1 if self.rough_steps % 2 else -1)
        return action

    def _slowed(self, x: float) -> float:
        """A displacement along x that is `slow` of it, and a pull no slower than `slowest`."""
        return self._config.slow * x if x >= 0 else min(self._config.slow * x, max(x, -self._config.slowest))

    def roughness(self) -> float:
        """`jenga_data.touch.erraticness` over the last control step [N/s]; 0 before anything was felt."""
        samples = list(self._view.recording.felt)[-SAMPLES:] if self._view else []
        if len(samples) < 2:
            return 0.0
        return Touch(
            np.array([sample.time_ns for sample in samples], np.int64),
            np.array([(sample.left_force, sample.right_force) for sample in samples]),
            np.array([sample.pose[:3] for sample in samples]),
        ).erraticness()
