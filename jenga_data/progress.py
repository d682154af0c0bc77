"""Progress bars on stderr, for people only: nothing is drawn when stderr is no terminal."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, runtime_checkable


@runtime_checkable
class Bar(Protocol):
    """What a caller may tell a bar."""

    def advance(self, steps: float = 1, note: str = "") -> None: ...


@contextmanager
def progress(description: str, total: float | None) -> Iterator[Bar]:
    """Show a bar of `total` steps while the body runs; `note` stands behind it, e.g. counts by outcome."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=False) as shown:
        task = shown.add_task(description, total=total, note="")

        class _Bar:
            def advance(self, steps: float = 1, note: str = "") -> None:
                shown.advance(task, steps)
                if note:
                    shown.update(task, note=note)

        yield _Bar()
