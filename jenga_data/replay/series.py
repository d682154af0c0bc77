"""The curves of a replay as data: which lines stand in which plot, with their names, colours and widths."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from jenga_data.episode import Episode, Prediction
from jenga_data.palette import GREEN, ORANGE, SKY_BLUE, VERMILLION, joint_colour, model_colour
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
_MACHINE = "robot"


@dataclass(frozen=True, eq=False)
class Series:
    """Lines with common times: `path` names them in a recording, `plot` is the title, with its unit, they share.

    Plots of the same `tab` stand behind each other; a plot without one always shows.
    """

    path: str
    plot: str
    time_ns: Int[np.ndarray, " row"]
    value: Float[np.ndarray, "row line"]
    names: tuple[str, ...]
    colours: tuple[tuple[float, float, float], ...]
    width: float = _THICK
    tab: str = ""


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
    found += _machine_series(episode)
    for number, (label, prediction) in enumerate(zip(model_labels(predictions), predictions, strict=True)):
        error = position_error(episode, prediction) * MM
        value = np.stack([root_mean_square(error[:, others(episode)]), error[:, episode.header.target]], axis=1)
        colours = (model_colour(number), SKY_BLUE)
        plot, names = f"error of {label} [mm]", ("others (RMS)", "target")
        found.append(
            Series(f"{model_path(label)}/curve", plot, episode.time_ns[prediction.frame], value, names, colours)
        )
    return [series for series in found if len(series.time_ns)]


def joint_curves(episode: Episode) -> list[tuple[str, Float[np.ndarray, "frame joint"]]]:
    """Title, with its unit, and values of what the robot's joints did; none where it has no joints."""
    track = episode.robot
    if track is None or not track.position.shape[1]:
        return []
    return [("joints [rad]", track.position), ("speed [rad/s]", track.velocity), ("torque [N m]", track.torque)]


def has_turned(episode: Episode) -> bool:
    """Whether the turntable did anything worth a curve."""
    return bool(np.any(episode.turntable != 0.0))


def _machine_series(episode: Episode) -> list[Series]:
    """What joints and turntable did, behind each other: there is no room for all of them side by side."""
    names = episode.header.robot.joints if episode.header.robot else ()
    colours = tuple(joint_colour(number) for number in range(len(names)))
    found = [
        Series(f"/curve/robot/{title.split()[0]}", title, episode.time_ns, value, names, colours, tab=_MACHINE)
        for title, value in joint_curves(episode)
    ]
    if has_turned(episode):
        angle = np.degrees(episode.turntable)[:, None]
        title = "turntable [°]"
        found.append(Series("/curve/turntable", title, episode.time_ns, angle, ("angle",), (ORANGE,), tab=_MACHINE))
    return found


def model_path(label: str) -> str:
    """Where a recording keeps what belongs to a model; every character but letters, digits, - and _ becomes _."""
    return "/model/" + "".join(c if c.isalnum() or c in "-_" else "_" for c in label)
