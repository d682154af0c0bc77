"""Reports as Markdown and JSON: one way to write every number, and files that appear whole or not at all."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from jenga_data.errors import JengaError

MISSING = "–"


def make_folder(out: Path) -> None:
    """Make the folder of a report before the work begins that fills it.

    Raises:
        JengaError: the system refuses.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise JengaError(f"cannot write to {out}: {error.strerror}; choose another --out") from None


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


def in_points(difference: float, ci95: Sequence[float] | None) -> str:
    """A difference of two rates in percentage points, with its 95 % interval if it has one."""
    interval = f" [{', '.join(f'{100 * end:+.1f}' for end in ci95)}]" if ci95 else ""
    return f"{100 * difference:+.1f}{interval}"


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A pipe table: the first column to the left, numbers to the right. Every cell is written by `number`."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *[[number(cell) for cell in row] for row in rows]]
    if any(len(line) != len(header) for line in lines):
        raise ValueError(f"every row needs {len(header)} cells: {rows}")
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines) + "\n"


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
