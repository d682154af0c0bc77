"""A push that looks at what it does: it turns back when the layer starts to move with the target.

The paper's worst failures began with the push ("the initial push of a target block ... sometimes displaces entire
layers of the tower instead of a single block"), made blindly by a state machine. Friction carries the layer along for
as long as the stick moves slowly; a stroke as fast as the arm can make it leaves the layer behind, as the tablecloth
leaves the dishes. So the push ends in strokes once others move, or where the target takes too much force.
"""

import numpy as np
from jaxtyping import Float

from jenga_data.collect.skills import Skills
from jenga_data.sim.arm import Path

TURN_BACK = 0.0008
"""The slow push turns back when another block has moved by more [m]..."""
GIVE_UP = 0.012
"""...and strokes end for good, short of the 15 mm that count as dragged: what is not pushed out is not pulled out."""
RUN_UP = 0.02
"""A stroke starts so far in front of the block [m]: it meets the block about when it is fastest..."""
ACCELERATION = 13.0
"""...which is as fast as the arm's acceleration [m/s^2] lets it be, up to 0.5 m/s."""
LEAST_DEPTH = 0.004
"""A stroke reaches as far as the target has to go, and at least so far beyond its end [m]."""
STROKES = 8
"""At most."""
REST_SECONDS = 10.0
"""A tower that was struck gets so long to come to rest [s]."""
_X = np.eye(3)[0]

SETTINGS = {
    "turn_back": TURN_BACK,
    "give_up": GIVE_UP,
    "run_up": RUN_UP,
    "acceleration": ACCELERATION,
    "least_depth": LEAST_DEPTH,
    "strokes": STROKES,
    "rest_seconds": REST_SECONDS,
}


class CarefulSkills(Skills):
    """The robot's skills with a push that watches the other blocks."""

    turn_back, give_up = TURN_BACK, GIVE_UP
    rest_seconds = REST_SECONDS

    def push_forward(self, path: Path) -> None:
        """Push slowly as far as nothing else moves, then on in strokes until the target is out or the layer moved."""
        self._before = self._recording.poses[-1]
        if self._slow_part(path):
            return
        enough = self._config.push_distance - self._config.push_tolerance
        for _ in range(STROKES):
            if self._moved() > self.give_up or self._out() >= enough or self._recording.has_collapsed():
                return
            self._strike()

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

    def _strike(self) -> None:
        """Draw back and hit the target's end, to push it as far as it still has to go."""
        tip = self._tip_at_end()
        depth = max(self._config.push_distance - self._out(), LEAST_DEPTH)
        self.follow(self.straight(tip - RUN_UP * _X, speed=self._config.approach_speed))
        self.follow(self.straight(tip + depth * _X, acceleration=ACCELERATION))

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
