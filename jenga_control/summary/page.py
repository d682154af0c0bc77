"""`jenga report page`: one self-contained HTML file over everything that was measured, for who has two minutes."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from jenga_control.page import Block, Code, Figure, KeyFigure, Page, Section, Table, write_page
from jenga_control.summary.departures import departures
from jenga_control.summary.findings import MISSING, REPLICATES, Finding, findings
from jenga_control.summary.paper_tables import (
    EXTRACTION_COMMAND,
    SELECTION_COMMAND,
    PaperTable,
    ceiling_of,
    extraction_table,
    selection_table,
)
from jenga_control.summary.results import Results
from jenga_control.summary.sections import calibration, control, datasets, dynamics, selection, speed, touch
from jenga_data.report import number

NAME = "report.html"
_UNREADABLE = (KeyError, TypeError, ValueError, IndexError, AttributeError)
"""What a result of another version, or one edited by hand, can cause; a page is made of the rest."""


def report_page(out: Path, results: Results, figures: dict[str, Any] | None = None) -> dict[str, Any]:
    """Write the page into the folder `out`.

    Args:
        figures: what `jenga_control.summary.figures.report_figures` returned.

    Returns:
        Where the page is, the verdict on each finding, and which parts were not measured, with their commands.

    Raises:
        JengaError: `out` cannot be written.
    """
    found = findings(results)
    tables = [_read(lambda r=results, make=make: make(r)) for make in (selection_table, extraction_table)]
    drawn = [figure for figure in (figures or {}).get("figures", []) if figure["path"]]
    by_name = {figure["name"]: figure for figure in drawn}
    parts: list[tuple[str, Callable[[], Sequence[Block]]]] = [
        ("What replicates", lambda: _findings(found)),
        ("The paper's tables and ours", lambda: _paper_tables([t for t in tables if t], by_name)),
        ("Datasets", lambda: datasets(results)),
        ("Calibration", lambda: calibration(results)),
        ("Which block: selection", lambda: selection(results)),
        ("How the tower moves: dynamics", lambda: dynamics(results)),
        ("Pulling blocks: control", lambda: control(results)),
        ("Touch", lambda: touch(results)),
        ("Speed", lambda: speed(results)),
        ("Figures of the paper", lambda: _pictures(figures)),
        ("Where this project departs from the paper", _departures),
        ("How this page was made", lambda: _sources(results)),
    ]
    sections = [Section(title, _read(make) or [_damaged(title)]) for title, make in parts]
    page = Page(
        title="Jenga: what was found",
        subtitle="Learning to play Jenga with graph networks: data, models and control in simulation, beside the paper "
        "that they follow.",
        sections=sections,
        key_figures=_key_figures(results, found),
        footer=[
            "Every rate stands with its n and a 95 % interval, which is over towers where a tower has several pulls.",
            "Method: Puthuveetil, Zhang, Yokoyama, Narita, Strategic Jenga Play via Graph Based Dynamics Modeling "
            "(arXiv 2505.09377).",
        ],
    )
    path = out / NAME
    write_page(path, page)
    return {
        "page": str(path),
        "findings": {finding.claim: finding.verdict for finding in found},
        "results": len(results.found),
        "passed_over": [str(p) for p in results.passed_over],
    }


def _read(make: Callable[[], Any]) -> Any:
    """What is made, or None where a result is damaged."""
    try:
        return make()
    except _UNREADABLE:
        return None


def _damaged(title: str) -> str:
    return f"{title}: a result is there but cannot be read; make it again with this version, see its command below."


def _key_figures(results: Results, found: Sequence[Finding]) -> list[KeyFigure]:
    held = sum(finding.verdict == REPLICATES for finding in found)
    measured = sum(finding.verdict != MISSING for finding in found)
    note = f"of {len(found)}; the table says which"
    figures = [KeyFigure(f"{held} of {measured}", "measured findings of the paper replicate", note)]
    figures += _read(lambda: _scores(results)) or []
    return figures


def _scores(results: Results) -> list[KeyFigure]:
    shown = []
    report, extraction = results.best("selection_report"), results.best("extraction")
    if report is not None and report.data.get("best"):
        accuracy = report.data["rows"][report.data["best"]]["accuracy"]
        note = f"n = {accuracy['n']:,}; majority {_percent(report.data['majority']['rate'])}"
        if ceiling := ceiling_of(results):
            note += f"; ceiling {_percent(ceiling['accuracy_bounds'][1])}"
        shown.append(KeyFigure(_percent(accuracy["rate"]), "of pulls predicted right", note))
    if extraction is not None:
        success = extraction.data["success"]
        low, high = success["ci95"]
        note = f"n = {success['n']}, 95 % interval {_percent(low)} to {_percent(high)}"
        shown.append(KeyFigure(_percent(success["rate"]), "of random legal blocks extracted", note))
    if sets := results.of("dataset"):
        rows = sum(result.data["counts"]["rows"] for result in sets)
        shown.append(KeyFigure(f"{rows:,}", "graphs in datasets", f"{len(sets)} datasets, Parquet with manifests"))
    return shown


def _percent(rate: float | None) -> str:
    return "–" if rate is None else f"{100 * rate:.0f} %"


def _findings(found: Sequence[Finding]) -> list[Block]:
    rows = [(f.claim, f.paper, f.here, f.verdict) for f in found]
    return [
        "A finding replicates only where the whole 95 % interval says so; where the interval holds both answers, it "
        "stays open.",
        Table(("What the paper found", "The paper", "Here", "Verdict"), rows),
    ]


def _paper_tables(tables: Sequence[PaperTable], drawn: dict[str, Any]) -> list[Block]:
    blocks: list[Block] = ["The paper gives no intervals: those beside its numbers are Wilson intervals of its counts."]
    if "tables" in drawn:
        alt = "The two tables of the paper as points with intervals, ours beside them"
        blocks.append(Figure(Path(drawn["tables"]["path"]), alt, embed=True))
    for table in tables:
        blocks.append(Table((table.title, "The paper", "Ours", "Note"), table.rows(), table.quantity))
    blocks.append(Code(f"{SELECTION_COMMAND}\n{EXTRACTION_COMMAND}", "Made by:"))
    return blocks


def _pictures(figures: dict[str, Any] | None) -> list[Block]:
    command = "jenga report page --out DIR --results DIR... --selection LOGS --extraction LOGS --models CKPT..."
    if figures is None:
        return [f"None were drawn; give the logs: `{command}`."]
    blocks: list[Block] = ["Episodes are chosen by the rule below each picture, never by hand."]
    for figure in figures["figures"]:
        if figure["name"] == "tables":
            continue
        if not figure["path"]:
            blocks.append(f"{figure['title']}: not drawn; {figure['missing']}.")
            continue
        shows = ", ".join(f"`{key}`" for key in figure["shows"][:4])
        more = f" and {len(figure['shows']) - 4} more" if len(figure["shows"]) > 4 else ""
        caption = f"{figure['title']}: {figure['rule']}. Episodes {shows}{more}."
        blocks.append(Figure(Path(figure["path"]), figure["title"], caption, embed=True))
    return [*blocks, Code(command, "Made by:")]


def _departures() -> list[Block]:
    rows = [(d.what, d.paper, d.here, d.why) for d in departures()]
    return [
        "Where the paper is silent and something had to be chosen, that counts as a departure too.",
        Table(("What", "The paper", "Here", "Why"), rows),
    ]


def _sources(results: Results) -> list[Block]:
    rows = [(r.kind.replace("_", " "), f"`{r.path.parent.name}/{r.path.name}`", r.size or None) for r in results.found]
    blocks: list[Block] = [
        "This page measures nothing: it reads the JSON files that the commands above left. Of several results of a "
        "kind the one with the most behind it is shown.",
    ]
    if rows:
        blocks.append(Table(("Kind", "File", "Largest n in it"), sorted(rows)))
    else:
        blocks.append("No results were given: name the folders of other commands' outputs with `--results`.")
    if results.passed_over:
        blocks.append(f"{number(len(results.passed_over))} other JSON files were passed over: they are no results.")
    return blocks
