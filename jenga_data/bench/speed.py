"""A measured speed as every bench reports it, and the table of many."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from jenga_data.report import markdown_table, number, with_interval
from jenga_data.statistics import Interval


@dataclass(frozen=True)
class Speed:
    """One figure beside what it is compared with.

    `ratio` is value / reference, `ci95` the interval of the value and `ratio_ci95` that of the ratio. A `limit` is
    what the ratio must not exceed, or, where `at_least`, must reach.
    """

    what: str
    """In words, for the table."""
    value: float
    unit: str
    reference: float
    n: int
    """Independent towers; steps of one tower are alike."""
    ci95: Interval | None = None
    ratio_ci95: Interval | None = None
    limit: float | None = None
    at_least: bool = False
    more: Mapping[str, Any] | None = None
    """Further keys of the JSON object."""

    @property
    def ratio(self) -> float:
        return self.value / self.reference

    @property
    def met(self) -> bool | None:
        """Whether the ratio keeps to its limit, None without one."""
        if self.limit is None:
            return None
        return self.ratio >= self.limit if self.at_least else self.ratio <= self.limit

    def as_dict(self) -> dict[str, Any]:
        """The form that every speed has in JSON."""
        own = {
            "value": self.value,
            "unit": self.unit,
            "reference": self.reference,
            "ratio": self.ratio,
            "n": self.n,
            "ci95": self.ci95,
            "ratio_ci95": self.ratio_ci95,
            "limit": self.limit,
            "met": self.met,
        }
        return own | dict(self.more or {})


def speed_table(speeds: Mapping[str, Speed]) -> str:
    """One line a figure, its name first."""
    header = ("figure", "value", "reference", "ratio", "limit", "n")
    return markdown_table(header, [_line(name, speed) for name, speed in speeds.items()])


def _line(name: str, speed: Speed) -> tuple[str, ...]:
    limit = "" if speed.limit is None else f"{'≥' if speed.at_least else '≤'} {number(speed.limit)}"
    if speed.met is False:
        limit += " (missed)"
    return (
        f"{name}: {speed.what}",
        f"{with_interval(speed.value, speed.ci95)} {speed.unit}",
        f"{number(speed.reference)} {speed.unit}",
        f"{speed.ratio:.3f}" + ("" if speed.ratio_ci95 is None else " [{:.3f}, {:.3f}]".format(*speed.ratio_ci95)),
        limit,
        number(speed.n),
    )
