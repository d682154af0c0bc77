"""`jenga report extraction`: who pulls how well, from the logs that evaluations left in one or more folders."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from jenga_control.extraction.evaluate import PAPER
from jenga_control.extraction.figures import causes_figure, rounds_figure, speed_figure
from jenga_control.extraction.scores import Ended, clean, paired, scores, succeeded, switch_words
from jenga_control.tables import extraction_report_tables
from jenga_data.clock import CONTROL_STEP_NS
from jenga_data.collect.workers import RECIPE
from jenga_data.errors import JengaError
from jenga_data.log.actions import read_actions
from jenga_data.log.reader import read_header
from jenga_data.progress import progress
from jenga_data.replay import style
from jenga_data.report import write_report
from jenga_data.statistics import Proportion

NAME = "extraction"


@dataclass(frozen=True, eq=False)
class Logs:
    """All rollouts of one way to pull, by (seed, number)."""

    name: str
    settings: dict[str, Any]
    """The controller as the logs' configuration holds it."""
    checkpoint: str
    runs: dict[tuple[int, int], Ended]

    @property
    def straight(self) -> bool:
        return self.settings["name"] == "straight"


def report_extraction(folders: Sequence[Path], out: Path) -> dict[str, Any]:
    """Read what evaluations logged; write extraction.json, .md and three figures into `out`.

    Ways are compared on the towers that both of a pair have. Ways that differ by their checkpoint alone share a row
    of their mean beside their own.

    Raises:
        JengaError: a folder holds no rollouts of a controller, or a log cannot be read.
    """
    found = [logs for folder in folders for logs in _read(folder)]
    if not found:
        raise JengaError("no folder of an evaluation was given; name at least one, as `jenga eval extraction` made it")
    ways = _named(found)
    best = _best_straight(ways)
    rows = {name: _row(logs, best) for name, logs in ways.items()}
    report = {
        "ways": rows,
        "best_straight": best.name if best else None,
        "towers": len({key for logs in ways.values() for key in logs.runs}),
        "seeds": _over_seeds(ways),
        "any": _any(ways),
        "paper": PAPER,
    }
    out.mkdir(parents=True, exist_ok=True)
    figures = _draw(report, out)
    written = write_report(out, NAME, report, text := extraction_report_tables(report))
    return report | {"text": text, "written": [str(path) for path in (*written, *figures)]}


def _read(folder: Path) -> list[Logs]:
    """The ways that one evaluation logged, each from its own folder."""
    recipes = sorted({path.parent for path in folder.glob(f"*/{RECIPE}")} | {p.parent for p in folder.glob(RECIPE)})
    if not recipes:
        raise JengaError(f"{folder} holds no rollouts of `jenga eval extraction`: no folder in it has a {RECIPE}")
    return [logs for place in recipes if (logs := _way(place)) is not None]


def _way(folder: Path) -> Logs | None:
    runs: dict[tuple[int, int], Ended] = {}
    settings: dict[str, Any] = {}
    checkpoint = ""
    for path in sorted(folder.glob("*.mcap")):
        header, result = read_header(path)
        if result is None or not (acts := header.config.get("controller")):
            continue
        runs[header.seed, header.number] = Ended(path, header, result)
        settings, checkpoint = acts, header.checkpoint
    return Logs(folder.name, settings, checkpoint, dict(sorted(runs.items()))) if runs else None


def _named(found: Sequence[Logs]) -> dict[str, Logs]:
    """Each way by a name of its own; the same way from several folders is one."""
    merged: dict[bytes, Logs] = {}
    for logs in found:
        key = msgspec.json.encode([logs.settings, logs.checkpoint], order="deterministic")
        before = merged.get(key)
        runs = (before.runs if before else {}) | logs.runs
        merged[key] = Logs(before.name if before else logs.name, logs.settings, logs.checkpoint, runs)
    named: dict[str, Logs] = {}
    for logs in merged.values():
        name, copies = logs.name + switch_words(logs.settings), 1
        while (unique := name if copies == 1 else f"{name} ({copies})") in named:
            copies += 1
        named[unique] = Logs(unique, logs.settings, logs.checkpoint, logs.runs)
    return named


def _best_straight(ways: Mapping[str, Logs]) -> Logs | None:
    """The straight pull without switches that succeeds most often."""
    plain = [logs for logs in ways.values() if logs.straight and not switch_words(logs.settings)]
    return max(plain, key=lambda logs: float(succeeded(list(logs.runs.values())).mean()), default=None)


def _row(logs: Logs, best: Logs | None) -> dict[str, Any]:
    runs = list(logs.runs.values())
    row = scores(runs) | {
        "name": logs.settings["name"],
        "settings": logs.settings,
        "checkpoint": logs.checkpoint,
        "speed": _speed(logs),
        "pulled": Proportion.of(np.array([run.result.verdict.clear_frame >= 0 for run in runs], bool)).as_dict(),
    }
    if best is not None and best is not logs and (common := _common(logs, best)):
        row["above_best_straight"] = paired(*common)
    return row


def _common(one: Logs, other: Logs) -> tuple[list[Ended], list[Ended]] | None:
    """The rollouts of both on the towers that both have; None where there are none."""
    keys = [key for key in one.runs if key in other.runs]
    return ([one.runs[k] for k in keys], [other.runs[k] for k in keys]) if keys else None


def _speed(logs: Logs) -> float | None:
    """Of the pulls [m/s]: what a straight one was told, else the median over pulls of what was executed on average
    until the block was clear; None where nothing was pulled."""
    if logs.straight:
        return float(logs.settings["speed"])
    means = []
    with progress(f"speeds of {logs.name}", len(logs.runs)) as bar:
        for run in logs.runs.values():
            frame, action = read_actions(run.path)
            clear = run.result.verdict.clear_frame
            inside = frame < (clear if clear >= 0 else np.inf)
            if inside.any():
                means.append(-float(action[inside, 0].mean()))
            bar.advance()
    return float(np.median(means)) / (CONTROL_STEP_NS * 1e-9) if means else None


def _over_seeds(ways: Mapping[str, Logs]) -> dict[str, Any]:
    """Mean and spread of the rate over checkpoints that act in the same way: over training seeds."""
    groups: dict[bytes, list[Logs]] = {}
    for logs in ways.values():
        if logs.checkpoint:
            groups.setdefault(msgspec.json.encode(logs.settings, order="deterministic"), []).append(logs)
    found = {}
    for group in groups.values():
        if len(group) > 1:
            rates = np.array([succeeded(list(logs.runs.values())).mean() for logs in group])
            name = group[0].name.removesuffix(f"-{group[0].checkpoint[:8]}")
            found[name] = {"mean": float(rates.mean()), "std": float(rates.std(ddof=1)), "n": len(rates)}
    return found


def _any(ways: Mapping[str, Logs]) -> dict[str, Any]:
    """On the towers that all ways have: how often at least one of them succeeded, hindsight included."""
    keys = sorted(set.intersection(*(set(logs.runs) for logs in ways.values())))
    hits = np.zeros((2, len(keys)), bool)
    for logs in ways.values():
        runs = [logs.runs[key] for key in keys]
        hits |= np.stack([succeeded(runs), clean(runs)]) if runs else hits
    return {"success": Proportion.of(hits[0]).as_dict(), "success_without_dragging": Proportion.of(hits[1]).as_dict()}


def _draw(report: dict[str, Any], out: Path) -> list[Path]:
    written = []
    drawings = {"speed": speed_figure, "causes": causes_figure, "rounds": rounds_figure}
    for name, draw in drawings.items():
        with style.applied():
            style.save(draw(report["ways"]), path := out / f"{NAME}-{name}.png")
        written.append(path)
    return written
