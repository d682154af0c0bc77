"""Towers in rows and columns with words: what the figures of pushes and of predictions are made of."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure, FigureBase

from jenga_data.palette import INK, MUTED_INK, error_colours
from jenga_data.replay.picture import AZIMUTH, render_tower, tower_camera
from jenga_data.replay.solids import Boxes, Faces

_INCHES = 2.9
"""Height of a picture."""
_PIXELS = 640


@dataclass(frozen=True, eq=False)
class Scene:
    """A tower, what else is there, and what stands below it."""

    pose: Float[np.ndarray, "block 7"]
    colours: Float[np.ndarray, "block 3"]
    caption: str
    others: Sequence[Boxes | Faces] = ()
    ghosts: Sequence[Boxes] = ()


@dataclass(frozen=True, eq=False)
class Row:
    """Scenes of one episode, seen from the same place."""

    title: str
    size: Float[np.ndarray, "block 3"]
    scenes: Sequence[Scene]
    azimuth: float = float(AZIMUTH)
    framed: int | None = None
    """So many of the first scenes must be in the picture, their towers alone; by default everything."""


def rows_figure(rows: Sequence[Row], full_scale: float | None = None) -> Figure:
    """Every row under its title. Call it with the project's style applied.

    Args:
        full_scale: where the colours of errors end [m], if there are any: they are explained on the right.
    """
    columns = max(len(row.scenes) for row in rows)
    figure = Figure(figsize=(3.0 * columns + 0.4, (_INCHES + 0.75) * len(rows)), layout="constrained")
    parts = np.atleast_1d(np.asarray(figure.subfigures(len(rows), 1), dtype=object))
    for part, row in zip(parts, rows, strict=True):
        part.suptitle(row.title, x=0.01, ha="left", fontsize=13, color=INK)
        boxes = [Boxes(scene.pose, row.size, scene.colours) for scene in row.scenes]
        around = [part for scene in row.scenes for part in (*scene.others, *scene.ghosts)]
        seen = [*boxes, *around] if row.framed is None else boxes[: row.framed]
        camera = tower_camera(seen, azimuth=row.azimuth)
        grid = np.atleast_1d(np.asarray(part.subplots(1, columns), dtype=object))
        for axes, scene in zip(grid, row.scenes, strict=False):
            render_tower(
                axes, scene.pose, row.size, colours=scene.colours, others=scene.others, ghosts=scene.ghosts,
                camera=camera, height=_PIXELS,
            )  # fmt: skip
            axes.text(0.5, -0.01, scene.caption, transform=axes.transAxes, ha="center", va="top", color=MUTED_INK)
        for axes in grid[len(row.scenes) :]:
            axes.set_axis_off()
        if full_scale is not None:
            _explain(part, list(grid), full_scale)
    return figure


def _explain(figure: FigureBase, grid: list[Axes], full_scale: float) -> None:
    steps = error_colours(np.linspace(0, full_scale, 256), full_scale)
    scale = ScalarMappable(Normalize(0, 1e3 * full_scale), ListedColormap(steps.tolist()))
    figure.colorbar(scale, ax=grid, location="right", fraction=0.03, aspect=30, extend="max", label="error [mm]")
