"""The JSON files that other commands leave, found again: a report is made of them and measures nothing itself."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from jenga_data.errors import JengaError

KINDS: dict[str, frozenset[str]] = {
    "dataset": frozenset({"name", "version", "format_version", "counts", "splits"}),
    "movable": frozenset({"movable", "middle", "side", "force_limit_n"}),
    "contacts": frozenset({"fallen", "drift_mm_per_s", "sag_mm"}),
    "ceiling": frozenset({"agreement", "accuracy_bounds"}),
    "rounds": frozenset({"rounds", "bias"}),
    "speed": frozenset({"speeds", "force_limit_n"}),
    "turntable": frozenset({"displaced_mm", "rested"}),
    "sleep": frozenset({"asleep_as_awake", "nudged_as_awake"}),
    "selection_report": frozenset({"rows", "poses", "learning_curve"}),
    "selection": frozenset({"accuracy", "auroc", "majority", "model"}),
    "dynamics": frozenset({"one_step", "rollout_5", "rollout_51"}),
    "extraction": frozenset({"success", "objective", "baselines"}),
    "extraction_report": frozenset({"ways", "best_straight", "any"}),
    "touch": frozenset({"erraticness", "auroc_same_speed"}),
}
"""Every kind of result by keys that only it has, whatever its file is called."""
_SPEED = frozenset({"value", "unit", "reference", "ratio"})
_MOST_BYTES = 50_000_000


@dataclass(frozen=True, eq=False)
class Result:
    """One file and what it says."""

    kind: str
    path: Path
    data: dict[str, Any]

    @property
    def size(self) -> int:
        """How many trials, pulls or towers are behind it: of several results of a kind the largest counts."""
        if self.kind == "dataset":
            return int(self.data["counts"].get("rows", 0)) if isinstance(self.data["counts"], dict) else 0
        found = [self.data.get(name) for name in ("n", "towers", "episodes")]
        found += [value.get("n") for value in self.data.values() if isinstance(value, dict)]
        return max((value for value in found if isinstance(value, int)), default=0)

    @property
    def speeds(self) -> dict[str, dict[str, Any]]:
        """The figures of a bench, by name."""
        return {name: value for name, value in self.data.items() if _is_speed(value)}


@dataclass(frozen=True, eq=False)
class Results:
    """All results below some folders; `passed_over` are JSON files that are none."""

    found: tuple[Result, ...]
    passed_over: tuple[Path, ...] = ()

    def of(self, kind: str) -> list[Result]:
        """All of a kind, the largest first, then by path."""
        return sorted((r for r in self.found if r.kind == kind), key=lambda r: (-r.size, str(r.path)))

    def best(self, kind: str) -> Result | None:
        """The one with the most behind it."""
        return next(iter(self.of(kind)), None)


def read_results(folders: Sequence[Path]) -> Results:
    """Every *.json below some folders, or the files themselves, that is a result.

    Raises:
        JengaError: a folder or file does not exist.
    """
    paths: list[Path] = []
    for folder in folders:
        if not folder.exists():
            raise JengaError(f"{folder} does not exist; name folders with the JSON files of other commands")
        paths += [folder] if folder.is_file() else sorted(folder.rglob("*.json"))
    found, passed_over = [], []
    for path in dict.fromkeys(path.resolve() for path in paths):
        result = _read(path)
        found.append(result) if result else passed_over.append(path)
    return Results(tuple(found), tuple(passed_over))


def _read(path: Path) -> Result | None:
    """What a file holds, None where that is no result: a folder of runs holds all kinds of JSON."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            return None
        data = msgspec.json.decode(path.read_bytes())
    except (OSError, msgspec.DecodeError, RecursionError):
        return None
    if not isinstance(data, dict):
        return None
    kind = next((name for name, keys in KINDS.items() if keys <= data.keys()), None)
    if kind is None and any(_is_speed(value) for value in data.values()):
        kind = "bench"
    return Result(kind, path, data) if kind else None


def _is_speed(value: Any) -> bool:
    return isinstance(value, dict) and value.keys() >= _SPEED
