"""Which of the paper's findings replicate here: a verdict from the intervals, never from the point estimates alone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from jenga_control.summary.paper_tables import EXTRACTION_COMMAND, SELECTION_COMMAND, by_way
from jenga_control.summary.results import Result, Results
from jenga_data.report import number, with_interval

REPLICATES, OPEN, CONTRADICTED = "replicates", "open: not shown by these data", "contradicted"
SLOWER, MISSING = "not reached on this machine", "not measured"
_FAST = 27.0
"""About 30 Hz [Hz]."""


FEWEST = 30
"""Trials below which no finding is decided."""


@dataclass(frozen=True)
class Finding:
    """What the paper found, what was found here, and whether that agrees."""

    claim: str
    paper: str
    here: str
    verdict: str
    command: str


def findings(results: Results) -> list[Finding]:
    """Every finding that the project can test; a result that cannot be read counts as not measured."""
    return [
        _finding("Poses do not help selection", "G_sp 0.62, G_s 0.74, n = 400", results, "selection_report", _poses,
                 SELECTION_COMMAND),
        _finding("A graph network beats guessing which block fails", "0.74, n = 400", results, "selection_report",
                 _above_majority, SELECTION_COMMAND),
        _finding("The full objective beats O_a alone", "0.65 against 0.54, n = 100", results, "extraction", _objectives,
                 EXTRACTION_COMMAND),
        _finding("Control with the learned model runs at about 30 Hz", "~30 Hz", results, "extraction", _rate,
                 EXTRACTION_COMMAND),
        _finding("Many failures come from bad pushes", "many of 35", results, "extraction", _pushes,
                 EXTRACTION_COMMAND),
        _finding("Forces at the fingertips are more erratic in failures", "one example of each", results, "touch",
                 _touch, "jenga report touch LOGS --out DIR"),
        _finding("47 % of the blocks of a fresh tower are movable", "0.47", results, "movable", _movable,
                 "jenga calibrate movable --towers 25 --out DIR"),
    ]  # fmt: skip


def _finding(
    claim: str,
    paper: str,
    results: Results,
    kind: str,
    look: Callable[[dict[str, Any]], tuple[str, str] | None],
    command: str,
) -> Finding:
    result = results.best(kind) or results.best(f"{kind}_report")
    seen = _looked(result, look)
    here, verdict = seen or (f"not measured: run `{command}`", MISSING)
    return Finding(claim, paper, here, verdict, command)


def _looked(result: Result | None, look: Callable[[dict[str, Any]], tuple[str, str] | None]) -> tuple[str, str] | None:
    if result is None:
        return None
    try:
        return look(result.data)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError):  # of another version, or edited by hand
        return None


def above(ci95: Sequence[float] | None, level: float, n: int) -> str:
    """Whether a quantity is shown to lie above a level, below it, or neither.

    With fewer than `FEWEST` trials it stays open: an interval drawn from a handful of towers is far too short.
    """
    if ci95 is None or n < FEWEST:
        return OPEN
    low, high = ci95
    return REPLICATES if low > level else CONTRADICTED if high < level else OPEN


_NO_BENEFIT = 0.02
"""A gain in accuracy by less than this counts as none."""


def _poses(report: dict[str, Any]) -> tuple[str, str] | None:
    models = [pair for pair in report["poses"] if report["rows"][pair["with"]].get("kind") == "model"]
    pairs = models or report["poses"]
    if not pairs:
        return None
    pair = max(pairs, key=lambda pair: pair["n"])
    low, high = pair["ci95"] or (None, None)
    helps = low is not None and low > 0
    verdict = CONTRADICTED if helps else REPLICATES if high is not None and high <= _NO_BENEFIT else OPEN
    verdict = verdict if pair["n"] >= FEWEST else OPEN
    note = "" if models else " (baselines, no graph networks)"
    return pair["sentence"] + note, verdict


def _above_majority(report: dict[str, Any]) -> tuple[str, str] | None:
    models = {name: row for name, row in report["rows"].items() if row.get("kind") == "model"}
    plain = {name: row for name, row in models.items() if row.get("graph") == "G_s"} or models
    if not plain:
        return None
    name, row = max(plain.items(), key=lambda item: item[1]["accuracy"]["rate"])
    accuracy, majority = row["accuracy"], report["majority"]
    low, high = zip(accuracy["ci95"], accuracy.get("ci95_towers") or accuracy["ci95"], strict=True)
    here = f"`{name}` {number(accuracy)}; majority {majority['rate']:.2f}"
    return here, above((min(low), max(high)), majority["rate"], accuracy["n"])


def _objectives(report: dict[str, Any]) -> tuple[str, str] | None:
    ways = by_way(report)
    if not {"full", "naive"} <= ways.keys():
        return None
    paired = ways["naive"].get("paired") if report.get("objective") == "full" else None
    here = f"{number(ways['full']['success'])} against {number(ways['naive']['success'])}"
    if not paired:
        return here, OPEN
    here += (
        f"; paired difference {with_interval(paired['difference'], paired['ci95'])}, p = {number(paired['p_value'])}"
    )
    return here, above(paired["ci95"], 0.0, paired["n"])


def _rate(report: dict[str, Any]) -> tuple[str, str] | None:
    hz = (by_way(report).get("full") or {}).get("control_hz")
    if hz is None:
        return None
    return f"{hz:.1f} decisions a second on the machine of the evaluation", REPLICATES if hz >= _FAST else SLOWER


def _pushes(report: dict[str, Any]) -> tuple[str, str] | None:
    causes = (by_way(report).get("full") or report)["causes"]
    failed = sum(causes.values())
    pushed = sum(count for cause, count in causes.items() if cause.startswith("push_"))
    if not failed:
        return None
    share = pushed / failed
    return f"{pushed} of {failed} failures have a bad push as their cause", REPLICATES if share >= 0.25 else OPEN


def _touch(report: dict[str, Any]) -> tuple[str, str] | None:
    same, plain = report["auroc_same_speed"], report["auroc"]
    if plain["value"] is None:
        return None
    here = f"AUROC {with_interval(plain['value'], plain['ci95'])}, n = {plain['n']}"
    if same["value"] is not None:
        here += f"; among pulls of the same speed {with_interval(same['value'], same['ci95'])}"
    decisive = same if same["value"] is not None else plain
    return here, above(
        decisive["ci95"], 0.5, min(report["erraticness"][group]["n"] for group in ("success", "failure"))
    )


def _movable(report: dict[str, Any]) -> tuple[str, str] | None:
    found = report["movable"]
    low, high = zip(found["ci95"], found.get("ci95_towers") or found["ci95"], strict=True)
    here = f"{number(found)} at friction {report['friction']:g} (tuned to this number)"
    return here, REPLICATES if min(low) <= 0.47 <= max(high) else CONTRADICTED
