"""One calibration: its cases, and how its report is written as JSON, Markdown and a plot."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from jenga_data.calibrate.cases import Case, run_cases
from jenga_data.collect.config import check_seed
from jenga_data.errors import JengaError
from jenga_data.replay import style
from jenga_data.report import write_report


@dataclass(frozen=True)
class Run:
    """How a calibration is run: seeds from `seed` on decide its towers, `out` keeps its cases and its report."""

    towers: int
    seed: int
    workers: int
    out: Path

    def __post_init__(self) -> None:
        if self.towers < 1:
            raise JengaError(f"towers is {self.towers}; allowed: 1 or more")
        check_seed(self.seed)

    def cases(self, label: str, cases: Sequence[Case]) -> list[dict[str, Any]]:
        return run_cases(cases, self.out / f"{label}.jsonl", self.workers, label)

    def draw(self, name: str, figure: Callable[[], Figure]) -> Path:
        """A plot on its own."""
        path = self.out / f"{name}.png"
        with style.applied():
            style.save(figure(), path)
        return path

    def write(self, name: str, report: dict[str, Any], text: str, figure: Callable[[], Figure]) -> dict[str, Any]:
        """Write the report and its plot; the report says where, and with which text it was printed."""
        picture = self.draw(name, figure)
        written = write_report(self.out, name, report, f"{text}\n![{name}]({picture.name})\n")
        return report | {"written": [str(path) for path in (*written, picture)], "text": text}


def quantiles(values: Float[np.ndarray, " value"]) -> dict[str, float | None]:
    """What describes a distribution in a few numbers; None where there are no values."""
    names = ("smallest", "5 %", "median", "95 %", "largest")
    if len(values) == 0:
        return dict.fromkeys(names)
    return dict(zip(names, map(float, np.quantile(values, [0, 0.05, 0.5, 0.95, 1])), strict=True))
