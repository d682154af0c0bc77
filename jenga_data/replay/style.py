"""One look for every figure of the project: large type, thin axes, colours from `palette`, the same bytes each time."""

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib
from cycler import cycler
from matplotlib.figure import Figure

from jenga_data.errors import JengaError
from jenga_data.palette import BLUE, GREEN, INK, MUTED_INK, ORANGE, PAPER, PURPLE, SKY_BLUE, VERMILLION

DPI = 160
"""Pixels an inch of every saved figure."""

_STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib, so that pictures are alike on every machine
    "font.size": 13,
    "axes.titlesize": 13,
    "axes.labelsize": 13,
    "xtick.labelsize": 12,
    "ytick.labelsize": 12,
    "legend.fontsize": 12,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED_INK,
    "xtick.color": MUTED_INK,
    "ytick.color": MUTED_INK,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "axes.facecolor": PAPER,
    "figure.facecolor": PAPER,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "grid.color": (0.90, 0.91, 0.92),
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "lines.linewidth": 2.0,
    "lines.solid_capstyle": "round",
    "axes.prop_cycle": cycler(color=[BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY_BLUE]),
}


@contextmanager
def applied() -> Iterator[None]:
    """Draw in the project's style while the body runs, whatever the user's own matplotlibrc says."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        yield


def save(figure: Figure, path: Path) -> None:
    """Write a PNG that holds no date and no version, so that the same figure gives the same bytes.

    Raises:
        JengaError: the folder does not exist or the file cannot be written.
    """
    picture = BytesIO()
    figure.savefig(picture, dpi=DPI, format="png", metadata={"Software": None})
    try:
        path.write_bytes(picture.getvalue())
    except OSError as error:
        raise JengaError(f"cannot write {path}: {error.strerror or error}; choose another path") from error
