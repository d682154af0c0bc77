"""What a physics step costs over an episode, phase by phase."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from jenga_data.bench.trace import EpisodeTrace
from jenga_data.palette import MUTED_INK, PHASES
from jenga_data.replay import style

_MS = 1e3


def step_plot(traces: Sequence[EpisodeTrace], step: float, path: Path) -> None:
    """Draw milliseconds a step over simulated time, every episode faint and the first one full.

    Args:
        step: a physics step [s].

    Raises:
        JengaError: the file cannot be written.
    """
    with style.applied():
        figure = Figure(figsize=(11.0, 4.2), layout="constrained")
        axes = figure.subplots()
        for number, trace in reversed(list(enumerate(traces))):
            time = np.arange(len(trace.steps.seconds)) * step
            for colour, name in zip(PHASES, trace.phase, strict=False):
                part = trace.steps_of(name)
                axes.plot(
                    time[part],
                    _MS * trace.steps.seconds[part],
                    color=colour,
                    alpha=0.25 if number else 1.0,
                    linewidth=0.8 if number else 1.4,
                    label=None if number else name,
                )
        axes.axhline(_MS * step, color=MUTED_INK, linewidth=1.0, linestyle="--")
        axes.text(0.0, _MS * step * 1.08, "real time", color=MUTED_INK, va="bottom")
        axes.set_yscale("log")
        axes.set_xlabel("simulated time since the pull began [s]")
        axes.set_ylabel("CPU time of a step [ms]")
        axes.set_title(f"{len(traces)} selection episodes, the first one strong", loc="left")
        axes.legend(loc="upper right", ncols=2)
        style.save(figure, path)
