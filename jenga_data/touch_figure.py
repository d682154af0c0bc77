"""The figure of the paper's appendix (extract_contact) from logs: fingertip forces of a success and of a failure."""

import numpy as np
from jaxtyping import Float, Shaped
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jenga_data.episode import Episode
from jenga_data.outcome import Outcome
from jenga_data.palette import AXES, FAILURE, INK, MUTED_INK, SUCCESS
from jenga_data.touch import open_until

_AFTER = 0.25
"""How much is drawn of what came after the outcome was decided [s]."""
_OUTCOMES = (Outcome.EXTRACTED, Outcome.STUCK, Outcome.COLLAPSED)


def touch_figure(
    success: Episode | None,
    failure: Episode | None,
    value: Float[np.ndarray, " episode"],
    outcome: Shaped[np.ndarray, " episode"],
) -> Figure:
    """Top: forces over time, left a success, right a failure, on the same axes; bottom: erraticness by outcome.

    Call it with the project's style applied. What comes after the outcome is decided lies behind a grey veil.
    """
    figure = Figure(figsize=(11.0, 9.0), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(1.0, 1.0, 0.9))
    first = figure.add_subplot(grid[0, 0])
    forces = [first, *(figure.add_subplot(grid[at], sharex=first, sharey=first) for at in ((0, 1), (1, 0), (1, 1)))]
    spans = [open_until(episode) for episode in (success, failure) if episode]
    first.set_xlim(0.0, max((end - begin) * 1e-9 for begin, end in filter(None, spans)) + _AFTER)
    for column, (name, episode) in enumerate((("successful", success), ("failed", failure))):
        _forces(forces[column], forces[2 + column], episode)
        outcome_name = f": {episode.result.verdict.outcome}" if episode and episode.result else ""
        title = f"typical {name} extraction{outcome_name}" if episode else f"no {name} extraction"
        forces[column].set_title(title, loc="left")
        forces[2 + column].set_xlabel("time since the pull began [s]")
    forces[0].set_ylabel("left finger [N]")
    forces[2].set_ylabel("right finger [N]")
    drawn = next(axes for axes in forces if axes.lines)
    figure.legend(*drawn.get_legend_handles_labels(), loc="outside upper right", ncols=3)
    for axes in forces[:2]:
        axes.tick_params(labelbottom=False)
    for axes in forces[1::2]:
        axes.tick_params(labelleft=False)
    _distribution(figure.add_subplot(grid[2, :]), value, outcome)
    return figure


def _forces(left: Axes, right: Axes, episode: Episode | None) -> None:
    span = open_until(episode) if episode else None
    if episode is None or span is None:
        return
    begin, end = span
    track = episode.gripper
    shown = (track.time_ns >= begin) & (track.time_ns <= end + _AFTER * 1e9)
    time = (track.time_ns[shown] - begin) * 1e-9
    for axes, force in ((left, track.left_force), (right, track.right_force)):
        for axis, (name, colour) in enumerate(zip("xyz", AXES, strict=True)):
            axes.plot(time, force[shown, axis], color=colour, linewidth=1.2, label=name)
        axes.axvspan((end - begin) * 1e-9, axes.get_xlim()[1], color="white", alpha=0.6, linewidth=0, zorder=3)
        axes.axvline((end - begin) * 1e-9, color=MUTED_INK, linestyle=":", linewidth=1.4, zorder=4)


def _distribution(axes: Axes, value: Float[np.ndarray, " episode"], outcome: Shaped[np.ndarray, " episode"]) -> None:
    """A dot an episode, spread over its row in a fixed pattern, and a bar at the median."""
    rows = np.arange(len(_OUTCOMES))[::-1]
    labels = []
    for row, name in zip(rows, _OUTCOMES, strict=True):
        own = value[outcome == name]
        labels.append(f"{name}\nn = {len(own)}")
        if len(own) == 0:
            continue
        # The golden ratio spreads any number of dots evenly without a random draw.
        spread = (np.arange(len(own)) * 0.6180339887498949 % 1.0 - 0.5) * 0.5
        colour = FAILURE if name.failure else SUCCESS
        axes.plot(own, row + spread, "o", color=colour, markersize=5, alpha=0.6, markeredgewidth=0)
        axes.vlines(np.median(own), row - 0.38, row + 0.38, color=INK, linewidth=2.5)
    axes.set_yticks(rows, labels)
    axes.set(xlabel="erraticness [N/s]; bar: median", ylim=(-0.6, len(rows) - 0.4))
    axes.set_xlim(left=0.0)
    axes.set_title("change of the fingertip forces until the outcome is decided (dotted above)", loc="left")
