"""The curves of a replay as data: which lines stand in which plot, with their names, colours and widths."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from jenga_data.episode import Episode, Prediction
from jenga_data.palette import GREEN, SKY_BLUE, VERMILLION, model_colour
from jenga_data.replay.measures import (
    MM,
    displacement,
    largest_displacement_of_others,
    model_labels,
    others,
    position_error,
    root_mean_square,
)

_XYZ = (VERMILLION, GREEN, SKY_BLUE)
"""Lighter than `palette.AXES`: these stand on black as well."""
_THICK, _THIN = 1.8, 0.8


@dataclass(frozen=True, eq=False)
class Series:
    """Lines with common times: `path` names them in a recording, `plot` is the title, with its unit, they share."""

    path: str
    plot: str
    time_ns: Int[np.ndarray, " row"]
    value: Float[np.ndarray, "row line"]
    names: tuple[str, ...]
    colours: tuple[tuple[float, float, float], ...]
    width: float = _THICK


def episode_series(episode: Episode, predictions: Sequence[Prediction]) -> list[Series]:
    """All curves of an episode and of the models' errors over it; none that would be empty."""
    track, at = episode.gripper, episode.time_ns[episode.action_frame]
    force, action = "fingertip force [N]", "action [mm]"
    moved = np.stack(
        [largest_displacement_of_others(episode), root_mean_square(displacement(episode)[:, others(episode)])], axis=1
    )
    found = [
        Series("/curve/action/commanded", action, at, episode.action * MM, ("x cmd", "y cmd", "z cmd"), _XYZ, _THIN),
        Series("/curve/action/reached", action, at, episode.action_reached * MM, ("x", "y", "z"), _XYZ),
        Series("/curve/force/left", force, track.time_ns, track.left_force, ("x L", "y L", "z L"), _XYZ),
        Series("/curve/force/right", force, track.time_ns, track.right_force, ("x R", "y R", "z R"), _XYZ, _THIN),
        Series(
            "/curve/moved", "others moved [mm]", episode.time_ns, moved * MM,
            ("farthest", "all (RMS)"), (VERMILLION, SKY_BLUE),
        ),
    ]  # fmt: skip
    for number, (label, prediction) in enumerate(zip(model_labels(predictions), predictions, strict=True)):
        error = position_error(episode, prediction) * MM
        value = np.stack([root_mean_square(error[:, others(episode)]), error[:, episode.header.target]], axis=1)
        colours = (model_colour(number), SKY_BLUE)
        plot, names = f"error of {label} [mm]", ("others (RMS)", "target")
        found.append(
            Series(f"{model_path(label)}/curve", plot, episode.time_ns[prediction.frame], value, names, colours)
        )
    return [series for series in found if len(series.time_ns)]


def model_path(label: str) -> str:
    """Where a recording keeps what belongs to a model; every character but letters, digits, - and _ becomes _."""
    return "/model/" + "".join(c if c.isalnum() or c in "-_" else "_" for c in label)
