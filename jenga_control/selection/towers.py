"""Towers drawn from both sides, every legal block coloured by how likely pulling it fails, with what truly happened."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int, Shaped
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from jenga_data.blocks import NOMINAL_SIZE, Blocks
from jenga_data.outcome import Outcome
from jenga_data.palette import INK, MUTED_INK, PAPER, probability_colours
from jenga_data.tower import CENTRE, Layout, TowerState
from jenga_models.checkpoint import Checkpoint
from jenga_models.columns import Rows
from jenga_models.predict import Selector

Rgb = tuple[float, float, float]

COUNT = 4
MARKS = {Outcome.EXTRACTED: "o", Outcome.STUCK: "s", Outcome.COLLAPSED: "X"}
_GRAIN = "--"
"""On a block that lies across the view: which one it is cannot be seen, and it has no colour of its own."""
_LEFT_OUT = (0.81, 0.82, 0.835)
"""A block that may not be pulled: half way from the colour of what is not known to white."""


def shown_towers(dataset: Rows, rows: Int[np.ndarray, " row"], count: int = COUNT) -> Shaped[np.ndarray, " tower"]:
    """Test towers with the most pulls each, spread evenly over the rounds: no one chooses the pretty ones."""
    tower, played = dataset.column("tower")[rows], dataset.column("round")[rows]
    names, first, pulled = np.unique(tower, return_index=True, return_counts=True)
    most = np.flatnonzero(pulled == pulled.max())
    order = most[np.lexsort((names[most], played[first[most]]))]
    picked = np.unique(np.linspace(0, len(order) - 1, min(count, len(order))).round().astype(int))
    return names[order[picked]]


def towers_figure(
    dataset: Rows,
    rows: Int[np.ndarray, " row"],
    towers: Shaped[np.ndarray, " tower"],
    models: Sequence[Checkpoint],
) -> Figure:
    """Each tower from its two sides; colours are the mean probability of the models, marks the outcomes of pulls."""
    figure = Figure(figsize=(2.0 + 3.0 * len(towers), 8.2), layout="constrained")
    grid = np.asarray(figure.subplots(1, 2 * len(towers), sharey=True), dtype=object)
    selectors = [Selector(model) for model in models]
    tower = dataset.column("tower")[rows]
    highest = 0
    for number, name in enumerate(towers):
        own = rows[tower == name]
        state = state_of(dataset, int(own[0]))
        legal = state.layout.legal_targets()
        chance = np.full(len(state.blocks), np.nan)
        chance[legal] = np.mean([s.failure_probability(state, legal) for s in selectors], axis=0)
        outcome = dict(
            zip(dataset.column("target")[own].tolist(), dataset.column("outcome")[own].tolist(), strict=True)
        )
        for side in (0, 1):
            _view(grid[2 * number + side], state.layout, side, chance, outcome)
            grid[2 * number + side].set_xlabel("even levels" if side == 0 else "odd levels")
        grid[2 * number].set_title(f"round {state.layout.round}", loc="left")
        highest = max(highest, len(state.layout.grid))
    grid[0].set_ylim(-0.3, highest * NOMINAL_SIZE[2] * 1e3 + 2)
    _explain(figure, grid, set(dataset.column("outcome")[rows[np.isin(tower, towers)]]))
    return figure


def state_of(dataset: Rows, row: int) -> TowerState:
    """The tower of one row, as it stood before the pull."""
    size, mass, pose = (dataset.column(f"block_{name}")[row].astype(float) for name in ("size", "mass", "pose"))
    level, slot = (dataset.column(name)[row].astype(np.int64) for name in ("level", "slot"))
    layout = Layout.from_places(level, slot, int(dataset.column("round")[row]) - 1)
    return TowerState(Blocks(size, mass), layout, pose, np.zeros((len(mass), 6)))


def _view(axes: Axes, layout: Layout, side: int, chance: Float[np.ndarray, " block"], outcome: dict[int, str]) -> None:
    """One side: the blocks of every other level show their ends, those between lie across."""
    length, width, height = (1e3 * edge for edge in NOMINAL_SIZE)
    colours = probability_colours(chance)
    for level in range(len(layout.grid)):
        if level % 2 != side:
            axes.add_patch(_across(-length / 2, level * height, length, height))
    for block, place in layout:
        if place.level % 2 != side:
            continue
        # Seen from -x (even levels) slot 0 is on the right; seen from -y (odd levels) as well.
        x = -(place.slot - CENTRE) * width
        legal = np.isfinite(chance[block])
        red, green, blue = colours[block] if legal else _LEFT_OUT
        axes.add_patch(_face(x - width / 2, place.level * height, width, height, (red, green, blue)))
        if block in outcome:
            axes.plot(
                x, (place.level + 0.5) * height, MARKS[Outcome(outcome[block])], markersize=8, color=PAPER,
                markeredgecolor=INK, markeredgewidth=1.6,
            )  # fmt: skip
    axes.set_xlim(-length / 2 - 3, length / 2 + 3)
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)


def _face(x: float, y: float, width: float, height: float, colour: Rgb) -> Rectangle:
    return Rectangle((x, y), width, height, facecolor=colour, edgecolor=MUTED_INK, linewidth=0.7)


def _across(x: float, y: float, width: float, height: float) -> Rectangle:
    return Rectangle((x, y), width, height, facecolor=PAPER, edgecolor=_LEFT_OUT, linewidth=0.7, hatch=_GRAIN)


def _explain(figure: Figure, grid: np.ndarray, seen: set[str]) -> None:
    steps = probability_colours(np.linspace(0, 1, 256))
    bar = figure.colorbar(
        ScalarMappable(Normalize(0, 1), ListedColormap(steps.tolist())),
        ax=grid.tolist(), location="right", fraction=0.03, aspect=40,
    )  # fmt: skip
    bar.set_label("predicted probability of failure")
    marks = [
        Line2D([], [], linestyle="", marker=MARKS[o], color=PAPER, markeredgecolor=INK, markersize=8, label=f"was {o}")
        for o in MARKS
        if o in seen
    ]
    grey = Rectangle((0, 0), 1, 1, facecolor=_LEFT_OUT, edgecolor=MUTED_INK, label="no legal target")
    across = _across(0, 0, 1, 1)
    across.set_label("lies across this view")
    figure.legend(handles=[*marks, grey, across], loc="outside lower center", ncols=5)
