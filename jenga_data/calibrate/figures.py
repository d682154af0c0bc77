"""The plots of the calibration reports. Each is a matplotlib figure, drawn in the style that the caller applies."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jenga_data.palette import BLUE, MUTED_INK, ORANGE, SKY_BLUE, VERMILLION


def movable(
    free: Bool[np.ndarray, " block"],
    middle: Bool[np.ndarray, " block"],
    level: Int[np.ndarray, " block"],
    force: Float[np.ndarray, " block"],
    limit: float,
    real: dict[str, float],
) -> Figure:
    """Left: movable blocks by level, right: at which force blocks broke away."""
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    levels = np.unique(level)
    for name, which, colour in (("middle", middle, BLUE), ("side", ~middle, ORANGE)):
        share = [free[which & (level == at)].mean() if (which & (level == at)).any() else np.nan for at in levels]
        left.plot(levels, share, "o-", color=colour, label=f"{name}, {free[which].mean():.0%}")
        left.axhline(real[name], color=colour, linestyle=":", linewidth=1.5)
    left.axhline(real["movable"], color=MUTED_INK, linestyle=":", linewidth=1.5, label=f"all, {free.mean():.0%}")
    left.set(xlabel="level, from the bottom", ylabel="share movable", ylim=(0, 1.05), xticks=levels[::3])
    left.set_title("movable; dotted: real towers")
    left.legend(loc="upper left", ncols=3, columnspacing=1.0, handletextpad=0.5)
    bins = np.linspace(0, limit, 31)
    broke = np.isfinite(force)
    groups = [force[which & broke] for which in (middle, ~middle)]
    right.hist(groups, bins=list(bins), color=[BLUE, ORANGE], label=["middle", "side"], stacked=True)
    right.set(xlabel="breakaway force [N]", ylabel="blocks", title=f"{(~broke).mean():.0%} did not move at {limit:g} N")
    right.legend()
    return figure


def contacts(settings: dict[str, dict[str, Any]]) -> Figure:
    """Rest, play and pulls side by side, a row a setting."""
    figure = Figure(figsize=(13, 1.6 + 0.42 * len(settings)), layout="constrained")
    axes = figure.subplots(1, 4, sharey=True)
    names = list(settings)
    at = np.arange(len(names))[::-1]
    drift = np.array([[s["drift_mm_per_s"][k] or np.nan for k in ("median", "worst")] for s in settings.values()])
    if not np.isfinite(drift).any():  # nothing stood: the line at 0.1 alone gives an axis no limits
        axes[0].set_xlim(0.01, 1.0)
    axes[0].hlines(at, drift[:, 0], drift[:, 1], color=BLUE)
    axes[0].plot(drift[:, 0], at, "o", color=BLUE)
    axes[0].plot(drift[:, 1], at, "|", color=BLUE, markersize=12)
    axes[0].axvline(0.1, color=MUTED_INK, linestyle=":")
    axes[0].set(xscale="log", xlabel="drift at rest [mm/s]\nmedian and worst tower")
    ticks = [0.01, 0.03, 0.1, 0.3, 1.0, 3.0]
    shown = drift[np.isfinite(drift)]
    kept = [tick for tick in ticks if not len(shown) or 0.3 * shown.min() < tick < 3 * shown.max()]
    axes[0].set_xticks(kept, [f"{tick:g}" for tick in kept])
    axes[0].set_xticks([], minor=True)
    for axis, key, label in (
        (axes[1], "played_stand", "played towers\nthat stand"),
        (axes[2], "failure", "failure of pulls"),
    ):
        _intervals(axis, [s[key] for s in settings.values()], at)
        axis.set(xlabel=label, xlim=(-0.02, 1.02))
    cost = [s["pull_seconds"] or np.nan for s in settings.values()]
    axes[3].barh(at, cost, color=SKY_BLUE, height=0.6)
    axes[3].set(xlabel="CPU time of a pull [s]")
    axes[0].set_yticks(at, names)
    return figure


def _intervals(axis: Axes, shares: list[dict[str, Any]], at: Float[np.ndarray, " row"] | np.ndarray) -> None:
    for share, y in zip(shares, at, strict=True):
        if share["rate"] is not None:
            axis.hlines(y, *share["ci95"], color=BLUE)
            axis.plot(share["rate"], y, "o", color=BLUE)


def shares(rows: dict[str, dict[str, Any]]) -> Figure:
    """Proportions with their intervals, one a row."""
    figure = Figure(figsize=(9, 1.4 + 0.5 * len(rows)), layout="constrained")
    axis = figure.subplots()
    at = np.arange(len(rows))[::-1]
    _intervals(axis, list(rows.values()), at)
    axis.set_yticks(at, list(rows))
    lowest = min(share["ci95"][0] for share in rows.values())
    axis.set(xlabel="share, 95 % interval", xlim=(min(lowest, 0.9) - 0.01, 1.005), ylim=(-0.6, len(rows) - 0.4))
    return figure


def ceiling(by_round: dict[str, dict[str, Any]], votes: Bool[np.ndarray, "pull repeat"]) -> Figure:
    """Left: failure and agreement by round, right: how often each repeated pull failed."""
    figure = Figure(figsize=(11, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    _by(left, by_round, (("failure", VERMILLION, "failure"), ("agreement", BLUE, "two pulls agree")))
    left.set(xlabel="round", ylabel="share", ylim=(0, 1.02))
    left.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    if votes.size:
        counts = np.bincount(votes.sum(1), minlength=votes.shape[1] + 1)
        right.bar(np.arange(len(counts)), counts, color=BLUE)
        right.set(xlabel=f"failures in {votes.shape[1]} repeats of a pull", ylabel="pulls")
    else:
        right.set_visible(False)
    return figure


def speed(by_speed: dict[str, dict[str, Any]]) -> Figure:
    """Failure rates over the speed of the pull."""
    figure = Figure(figsize=(7, 4.4), layout="constrained")
    axis = figure.subplots()
    _by(axis, by_speed, (("failure", VERMILLION, "failure"), ("strict_failure", ORANGE, "strict failure")))
    axis.set(xlabel="speed of the pull [m/s]", ylabel="share of pulls", ylim=(0, 1.02), xscale="log")
    at = [float(value) for value in by_speed]
    axis.set_xticks(at, list(by_speed), minor=False)
    axis.set_xticks([], minor=True)
    axis.legend()
    return figure


def tries(by_round: dict[str, dict[str, Any]]) -> Figure:
    """Mean and most tries by round."""
    figure = Figure(figsize=(7, 4.4), layout="constrained")
    axis = figure.subplots()
    at = [int(r) for r in by_round]
    axis.bar(at, [s["mean_tries"] or np.nan for s in by_round.values()], color=SKY_BLUE, label="mean")
    axis.plot(at, [s["most_tries"] for s in by_round.values()], "_", color=VERMILLION, markersize=14, label="most")
    axis.set(xlabel="round", ylabel="tries until a tower stood", xticks=at)
    axis.legend(loc="upper left")
    return figure


def turntable(
    after: Float[np.ndarray, " tower"], unturned: Float[np.ndarray, " tower"], friction: Float[np.ndarray, " computed"]
) -> Figure:
    """Left: what moved after the turn and without it, right: the friction that rigid turning leaves out."""
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    bins = np.linspace(0, max(after.max(), unturned.max()), 31)
    left.hist(unturned, bins=list(bins), color=SKY_BLUE, label="never turned")
    left.hist(after, bins=list(bins), color=BLUE, histtype="step", linewidth=2, label="after the turn")
    left.set(xlabel="largest movement in a second awake [mm]", ylabel="towers")
    left.legend()
    right.hist(100 * friction, bins=30, color=ORANGE)
    right.set(xlabel="friction needed, of what is there [%]", ylabel="towers")
    for axis in (left, right):
        axis.yaxis.set_major_locator(MaxNLocator(integer=True))
    return figure


def _by(axis: Axes, groups: dict[str, dict[str, Any]], curves: tuple[tuple[str, Any, str], ...]) -> None:
    at = [float(name) for name in groups]
    for key, colour, label in curves:
        rates = np.array([group[key]["rate"] for group in groups.values()])
        low, high = np.array([group[key]["ci95"] for group in groups.values()]).T
        axis.errorbar(at, rates, [rates - low, high - rates], fmt="o-", color=colour, label=label, capsize=3)
