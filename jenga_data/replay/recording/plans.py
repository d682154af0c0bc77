"""A controller's sampled plans as thin lines, and the one it decided on as a thick one."""

import numpy as np
import rerun as rr

from jenga_data import palette
from jenga_data.replay.plans import Plans
from jenga_data.replay.recording.recorder import Recorder

_THIN, _THICK = 0.00012, 0.0016
"""Radii of the lines [m]: plans lie within a millimetre or two of each other, and would hide a thinner one."""


def log_plans(to: Recorder, plans: Plans) -> None:
    """One row a decision; what is drawn goes away with the frame after the last of a run of them."""
    times = to.episode.time_ns
    over = np.setdiff1d(plans.frame + 1, plans.frame)
    gone = times[over[over < len(times)]]
    for name, strips, colour, radius in (
        ("sampled", plans.path, palette.SKY_BLUE, _THIN),
        ("chosen", plans.chosen[:, None], palette.ORANGE, _THICK),
    ):
        path = f"/plans/{name}"
        to.static(path, rr.LineStrips3D.from_fields(radii=[radius], colors=[palette.rgba8(colour)]))
        flat = list(strips.reshape(-1, *strips.shape[2:]).astype(np.float32))
        columns = rr.LineStrips3D.columns(strips=flat)
        to.columns(path, times[plans.frame], columns.partition(np.full(len(strips), strips.shape[1])))
        if len(gone):
            empty = rr.LineStrips3D.columns(strips=[]).partition(np.zeros(len(gone), int))
            to.columns(path, gone, empty)
