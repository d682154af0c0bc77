"""The truth about labels: what became of a pull, decided from poses alone."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from jaxtyping import Bool, Float

from jenga_data.blocks import NOMINAL_SIZE
from jenga_data.geometry import clear_of_others


class Outcome(StrEnum):
    """How a rollout ended. The order of the members is the order in which they are decided."""

    INVALID = "invalid"
    COLLAPSED = "collapsed"
    EXTRACTED = "extracted"
    STUCK = "stuck"

    @property
    def failure(self) -> bool:
        """The paper's f = 1: the block is stuck or the tower collapsed (section II-B)."""
        return self in (Outcome.STUCK, Outcome.COLLAPSED)


@dataclass(frozen=True)
class Thresholds:
    """Where one outcome ends and the next begins. All are far above creep, which is under 1 mm an episode."""

    drop: float = NOMINAL_SIZE[2] / 2
    """Half a block's height [m]: a block that sinks so far has lost the level it lay on."""
    drag: float = NOMINAL_SIZE[2]
    """A block's height [m]: a person sees that a block moved sideways by so much."""
    standing: float = 2.0
    """How long the tower must stand after the target is clear [s]: a block falls a level in 0.06 s."""
    speed_limit: float = 50.0
    """Faster than any block can get in a fall from 0.4 m [m/s]: beyond it the physics broke."""


THRESHOLDS = Thresholds()


@dataclass(frozen=True)
class Verdict:
    """What one rollout came to. `moved` is the largest displacement of a block other than the target [m]."""

    outcome: Outcome
    dragged: bool
    moved: float
    clear_frame: int
    """First frame from which on the target stays clear of the tower, -1 if it never does."""

    @property
    def failure(self) -> bool:
        return self.outcome.failure

    @property
    def strict_failure(self) -> bool:
        """A failure, or another block was dragged sideways by more than a block's height."""
        return self.failure or self.dragged


def collapsed(
    start: Float[np.ndarray, "block 7"], pose: Float[np.ndarray, "*batch block 7"], target: int, drop: float
) -> Bool[np.ndarray, "*batch"]:
    """Whether any block but the target (-1 for none) has dropped by more than `drop` [m] since `start`."""
    fallen = start[:, 2] - pose[..., 2] > drop
    return np.asarray((np.delete(fallen, target, axis=-1) if target >= 0 else fallen).any(-1))


def judge(
    pose: Float[np.ndarray, "frame block 7"],
    size: Float[np.ndarray, "block 3"],
    target: int,
    frame_seconds: float,
    thresholds: Thresholds = THRESHOLDS,
) -> Verdict:
    """Decide a rollout from its frames, the first of which is the state before anything touched the tower.

    Args:
        pose: every frame's poses in the world, target along x.
        frame_seconds: time between two frames [s].
    """
    with np.errstate(all="ignore"):  # broken physics give numbers beyond all bounds
        step = np.linalg.norm(np.diff(pose[..., :3], axis=0), axis=-1)
    if not np.isfinite(pose).all() or (step > thresholds.speed_limit * frame_seconds).any():
        return Verdict(Outcome.INVALID, dragged=False, moved=float("nan"), clear_frame=-1)

    others = np.delete(np.arange(pose.shape[1]), target)
    displacement = pose[:, others, :3] - pose[0, others, :3]
    moved = float(np.linalg.norm(displacement, axis=-1).max())
    dragged = bool((np.linalg.norm(displacement[..., :2], axis=-1).max()) > thresholds.drag)

    clear = clear_of_others(pose, size, target)
    still_clear = np.logical_and.accumulate(clear[::-1])[::-1]
    clear_frame = int(np.argmax(still_clear)) if still_clear.any() else -1

    if collapsed(pose[0], pose, target, thresholds.drop).any():
        outcome = Outcome.COLLAPSED
    elif clear_frame >= 0 and (len(pose) - 1 - clear_frame) * frame_seconds >= thresholds.standing - 1e-9:
        outcome = Outcome.EXTRACTED
    else:
        outcome = Outcome.STUCK
    return Verdict(outcome, dragged, moved, clear_frame)
