"""Watching a tower after the pull until its outcome is certain."""

from collections.abc import Callable

from jenga_data.collect.recording import Recording
from jenga_data.collect.rest import at_rest
from jenga_data.episode import CONTROL_STEP_NS
from jenga_data.outcome import THRESHOLDS
from jenga_data.sim.physics import PhysicsConfig

_AFTERMATH_SECONDS = 0.32
"""How much of a collapse is shown [s]."""


def observe(recording: Recording, physics: PhysicsConfig, substep: Callable[[int], None], sleep: bool = True) -> None:
    """Record until the tower has stood long enough after the target was clear, or has collapsed.

    A tower whose target is not clear is watched for as long, since it may still fall. It may sleep as soon as it is
    at rest with what is done to it: from then on nothing happens any more.
    """
    period = CONTROL_STEP_NS * 1e-9
    first, watched = recording.frame, 0.0
    while not recording.stood_for(THRESHOLDS.standing):
        if recording.has_collapsed():
            for _ in range(round(_AFTERMATH_SECONDS / period)):
                recording.advance(substep, physics.steps_a_frame)
            break
        clear = recording.clear_frame() >= 0
        if not clear and watched >= THRESHOLDS.standing:
            break
        recording.advance(substep, physics.steps_a_frame)
        watched += period
        if sleep and at_rest(recording.poses[first:], ignore=recording.target if clear else -1):
            recording.world.allow_sleep(True)
