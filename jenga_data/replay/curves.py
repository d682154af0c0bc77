"""An episode as curves over time: what was commanded, felt, moved and predicted."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from jenga_data.episode import Episode, Prediction
from jenga_data.palette import AXES, BLUE, MUTED_INK, VERMILLION, joint_colour, model_colour
from jenga_data.replay import style
from jenga_data.replay.measures import (
    MM,
    displacement,
    largest_displacement_of_others,
    others,
    position_error,
    root_mean_square,
    seconds,
    seconds_of,
    standing_still_error,
)
from jenga_data.replay.series import has_turned, joint_curves

_SMALLEST_ERROR_MM = 1e-3
"""A logarithmic axis has no zero: an error below a micrometre is drawn at one."""

Dash = Literal["-", ":"] | tuple[float, Sequence[float]]
_DASH: Dash = (0.0, (2.0, 1.5))
_BAND = (0.950, 0.955, 0.960)
_LETTER = 0.0135
"""Width of a letter as a part of the time axis, at this size of figure and type."""

Panel = tuple[str, Callable[[Axes], None]]


def episode_curves(episode: Episode, predictions: Sequence[Prediction], path: Path) -> None:
    """Write actions, forces, displacements, joints and each model's error, one above the other, phases on top.

    Panels that would be empty are left out: a selection episode has no gripper, a log may have no robot, a turntable
    that never turns, or no prediction.
    """
    panels: list[Panel] = []
    if len(episode.action):
        panels.append(("action [mm]", lambda axes: _actions(axes, episode)))
    if len(episode.gripper.time_ns):
        panels.append(("fingertip\nforce [N]", lambda axes: _forces(axes, episode)))
    panels.append(("others\nmoved [mm]", lambda axes: _displacements(axes, episode)))
    for title, value in joint_curves(episode):
        panels.append((title.replace(" ", "\n", 1), partial(_joints, episode=episode, value=value)))
    if has_turned(episode):
        panels.append(("turntable\n[°]", lambda axes: _turntable(axes, episode)))
    if predictions:
        panels.append(("error of the\nothers [mm]", lambda axes: _errors(axes, episode, predictions, of_target=False)))
        panels.append(("error of the\ntarget [mm]", lambda axes: _errors(axes, episode, predictions, of_target=True)))
    with style.applied():
        figure = Figure(figsize=(11.0, 0.9 + 2.1 * len(panels)), layout="constrained")
        grid = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (label, draw) in zip(grid, panels, strict=True):
            draw(axes)
            axes.set_ylabel(label)
            axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), borderaxespad=0.0)
        grid[-1].set_xlabel("time [s]")
        grid[-1].set_xlim(0.0, float(seconds(episode)[-1]) or 1.0)
        _phases(list(grid), episode)
        figure.align_ylabels(list(grid))
        style.save(figure, path)


def _phases(grid: Sequence[Axes], episode: Episode) -> None:
    """Bands behind all panels, every second one shaded, named above the first panel in as many rows as it takes."""
    end = float(seconds(episode)[-1])
    starts = seconds_of(episode, np.array([phase.time_ns for phase in episode.phases], np.int64)).tolist()
    taken: list[float] = []  # where the last name of each row ends [s]
    for number, (start, stop) in enumerate(pairwise([*starts, end])):
        if number % 2 == 0:
            for axes in grid:
                axes.axvspan(start, stop, color=_BAND, zorder=0, linewidth=0)
        name = episode.phases[number].name
        row = next((r for r, until in enumerate(taken) if until <= start), len(taken))
        taken[row : row + 1] = [start + _LETTER * (len(name) + 1) * end]
        grid[0].annotate(
            name, (start, 1.0), (2, 4 + 16 * row), xycoords=("data", "axes fraction"), textcoords="offset points"
        )


def _actions(axes: Axes, episode: Episode) -> None:
    time = seconds(episode)[episode.action_frame]
    for axis, (name, colour) in enumerate(zip("xyz", AXES, strict=True)):
        axes.step(time, episode.action[:, axis] * MM, where="post", color=colour, linewidth=1.2, linestyle=_DASH)
        axes.step(time, episode.action_reached[:, axis] * MM, where="post", color=colour, label=name)
    _explain(axes, {"reached": "-", "commanded": _DASH})


def _forces(axes: Axes, episode: Episode) -> None:
    track = episode.gripper
    time = seconds_of(episode, track.time_ns)
    for axis, (name, colour) in enumerate(zip("xyz", AXES, strict=True)):
        axes.plot(time, track.left_force[:, axis], color=colour, linewidth=1.3, label=name)
        axes.plot(time, track.right_force[:, axis], color=colour, linewidth=1.1, linestyle=_DASH)
    _explain(axes, {"left": "-", "right": _DASH})


def _displacements(axes: Axes, episode: Episode) -> None:
    time = seconds(episode)
    moved = displacement(episode)[:, others(episode)]
    axes.plot(time, largest_displacement_of_others(episode) * MM, color=VERMILLION, label="farthest")
    axes.plot(time, root_mean_square(moved) * MM, color=BLUE, label="all (RMS)")
    axes.set_ylim(bottom=0.0)


def _joints(axes: Axes, episode: Episode, value: Float[np.ndarray, "frame joint"]) -> None:
    names = episode.header.robot.joints if episode.header.robot else ()
    for number, name in enumerate(names):
        axes.plot(seconds(episode), value[:, number], color=joint_colour(number), label=name, linewidth=1.6)


def _turntable(axes: Axes, episode: Episode) -> None:
    axes.plot(seconds(episode), np.degrees(episode.turntable), color=BLUE, label="angle")


def _errors(axes: Axes, episode: Episode, predictions: Sequence[Prediction], *, of_target: bool) -> None:
    """Root mean square over the others, or the target's own; dotted is the trivial model from the same start."""
    time = seconds(episode)
    blocks = np.array([episode.header.target]) if of_target else others(episode)
    for number, prediction in enumerate(predictions):
        at, colour = time[prediction.frame], model_colour(number)
        error = root_mean_square(position_error(episode, prediction)[:, blocks]) * MM
        still = root_mean_square(standing_still_error(episode, prediction)[:, blocks]) * MM
        label = f"{prediction.name}, {prediction.kind.replace('_', ' ')}"
        axes.plot(at, np.maximum(error, _SMALLEST_ERROR_MM), color=colour, label=label)
        axes.plot(at, np.maximum(still, _SMALLEST_ERROR_MM), color=colour, linestyle=":", linewidth=1.6)
    _explain(axes, {"if nothing moved": ":"})
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(numticks=5))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())


def _explain(axes: Axes, dashes: dict[str, Dash]) -> None:
    """Add to the legend what the dash of a line means, where its colour means something else."""
    for label, dash in dashes.items():
        axes.add_line(Line2D([], [], color=MUTED_INK, linestyle=dash, linewidth=1.6, label=label))
