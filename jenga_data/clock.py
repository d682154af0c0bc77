"""The two beats of the log, in whole nanoseconds: accumulated floating-point seconds miss the exact moment."""

CONTROL_STEP_NS = 32_000_000
"""One control step, one frame: 32 ms [ns]."""
TOUCH_STEP_NS = 4_000_000
"""Fingertip forces are sampled at 250 Hz [ns]."""
MOMENTS = (4, 8, 16)
"""So many control steps into a pull a row of a selection dataset looks at it again: a block that comes has come about
1, 2 and 5 cm by then."""
