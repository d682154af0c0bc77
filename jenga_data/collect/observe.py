"""Watching a tower after the pull until its outcome is certain."""

from collections.abc import Callable

from jenga_data.collect.recording import Recording
from jenga_data.collect.rest import at_rest
from jenga_data.episode import CONTROL_STEP_NS
from jenga_data.outcome import THRESHOLDS
from jenga_data.sim.physics import PhysicsConfig

AFTERMATH_SECONDS = 0.32
"""How much of a collapse is shown [s]."""


def let_sleep(recording: Recording, first: int = 0) -> None:
    """Let the tower sleep once it is at rest and done with: the target is clear of it, or it was let go at `first`.

    From then on nothing happens to it any more, unless something touches it, which wakes it.
    """
    clear = recording.clear_frame()
    if at_rest(recording.poses[max(first, clear) :], ignore=recording.target if clear >= 0 else -1):
        recording.world.allow_sleep(True)


def observe(
    recording: Recording,
    physics: PhysicsConfig,
    substep: Callable[[int], None],
    sleep: bool = True,
    aftermath: float = AFTERMATH_SECONDS,
) -> None:
    """Record until the tower has stood long enough after the target was clear, or has collapsed.

    A tower whose target is not clear is watched for as long, since it may still fall. It may sleep as soon as it is
    at rest with what is done to it, `sleep` allowing. A collapse is shown for `aftermath` [s].
    """
    period = CONTROL_STEP_NS * 1e-9
    first, watched = recording.frame, 0.0
    while not recording.stood_for(THRESHOLDS.standing):
        if recording.has_collapsed():
            for _ in range(round(aftermath / period)):
                recording.advance(substep, physics.steps_a_frame)
            break
        if recording.clear_frame() < 0 and watched >= THRESHOLDS.standing:
            break
        recording.advance(substep, physics.steps_a_frame)
        watched += period
        if sleep:
            let_sleep(recording, first if recording.clear_frame() < 0 else 0)
