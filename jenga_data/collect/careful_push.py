"""A push that looks at what it does: it turns back when the layer starts to move with the target.

The paper's worst failures began with the push ("the initial push of a target block ... sometimes displaces entire
layers of the tower instead of a single block"), made blindly by a state machine. Friction carries the layer along for
as long as the stick moves slowly; a short fast tap leaves it behind. So the push goes on in taps once others move.
"""

import numpy as np
from jaxtyping import Float

from jenga_data.collect.skills import Skills
from jenga_data.sim.arm import Path

TURN_BACK = 0.0015
"""The slow push turns back when another block has moved by more [m]..."""
GIVE_UP = 0.012
"""...and tapping ends for good, short of the 15 mm that count as dragged: what is not pushed out is not pulled out."""
TAP_SPEED = 0.25
"""Of the stick in a tap [m/s], five times that of the push."""
TAP = 0.005
"""How far beyond the target's end a tap reaches [m]."""
_X = np.eye(3)[0]
_RUN_UP = 0.012
"""A tap starts so far in front of the block [m]."""
TAPS = 8
"""At most."""

SETTINGS = {"turn_back": TURN_BACK, "give_up": GIVE_UP, "tap_speed": TAP_SPEED, "tap": TAP, "taps": TAPS}


class CarefulSkills(Skills):
    """The robot's skills with a push that watches the other blocks."""

    turn_back, give_up = TURN_BACK, GIVE_UP

    def push_forward(self, path: Path) -> None:
        """Push slowly as far as nothing else moves, then on in taps until the target is out or the layer is moved."""
        self._before = self._recording.poses[-1]
        if self._slow_part(path):
            return
        enough = self._config.push_distance - self._config.push_tolerance
        for _ in range(TAPS):
            if self._moved() > self.give_up or self._out() >= enough or self._recording.has_collapsed():
                return
            self._tap()

    def _slow_part(self, path: Path) -> bool:
        """Follow the path, as long as the layer stays; whether it was followed to its end."""
        self._most_force, self.stopped = self._config.push_force, False
        try:
            for k in range(len(path.point)):
                self._arm.begin_knot(path, k)
                self.frame()
                if self.stopped or self._recording.has_collapsed():
                    return False
                if self._moved() > self.turn_back:
                    self._arm.stop(1.0)
                    return False
        finally:
            self._most_force = np.inf
        return True

    def _tap(self) -> None:
        """Draw back and hit the target's end, `TAP` deep."""
        tip = self._tip_at_end()
        self.follow(self.straight(tip - _RUN_UP * _X, speed=self._config.approach_speed))
        self.follow(self.straight(tip + TAP * _X, speed=TAP_SPEED))

    def _tip_at_end(self) -> Float[np.ndarray, "3"]:
        """Where the hand is when the stick's tip touches the target's end."""
        from jenga_data.sim.robot import STICK_REACH

        here = self._arm.set_point
        end = self._recording.poses[-1][self._target, 0] - self._size[0] / 2
        return np.array([end - STICK_REACH, here[1], here[2]])

    def _moved(self) -> float:
        """How far the push has moved any other block [m]."""
        way = np.linalg.norm(self._recording.poses[-1][:, :3] - self._before[:, :3], axis=1)
        return float(np.delete(way, self._target).max())

    def _out(self) -> float:
        """How far it has moved the target [m]."""
        return float(self._recording.poses[-1][self._target, 0] - self._before[self._target, 0])
