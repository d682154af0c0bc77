"""What a model says: its ghost, and the tower in the colours of its error and of its chance of failure."""

import numpy as np
import rerun as rr

from jenga_data import palette
from jenga_data.episode import Prediction
from jenga_data.replay.measures import error_scale, frames_without, has_chances, others, position_error
from jenga_data.replay.recording.recorder import Recorder
from jenga_data.replay.recording.robot import SOLID
from jenga_data.replay.series import model_path

WIRES = rr.components.FillMode.MajorWireframe
_TRANSLUCENT = rr.components.FillMode.TransparentFillMajorWireframe
_GHOST_MARGIN = 3e-4
"""Ghosts are larger than their blocks by so much [m], so that they do not flicker where they agree with the truth."""


def log_model(to: Recorder, number: int, label: str, prediction: Prediction) -> None:
    """One model's ghost, and the tower coloured by its error and by its chance of failure."""
    episode, path, size = to.episode, model_path(label), to.episode.header.blocks.size
    if len(prediction.frame):
        at, gone = episode.time_ns[prediction.frame], episode.time_ns[frames_without(episode, prediction)]
        colour = palette.rgba8(palette.model_colour(number))
        nowhere = np.array([np.nan, np.nan, np.nan, 1.0, 0.0, 0.0, 0.0])
        parts = (("ghost", others(episode), WIRES), ("ghost/target", np.array([episode.header.target]), _TRANSLUCENT))
        for part, which, mode in parts:
            to.static(f"{path}/{part}", rr.Boxes3D(sizes=size[which] + _GHOST_MARGIN, colors=[colour], fill_mode=mode))
            to.boxes(f"{path}/{part}", at, prediction.pose[:, which])
            to.boxes(f"{path}/{part}", gone, np.tile(nowhere, (len(gone), len(which), 1)))
        error = position_error(episode, prediction)
        shown = palette.rgba8(palette.error_colours(error, error_scale(episode, prediction)))
        unknown = np.tile(palette.rgba8(palette.UNKNOWN), (len(gone), len(size), 1))
        to.static(f"{path}/error", rr.Boxes3D(sizes=size, fill_mode=SOLID))
        to.boxes(f"{path}/error", episode.time_ns, episode.pose)
        for times, rgba in ((at, shown), (gone, unknown)):
            colours = rr.Boxes3D.columns(colors=rgba.reshape(-1, 4))
            to.columns(f"{path}/error", times, colours.partition(np.full(len(times), len(size))))
    if has_chances(prediction):
        chance = palette.rgba8(palette.probability_colours(prediction.failure_probability))
        to.static(f"{path}/chance", rr.Boxes3D(sizes=size, colors=chance, fill_mode=SOLID))
        to.boxes(f"{path}/chance", episode.time_ns, episode.pose)
