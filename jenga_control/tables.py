"""Evaluations as Markdown and JSON: one way to write every number, and files that appear whole or not at all."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

MISSING = "–"


def number(value: Any) -> str:
    """One value as it stands in any table.

    A proportion shows its n and the outer bounds of its intervals: the one over towers knows that rows of a tower
    are alike, but shrinks to nothing where all rows agree. Counts are whole; other numbers have two decimals, three
    significant digits below 0.1.
    """
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return MISSING
    if isinstance(value, dict):
        low, high = zip(value["ci95"], value.get("ci95_towers") or value["ci95"], strict=True)
        return f"{with_interval(value['rate'], (min(low), max(high)))} (n = {value['n']:,})"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:.2f}" if value == 0 or abs(value) >= 0.1 else f"{value:.3g}"
    return str(value)


def with_interval(value: float | None, ci95: Sequence[float] | None) -> str:
    """A value and its 95 % interval, if it has one."""
    if value is None or ci95 is None:
        return number(value)
    return f"{number(value)} [{number(float(ci95[0]))}, {number(float(ci95[1]))}]"


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A pipe table: the first column to the left, numbers to the right. Every cell is written by `number`."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *[[number(cell) for cell in row] for row in rows]]
    if any(len(line) != len(header) for line in lines):
        raise ValueError(f"every row needs {len(header)} cells: {rows}")
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines) + "\n"


def selection_tables(report: dict[str, Any]) -> str:
    """An evaluation of a selector: the paper's table I with baselines and ceiling, then by slot and round."""
    by_label = [("majority", report["majority"])]
    by_label += [(name, entry["accuracy"]) for name, entry in report["baselines"].items() if name != "majority"]
    rows = [
        (name, accuracy, report["baselines"][name]["model_minus_baseline"]["p_value"]) for name, accuracy in by_label
    ]
    parts = [
        markdown_table(
            ("Predictor", "Accuracy", "p against the model"),
            [*rows, ("**model**", report["accuracy"], None), ("ceiling", report["ceiling"], None)],
        ),
        markdown_table(
            ("Probabilities", "Value"),
            [
                (label, with_interval(report[key], report.get(f"{key}_ci95")))
                for label, key in (("AUROC", "auroc"), ("Brier score", "brier"), ("calibration error", "ece"))
            ],
        ),
    ]
    for title, key in (("Slot", "by_slot"), ("Round", "by_round"), ("Outcome", "by_outcome")):
        groups = [(name, group["accuracy"], group["failures"]) for name, group in report[key].items()]
        parts.append(markdown_table((title, "Accuracy", "Failures"), groups))
    return "\n".join(parts)


def dynamics_tables(report: dict[str, Any]) -> str:
    """An evaluation of a dynamics model: skill and error by horizon, then the rows reported apart, if there are any."""
    titles = {"one_step": "1 step", "rollout_5": "5 steps", "rollout_51": "51 steps"}
    groups = {"": "pull", "after_clear": "target clear", "collapse": "collapse"}
    rows = []
    for key, kind in groups.items():
        for name, steps in titles.items():
            entry = report[name][key] if key else report[name]
            if key and entry["n"] == 0:
                continue
            rows += [
                (
                    f"{kind}, {steps}, {who}",
                    with_interval(entry[f"skill_{who}"], entry[f"skill_{who}_ci95"]),
                    *(entry[f"{prefix}rmse_{unit}_{who}"] for unit in ("mm", "deg") for prefix in ("", "trivial_")),
                    entry["n"],
                )
                for who in ("others", "target")
            ]
    header = ("Rows", "Skill", "RMSE [mm]", "trivial [mm]", "RMSE [deg]", "trivial [deg]", "n")
    return markdown_table(header, rows)


def extraction_tables(reports: Sequence[dict[str, Any]]) -> str:
    """Evaluations of the closed loop side by side, then why each failed."""
    rows = [
        (
            report["objective"],
            report["dynamics"],
            ", ".join(sorted(name for name, on in report["switches"].items() if on)) or "none",
            report["success"],
            report["control_hz"],
        )
        for report in reports
    ]
    causes = sorted({cause for report in reports for cause in report["causes"]})
    parts = [markdown_table(("Objective", "Dynamics", "Switches", "Success", "Decisions a second"), rows)]
    if causes:
        header = ("Cause of failure", *(f"{report['objective']}, {report['dynamics']}" for report in reports))
        counts = [(cause or "none given", *(report["causes"].get(cause, 0) for report in reports)) for cause in causes]
        parts.append(markdown_table(header, counts))
    return "\n".join(parts)


def to_json(report: Any) -> str:
    """Indented JSON; a NaN, which JSON does not have, becomes null."""
    return msgspec.json.format(msgspec.json.encode(report), indent=2).decode() + "\n"


def write_text(path: Path, text: str) -> Path:
    """Write beside `path` and rename into it, so that a reader never sees half a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)
    return path


def write_report(folder: Path, name: str, report: Any, tables: str) -> tuple[Path, Path]:
    """`name.json` and `name.md` in `folder`."""
    return write_text(folder / f"{name}.json", to_json(report)), write_text(folder / f"{name}.md", tables)
