"""The two tables of the paper with ours beside them: what was measured, or the command that measures it."""

from dataclasses import dataclass
from textwrap import fill
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jenga_control.summary.results import Results
from jenga_data.palette import BLUE, MUTED_INK, VERMILLION
from jenga_data.report import number

SELECTION_COMMAND = "jenga report selection --dataset DATASET --models CKPT ... --ceiling CEILING.json --out DIR"
EXTRACTION_COMMAND = "jenga eval extraction --model CKPT --towers 100 --out DIR --json > extraction.json"


@dataclass(frozen=True)
class Line:
    """One row: what it is, the paper's proportion, ours, and what ours is of."""

    name: str
    paper: dict[str, Any] | None
    ours: dict[str, Any] | None
    note: str = ""
    is_model: bool = True


@dataclass(frozen=True)
class PaperTable:
    """A table of the paper; `missing` is the command that measures it where nothing did."""

    title: str
    quantity: str
    lines: tuple[Line, ...]
    source: str = ""
    missing: str = ""

    def rows(self) -> list[tuple[str, str, str, str]]:
        """Name, paper's, ours and note as text."""
        nothing = f"not measured: run `{self.missing}`" if self.missing else "–"
        return [
            (
                line.name,
                number(line.paper) if line.paper else "–",
                number(line.ours) if line.ours else nothing if line.paper else "–",
                line.note,
            )
            for line in self.lines
        ]


def of_counts(hits: int, n: int) -> dict[str, Any]:
    """A proportion with its 95 % Wilson interval, as the paper's tables lack it."""
    import numpy as np

    from jenga_data.statistics import Proportion

    return Proportion.of(np.arange(n) < hits).as_dict()


PAPER_SELECTION = {"G_sp": (248, 400), "G_s": (296, 400)}
"""Right predictions of 400 held-out rollouts (table I: 0.62 and 0.74)."""
PAPER_EXTRACTION = {"naive": (54, 100), "full": (65, 100)}
"""Extractions of 100 rollouts (table II: 0.54 and 0.65)."""
_GRAPHS = {
    "G_sp": "G_sp, includes 7-D pose",
    "G_s": "G_s, pose not encoded",
    "G_s+layout": "G_s+layout (not in the paper)",
}
_OBJECTIVES = {
    "naive": "O_a alone",
    "full": "O_a + O_d",
    "straight": "straight pull (trivial, not in the paper)",
}


def selection_table(results: Results) -> PaperTable:
    """Table I: accuracy by graph; then the trivial and the best baseline, and the ceiling."""
    title, quantity = "Table I: block selection", "accuracy on test towers"
    report = results.best("selection_report")
    paper = {graph: of_counts(*counts) for graph, counts in PAPER_SELECTION.items()}
    if report is None:
        lines = [Line(_GRAPHS[graph], paper[graph], None) for graph in paper]
        return PaperTable(title, quantity, (*lines, *_single_evaluations(results)), missing=SELECTION_COMMAND)
    rows = report.data["rows"]
    models = {name: row for name, row in rows.items() if row.get("kind") == "model"}
    lines = []
    for graph, label in _GRAPHS.items():
        own = [(name, row) for name, row in models.items() if row.get("graph") == graph]
        for position, (name, row) in enumerate(own):
            seeds = (row.get("seeds") or {}).get("n", 1)
            note = f"`{name}`" + (f", mean of {seeds} seeds" if seeds > 1 else "")
            lines.append(Line(label, paper.get(graph) if position == 0 else None, row["accuracy"], note))
        if not own and graph in paper:
            lines.append(Line(label, paper[graph], None, "no model with this graph in the report"))
    rest = [(name, row) for name, row in rows.items() if row.get("kind") != "model" and name != "majority"]
    if rest:
        name, row = max(rest, key=lambda item: item[1]["accuracy"]["rate"] or 0.0)
        lines.append(Line("best baseline", None, row["accuracy"], f"`{name}`, told {row['information']}", False))
    lines.append(Line("majority", None, report.data["majority"], "trivial", False))
    if ceiling := ceiling_of(results):
        low, high = ceiling["accuracy_bounds"]
        note = f"nobody can be above a value between {low:.3f} and {high:.3f}"
        lines.append(Line("ceiling: two pulls of a block agree", None, ceiling, note, False))
    return PaperTable(title, quantity, tuple(lines), str(report.path), SELECTION_COMMAND)


def ceiling_of(results: Results) -> dict[str, Any] | None:
    """How often two pulls of a block agree, with the bounds of anyone's accuracy: the report's, or measured apart."""
    report, measured = results.best("selection_report"), results.best("ceiling")
    if report is not None and report.data.get("ceiling"):
        return report.data["ceiling"]
    if measured is None:
        return None
    return measured.data["agreement"] | {"accuracy_bounds": measured.data["accuracy_bounds"]}


def _single_evaluations(results: Results) -> list[Line]:
    """What `jenga eval selection` said of single models, where there is no report of all."""
    return [
        Line(f"model {r.data['model']}", None, r.data["accuracy"], f"on {r.data.get('dataset', 'an unknown dataset')}")
        for r in results.of("selection")
    ]


def extraction_table(results: Results) -> PaperTable:
    """Table II: success by objective, and the straight pull."""
    title, quantity = "Table II: block extraction", "blocks extracted while the tower stands"
    paper = {name: of_counts(*counts) for name, counts in PAPER_EXTRACTION.items()}
    result = results.best("extraction") or results.best("extraction_report")
    if result is None:
        lines = tuple(Line(_OBJECTIVES[name], paper[name], None) for name in paper)
        return PaperTable(title, quantity, lines, missing=EXTRACTION_COMMAND)
    ways = by_way(result.data)
    lines = []
    for name, label in _OBJECTIVES.items():
        if name not in ways and name not in paper:
            continue
        own = ways.get(name)
        hz = (own or {}).get("control_hz")
        note = f"decides at {hz:.1f} Hz" if hz and name != "straight" else ""
        lines.append(Line(label, paper.get(name), own["success"] if own else None, note, name != "straight"))
    others = [(name, own) for name, own in ways.items() if name not in _OBJECTIVES]
    for name, own in others:
        best = name.startswith("hindsight")
        note = "ceiling: the best of several pulls, chosen in hindsight" if best else "not in the paper"
        lines.append(Line(name, None, own["success"], note, not (best or name.startswith("straight"))))
    return PaperTable(title, quantity, tuple(lines), str(result.path), EXTRACTION_COMMAND)


def by_way(report: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Every way to pull of an evaluation, or of a report of several, by its name."""
    if "ways" in report:
        return {name: own for name, own in report["ways"].items() if "success" in own}
    first = str(report["objective"])
    ways = {"straight" if first.startswith("straight") else first: report}
    return ways | {name: own for name, own in report["baselines"].items() if "success" in own}


def tables_figure(tables: list[PaperTable]) -> Figure:
    """Both tables as points with 95 % intervals. Call it with the project's style applied."""
    counts = [len(table.lines) for table in tables]
    figure = Figure(figsize=(11.0, 1.6 + 0.62 * sum(counts) + 0.8 * len(tables)), layout="constrained")
    grid = figure.subplots(len(tables), 1, squeeze=False, height_ratios=[count + 1.0 for count in counts])[:, 0]
    for axes, table in zip(grid, tables, strict=True):
        _draw(axes, table)
    handles = [
        grid[0].plot([], [], "D", color=MUTED_INK, label="the paper")[0],
        grid[0].plot([], [], "o", color=BLUE, label="ours")[0],
        grid[0].plot([], [], "s", color=VERMILLION, label="ours: baseline or ceiling")[0],
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=3)
    return figure


def _draw(axes: Axes, table: PaperTable) -> None:
    places = [-float(i) for i in range(len(table.lines))]
    for y, line in zip(places, table.lines, strict=True):
        look = ("o", BLUE) if line.is_model else ("s", VERMILLION)
        shifts = (0.17, -0.17) if line.paper else (0.0, 0.0)
        looks = (("D", MUTED_INK), look)
        for shift, value, (marker, colour) in zip(shifts, (line.paper, line.ours), looks, strict=True):
            if value is None or value.get("rate") is None:
                continue
            low, high = zip(value["ci95"], value.get("ci95_towers") or value["ci95"], strict=True)
            axes.hlines(y + shift, min(low), max(high), color=colour)
            axes.plot(value["rate"], y + shift, marker, color=colour, clip_on=False, zorder=3)
            axes.text(1.03, y + shift, number(value), transform=axes.get_yaxis_transform(), va="center", fontsize=11)
        if line.paper and not line.ours:
            axes.text(1.03, y - 0.17, "ours: not measured", transform=axes.get_yaxis_transform(), va="center",
                      fontsize=11, color=MUTED_INK)  # fmt: skip
    axes.set_yticks(places, [fill(line.name, 24) for line in table.lines])
    axes.set(xlim=(0.0, 1.0), ylim=(places[-1] - 0.6, 0.6), xlabel=f"{table.quantity}, 95 % interval")
    axes.set_title(table.title, loc="left")
    axes.grid(visible=False, axis="y")
