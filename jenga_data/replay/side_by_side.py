"""Towers side by side in one figure, at one scale and from one side: rounds of a game, moments of an episode."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jenga_data.episode import Episode
from jenga_data.errors import JengaError
from jenga_data.palette import INK, MUTED_INK, block_colours
from jenga_data.replay import style
from jenga_data.replay.measures import MM, largest_displacement_of_others, seconds
from jenga_data.replay.moments import MOMENTS, Moment, telling_moments
from jenga_data.replay.paint import Stand
from jenga_data.replay.picture import free_azimuth, render_tower, robot_parts, tower_camera
from jenga_data.replay.raster import Camera
from jenga_data.replay.solids import Boxes
from jenga_data.replay.summary import outcome_words, target_words
from jenga_data.scenery import TURNTABLE_HEIGHT
from jenga_data.tower import TowerState

_PLATE = Stand(radius=0.064, floor=-TURNTABLE_HEIGHT)
"""What the towers of a grid stand on: just wider than a tower, so that they stand close together, and on the paper."""
_WIDEST = 400
"""Pixels: where blocks lie far apart, the pictures of a strip get lower and not wider, so that its type stays large."""
_LEAST_LETTER = 25.0
"""Height of the type in pixels: large enough to read when the whole figure is as wide as a page."""


def tower_grid(
    states: Sequence[TowerState],
    titles: Sequence[str],
    *,
    targets: Sequence[int | None] | None = None,
    columns: int = 8,
    height: int = 520,
) -> Figure:
    """Towers at one scale, `columns` in a row, each with its title below: the rounds of a game (paper, appendix).

    Args:
        targets: of each tower, drawn in its own colour; None for a tower without one.
        height: of each picture [pixels].
    """
    towers = [Boxes(s.pose, s.blocks.size, block_colours(s.layout.level)) for s in states]
    camera = tower_camera(towers, stand=_PLATE)
    lines = 1 + max(title.count("\n") for title in titles)
    grid = _Grid(len(titles), min(columns, len(titles)), camera, height, lines)
    with style.applied():
        figure = grid.figure()
        for number, (tower, title, target) in enumerate(
            zip(towers, titles, targets or [None] * len(towers), strict=True)
        ):
            where = grid.axes(figure, number, title)
            render_tower(
                where, tower.pose, tower.size,
                colours=tower.colour, target=target, camera=camera, height=height, stand=_PLATE,
            )  # fmt: skip
    return figure


def film_strip(episode: Episode, moments: Sequence[Moment] | None = None, height: int = 520) -> Figure:
    """Moments of an episode side by side, the target in its own colour, with the time below each.

    The title says how the episode ended and how far any block but the target came from its place.

    Args:
        moments: to show; by default those of `telling_moments`.
        height: of each picture [pixels], less where that would make it too wide.

    Raises:
        JengaError: the episode has no such frame.
    """
    moments = telling_moments(episode) if moments is None else moments
    count = len(episode.time_ns)
    for moment in moments:
        if not 0 <= moment.frame < count:
            raise JengaError(f"frame {moment.frame} is not in the episode; it has frames 0 to {count - 1}")
    size = episode.header.blocks.size
    colours = block_colours(episode.header.layout.level, episode.header.target)
    scenes = [(Boxes(episode.pose[m.frame], size, colours), robot_parts(episode, m.frame)) for m in moments]
    framed = [part for tower, parts in scenes for part in (tower, *parts)]
    camera = tower_camera(framed, azimuth=free_azimuth(episode))
    time = seconds(episode)
    # A robot takes room beside the tower: half as many pictures in a row.
    rows = 1 if episode.robot is None else 2
    height = min(height, round(rows * _WIDEST / camera.aspect))
    # A log that ends after a frame or two gets no narrower a figure, so that its title fits.
    title, what = strip_title(episode)
    heading = [*title.split("; ", rows - 1), what]
    grid = _Grid(len(moments), -(-max(MOMENTS, len(moments)) // rows), camera, height, lines=2, heading=len(heading))
    with style.applied():
        figure = grid.figure(*heading)
        for number, (moment, (tower, parts)) in enumerate(zip(moments, scenes, strict=True)):
            where = grid.axes(figure, number, f"{moment.name}\n{time[moment.frame]:.2f} s")
            render_tower(where, tower.pose, size, colours=colours, others=parts, camera=camera, height=height)
    return figure


def strip_title(episode: Episode) -> tuple[str, str]:
    """How the episode ended, with the largest displacement of another block; and what was pulled out of which tower."""
    moved = episode.result.verdict.moved if episode.result else float(largest_displacement_of_others(episode).max())
    far = f"{moved * MM:.1f} mm" if np.isfinite(moved) else "unknown"
    header = episode.header
    return (
        f"{outcome_words(episode)}; largest displacement of another block: {far}",
        f"{target_words(header)}, tower of round {header.round}, {header.kind} episode {header.number}",
    )


@dataclass(frozen=True)
class _Grid:
    """Where `count` pictures of exactly `height` pixels stand, so that none is resampled, below `heading` lines."""

    count: int
    columns: int
    camera: Camera
    height: int
    lines: int
    """Of text below each picture."""
    heading: int = 0

    @property
    def _letter(self) -> float:
        return max(_LEAST_LETTER, 0.05 * self.height)

    @property
    def _width(self) -> int:
        return max(1, round(self.height * self.camera.aspect))

    @property
    def _row(self) -> int:
        return self.height + round(self._letter * (0.6 + 1.3 * self.lines))

    @property
    def _pixels(self) -> tuple[int, int]:
        rows = -(-self.count // self.columns)
        return self.columns * self._width, rows * self._row + round(self._letter * 1.7 * self.heading)

    def figure(self, *heading: str) -> Figure:
        """An empty figure with its title, the first line large."""
        width, height = self._pixels
        figure = Figure(figsize=(width / style.DPI, height / style.DPI))
        for line, text in enumerate(heading):
            scale, colour = (1.25, INK) if line == 0 else (1.0, MUTED_INK)
            y = 1 - self._letter * (0.45 + 1.6 * line) / height
            figure.text(0.012, y, text, va="top", fontsize=self._points(scale), color=colour)
        return figure

    def axes(self, figure: Figure, number: int, caption: str) -> Axes:
        """Axes for the picture of that number, with a caption below the turntable."""
        width, height = self._pixels
        row, column = divmod(number, self.columns)
        rows = -(-self.count // self.columns)
        bottom = (rows - 1 - row) * self._row + self._row - self.height
        box = (column * self._width / width, bottom / height, self._width / width, self.height / height)
        left, right = self.camera.window[:2]
        axis = (self.camera.project(np.zeros(3))[0] - left) / (right - left)
        # Below the turntable, but not beyond the figure's edge: a letter is about half as wide as it is high.
        half = 0.33 * self._letter * max(map(len, caption.splitlines())) / width
        x = float(np.clip(box[0] + box[2] * np.clip(axis, 0.3, 0.7), min(half, 0.5), max(1 - half, 0.5)))
        y = (bottom - 0.2 * self._letter) / height
        figure.text(x, y, caption, ha="center", va="top", fontsize=self._points(), linespacing=1.2)
        return figure.add_axes(box)

    def _points(self, scale: float = 1.0) -> float:
        return scale * self._letter * 72 / style.DPI
