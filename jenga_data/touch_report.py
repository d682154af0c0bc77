"""`jenga report touch`: whether failed pulls feel more erratic at the fingertips than successful ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from jenga_data.dataset.sources import find_logs
from jenga_data.errors import JengaError
from jenga_data.log.reader import read_episode
from jenga_data.outcome import Outcome
from jenga_data.progress import progress
from jenga_data.replay import style
from jenga_data.report import markdown_table, number, with_interval, write_report
from jenga_data.statistics import auroc, spearman, tower_bootstrap
from jenga_data.touch import pull_touch
from jenga_data.touch_figure import touch_figure

NAME = "touch"
SAME_SPEED = 1.25
"""Pulls whose speeds differ by no more than this factor count as equally fast."""
GROUPS = {
    "success": (Outcome.EXTRACTED,),
    "failure": (Outcome.STUCK, Outcome.COLLAPSED),
    "extracted": (Outcome.EXTRACTED,),
    "stuck": (Outcome.STUCK,),
    "collapsed": (Outcome.COLLAPSED,),
}


@dataclass(frozen=True)
class Felt:
    """What the report keeps of one episode; `tower` names the set of blocks."""

    path: Path
    key: str
    tower: str
    outcome: Outcome
    erraticness: float
    mean_force: float
    speed: float


def touch_report(logs: Sequence[Path], out: Path) -> dict[str, Any]:
    """Read the logs and write touch.json, touch.md and touch.png into `out`.

    Raises:
        JengaError: a log cannot be read, or in none a gripper pulls.
    """
    paths = find_logs(logs)
    found = _read(paths)
    felt = [row for row in found.values() if row and row.outcome is not Outcome.INVALID]
    if not felt:
        raise JengaError(
            f"in none of {len(paths)} logs a gripper pulls to an outcome; collect some with `jenga collect extraction`"
        )
    values = np.array([row.erraticness for row in felt])
    outcome = np.array([row.outcome for row in felt])
    report: dict[str, Any] = {
        "n": len(felt),
        "episodes": len(found),
        "invalid": sum(row is not None and row.outcome is Outcome.INVALID for row in found.values()),
        "without_pull": sum(row is None for row in found.values()),
        "unit": "N/s",
        "erraticness": {name: _spread(values[np.isin(outcome, group)]) for name, group in GROUPS.items()},
        **_comparison(felt, np.isin(outcome, GROUPS["failure"])),
    }
    shown = {name: _typical([row for row in felt if row.outcome in GROUPS[name]]) for name in ("success", "failure")}
    report["figure"] = {
        name: None if row is None else {"episode": row.key, "log": str(row.path), "erraticness": row.erraticness}
        for name, row in shown.items()
    }
    text = _text(report)
    out.mkdir(parents=True, exist_ok=True)
    picture = out / f"{NAME}.png"
    episodes = {name: None if row is None else read_episode(row.path) for name, row in shown.items()}
    with style.applied():
        style.save(touch_figure(episodes["success"], episodes["failure"], values, outcome), picture)
    written = write_report(out, NAME, report, f"{text}\n![fingertip forces]({picture.name})\n")
    return report | {"written": [str(path) for path in (*written, picture)], "text": text}


def _read(paths: Sequence[Path]) -> dict[str, Felt | None]:
    """Every episode once, however many copies of its log there are; None where no gripper pulls."""
    found: dict[str, Felt | None] = {}
    with progress("read", len(paths)) as bar:
        for path in paths:
            episode = read_episode(path)
            header, touch = episode.header, pull_touch(episode)
            if header.key not in found:
                found[header.key] = None
                if episode.result is not None and len(touch.time_ns) > 1:
                    found[header.key] = Felt(
                        path, header.key, header.blocks.tower, episode.result.verdict.outcome,
                        touch.erraticness(), touch.mean_force(), touch.speed(),
                    )  # fmt: skip
            bar.advance()
    return found


def _spread(values: Float[np.ndarray, " episode"]) -> dict[str, Any]:
    low, median, high = map(float, np.quantile(values, [0.05, 0.5, 0.95])) if len(values) else (None, None, None)
    return {"n": len(values), "median": median, "5 %": low, "95 %": high}


def _comparison(felt: Sequence[Felt], failure: Bool[np.ndarray, " episode"]) -> dict[str, Any]:
    """The AUROC of the statistic, of what is simpler, and of the statistic among equally fast pulls."""
    tower = np.array([row.tower for row in felt])
    values = {name: np.array([getattr(row, name) for row in felt]) for name in ("erraticness", "mean_force", "speed")}

    def scored(score: Float[np.ndarray, " episode"]) -> dict[str, Any]:
        interval = tower_bootstrap(lambda rows: auroc(score[rows], failure[rows]), tower)
        return _estimate(auroc(score, failure), interval, len(felt))

    return {
        "auroc": scored(values["erraticness"]),
        "baselines": {name: {"auroc": scored(values[name])} for name in ("mean_force", "speed")},
        "auroc_same_speed": _same_speed(values["erraticness"], values["speed"], failure, tower),
        "rank_correlation_with_speed": spearman(values["erraticness"], values["speed"]),
    }


def _estimate(value: float, ci95: tuple[float, float] | None, n: int) -> dict[str, Any]:
    return {"value": None if np.isnan(value) else value, "ci95": None if ci95 is None else list(ci95), "n": n}


def _same_speed(
    value: Float[np.ndarray, " episode"],
    speed: Float[np.ndarray, " episode"],
    failure: Bool[np.ndarray, " episode"],
    tower: np.ndarray,
) -> dict[str, Any]:
    """As the AUROC, over the pairs of a failure and a success whose speeds differ by `SAME_SPEED` at most."""
    fails, works = np.flatnonzero(failure), np.flatnonzero(~failure)
    first, second = np.ix_(speed[fails], speed[works])
    pair = (np.maximum(first, second) <= SAME_SPEED * np.minimum(first, second)).astype(np.float32)
    above, below = np.ix_(value[fails], value[works])
    won = pair * ((above > below) + 0.5 * (above == below)).astype(np.float32)

    def share(rows: Int[np.ndarray, " row"]) -> float:
        drawn = np.bincount(rows, minlength=len(value)).astype(np.float32)
        pairs = float(drawn[fails] @ pair @ drawn[works])
        return float(drawn[fails] @ won @ drawn[works]) / pairs if pairs else float("nan")

    estimate = _estimate(share(np.arange(len(value))), tower_bootstrap(share, tower), len(value))
    return {**estimate, "factor": SAME_SPEED, "pairs": int(pair.sum())}


def _typical(rows: Sequence[Felt]) -> Felt | None:
    """The episode nearest to the median."""
    if not rows:
        return None
    median = float(np.median([row.erraticness for row in rows]))
    return min(rows, key=lambda row: (abs(row.erraticness - median), row.key))


def _text(report: dict[str, Any]) -> str:
    spread = markdown_table(
        ("erraticness [N/s]", "n", "median", "5 %", "95 %"),
        [(name, *(row[key] for key in ("n", "median", "5 %", "95 %"))) for name, row in report["erraticness"].items()],
    )
    scores = {
        "erraticness": report["auroc"],
        f"erraticness, pairs equally fast within a factor of {SAME_SPEED:g}": report["auroc_same_speed"],
        "baseline: mean force": report["baselines"]["mean_force"]["auroc"],
        "baseline: speed of the pull": report["baselines"]["speed"]["auroc"],
    }
    table = markdown_table(
        ("a failure has more", "AUROC [95 % over towers]"),
        [(name, with_interval(score["value"], score["ci95"])) for name, score in scores.items()],
    )
    return "\n".join([f"{report['n']} pulls of {report['episodes']} episodes; {_verdict(report)}", "", spread, table])


def _verdict(report: dict[str, Any]) -> str:
    empty = [name for name in ("success", "failure") if not report["erraticness"][name]["n"]]
    if empty:
        return f"no {empty[0]} among them, so that nothing can be told apart"
    value, ci95 = report["auroc"]["value"], report["auroc"]["ci95"]
    if ci95 is None or ci95[0] <= 0.5 <= ci95[1]:
        return f"failures and successes feel no different so far (AUROC {number(value)})"
    return f"{'failures' if value > 0.5 else 'successes'} feel more erratic (AUROC {number(value)})"
