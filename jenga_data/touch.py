"""What the fingertips feel during a pull, as one number: how erratic the force is (paper, section Future Work)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from jenga_data.episode import Episode
from jenga_data.geometry import clear_of_others
from jenga_data.outcome import THRESHOLDS, collapsed

PULL = "pull"
"""The phase that counts."""


@dataclass(frozen=True, eq=False)
class Touch:
    """The fingertip samples of one pull, as long as its outcome is open."""

    time_ns: Int[np.ndarray, " sample"]
    force: Float[np.ndarray, "sample 2 3"]
    """What the block exerts on the left and on the right fingertip, in the gripper's frame [N]."""
    position: Float[np.ndarray, "sample 3"]
    """Of the point between the fingertips, in the world [m]."""

    def erraticness(self) -> float:
        """See `erraticness`."""
        step = np.diff(self.time_ns) * 1e-9
        change = np.diff(self.force, axis=0)[step > 0]
        if len(change) == 0:
            return float("nan")
        return float(np.sqrt(((change**2).sum((1, 2)) / step[step > 0] ** 2).mean()))

    def mean_force(self) -> float:
        """Mean length of the vector of all six components [N]; NaN where there is no sample."""
        return float(np.sqrt((self.force**2).sum((1, 2))).mean()) if len(self.force) else float("nan")

    def speed(self) -> float:
        """Distance between the gripper's first and last position over the time between them [m/s]; NaN without."""
        seconds = (self.time_ns[-1] - self.time_ns[0]) * 1e-9 if len(self.time_ns) else 0.0
        return float(np.linalg.norm(self.position[-1] - self.position[0]) / seconds) if seconds else float("nan")


def open_until(episode: Episode) -> tuple[int, int] | None:
    """When the pull begins and when its outcome is no longer open [ns]; None where there is no pull.

    It is open until the target is clear of the tower for the first time, another block has dropped by as much as
    makes a collapse, or the phase ends. All are known at that moment: neither the verdict nor a later frame is asked.
    """
    starts = [phase for phase in episode.phases if phase.name == PULL]
    if not starts:
        return None
    begin = starts[0].time_ns
    ends = [phase.time_ns for phase in episode.phases if phase.time_ns > begin] or [int(episode.time_ns[-1])]
    header, frames = episode.header, episode.time_ns >= begin
    pose = episode.pose[frames]
    with np.errstate(all="ignore"):  # broken physics give numbers beyond all bounds
        decided = clear_of_others(pose, header.blocks.size, header.target)
        decided |= collapsed(episode.pose[0], pose, header.target, THRESHOLDS.drop)
    return begin, int(min(ends[0], *episode.time_ns[frames][decided][:1]) if decided.any() else ends[0])


def pull_touch(episode: Episode) -> Touch:
    """The samples of the pull from its begin to the moment that decides it, none where there is no pull."""
    track, span = episode.gripper, open_until(episode)
    begin, end = span if span else (0, -1)
    within = (track.time_ns >= begin) & (track.time_ns <= end)
    force = np.stack([track.left_force[within], track.right_force[within]], axis=1)
    return Touch(track.time_ns[within], force, track.pose[within, :3])


def erraticness(episode: Episode) -> float:
    """Root mean square of the rate of change of the fingertip forces while the outcome of the pull is open [N/s].

    With F the six components (two fingers, three axes) at two samples dt apart it is sqrt(mean(|F' - F|^2 / dt^2)),
    over the samples that `open_until` leaves; NaN where there are fewer than two, as in an episode without a pull.

    Why this: a constant grip force, whatever its size, adds nothing; it is a mean over time, so that a longer pull
    is not more erratic than a short one; it has a unit and no free parameter, such as the window of a filter. A knock
    counts more than a tremble of the same path, as it does to the eye. Twice the forces give twice the value. What
    it does not remove: faster pulls change forces faster, and white noise of the sensor looks larger at a higher
    sampling rate. So compare values of one rate (250 Hz here), and look at pulls of the same speed.
    """
    return pull_touch(episode).erraticness()
