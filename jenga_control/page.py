"""A folder of results as one HTML page that needs no server and no network: what `jenga demo` and `jenga report` leave.

A page is data: sections of paragraphs, key figures, tables, pictures, files and code, in the order given. Text is
escaped wherever it comes from; `like this` in a paragraph or a cell is set as code.
"""

import base64
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar
from urllib.parse import quote, unquote

import jinja2
from markupsafe import Markup, escape

from jenga_data.errors import JengaError

Cell = str | int | float | None
"""Floats are shown with three significant digits, whole numbers in full, None as a dash."""

_NUMBER = re.compile(r"\s*[-+−±~<>≤≥]?\s*\d")


@dataclass(frozen=True)
class KeyFigure:
    """One number that a reader should remember: `note` says n, interval or baseline."""

    value: str
    label: str
    note: str = ""


@dataclass(frozen=True)
class KeyFigures:
    """A row of key figures."""

    figures: Sequence[KeyFigure]
    kind: ClassVar[str] = "key_figures"


@dataclass(frozen=True)
class Table:
    """Rows of cells under a head. A column of numbers is set flush right."""

    head: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""
    kind: ClassVar[str] = "table"

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.head):
                raise ValueError(f"a row of {len(row)} cells under a head of {len(self.head)}: {row}")

    @property
    def numeric(self) -> list[bool]:
        """For each column, whether every cell that is not empty starts as a number."""
        columns = zip(*self.rows, strict=True) if self.rows else ([] for _ in self.head)
        filled = [[cell for cell in column if cell not in (None, "")] for column in columns]
        return [bool(cells) and all(_is_number(cell) for cell in cells) for cells in filled]


@dataclass(frozen=True)
class Figure:
    """A picture. `alt` says what it shows to those who do not see it; `embed` puts it into the page itself,
    `small` side by side with its neighbours."""

    path: Path
    alt: str
    caption: str = ""
    embed: bool = False
    small: bool = False
    kind: ClassVar[str] = "figure"


@dataclass(frozen=True)
class Files:
    """Files and folders, each with a few words, and the command that made them."""

    entries: Sequence[tuple[Path, str]]
    command: str = ""
    kind: ClassVar[str] = "files"


@dataclass(frozen=True)
class Code:
    """Commands or code to copy."""

    text: str
    caption: str = ""
    kind: ClassVar[str] = "code"


Block = str | KeyFigures | Table | Figure | Files | Code
"""A string is a paragraph."""


@dataclass(frozen=True)
class Section:
    """A titled part of the page."""

    title: str
    blocks: Sequence[Block]

    @property
    def anchor(self) -> str:
        """Its name in links within the page."""
        return re.sub(r"[^a-z0-9]+", "-", self.title.lower()).strip("-") or "section"


@dataclass(frozen=True)
class Page:
    """A whole page. `footer` says where everything came from, one line each."""

    title: str
    subtitle: str
    sections: Sequence[Section]
    key_figures: Sequence[KeyFigure] = ()
    footer: Sequence[str] = field(default_factory=tuple)


def write_page(out: Path, content: Page) -> None:
    """Write `content` as the HTML file `out`. Pictures and files are linked relative to its folder.

    Raises:
        JengaError: a picture or file does not exist, or `out` cannot be written.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    folder = out.parent
    environment.filters.update(prose=_prose, cell=_cell, size=_size)
    environment.filters["source"] = lambda figure: _source(figure, folder)
    environment.filters["link"] = lambda path: _link(path, folder)
    environment.filters["shown"] = lambda path: unquote(_link(path, folder))
    html = environment.get_template("page.html.jinja").render(page=content)
    partial = out.with_name(out.name + ".partial")
    try:
        partial.write_text(html, encoding="utf-8")
        partial.replace(out)
    except OSError as error:
        raise JengaError(f"cannot write {out}: {error.strerror or error}; choose another --out") from error


def _is_number(cell: Cell) -> bool:
    return isinstance(cell, int | float) or (isinstance(cell, str) and _NUMBER.match(cell) is not None)


def _prose(text: str) -> Markup:
    """Escape, then set what stands between backticks as code."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def _cell(value: Cell) -> Markup:
    if value is None:
        return Markup("–")
    if isinstance(value, float):
        shown = f"{value:,.0f}" if abs(value) >= 1000 else f"{value:#.3g}".rstrip(".")
        return Markup(escape(shown.replace("-", "−")))
    return _prose(str(value))


def _existing(path: Path) -> Path:
    if not path.exists():
        raise JengaError(f"the page refers to {path}, which does not exist; make it first or leave it out")
    return path


def _link(path: Path, folder: Path) -> str:
    """Relative to the page, so that the folder can be moved and mailed."""
    relative = os.path.relpath(_existing(path).resolve(), folder.resolve())
    return quote(Path(relative).as_posix()) + ("/" if path.is_dir() else "")


def _source(figure: Figure, folder: Path) -> str:
    if not figure.embed:
        return _link(figure.path, folder)
    kinds = {
        ".png": "image/png",
        ".jpg": "image/jpeg",
        ".gif": "image/gif",
        ".svg": "image/svg+xml",
        ".webp": "image/webp",
    }
    kind = kinds.get(figure.path.suffix.lower())
    if kind is None:
        raise JengaError(f"{figure.path} is no picture for a page; allowed: {', '.join(kinds)}")
    return f"data:{kind};base64," + base64.b64encode(_existing(figure.path).read_bytes()).decode("ascii")


def _size(path: Path) -> str:
    """Of a file, or of all files under a folder and how many there are."""
    if not _existing(path).is_dir():
        return _bytes(path.stat().st_size)
    files = [inner.stat().st_size for inner in path.rglob("*") if inner.is_file()]
    return f"{len(files)} files, {_bytes(sum(files))}"


def _bytes(count: float) -> str:
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.0f} {unit}" if unit == "B" or count >= 100 else f"{count:.1f} {unit}"
        count /= 1000
    return f"{count:.1f} GB"
