"""The plots of the selection report. Each is a matplotlib figure, drawn in the style that the caller applies."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jenga_control.selection.curve import SIZES
from jenga_control.selection.pulls import Prediction, Pulls, by_information
from jenga_data.palette import BLUE, GREEN, MUTED_INK, ORANGE, PURPLE, SKY_BLUE, VERMILLION
from jenga_data.report import number
from jenga_data.statistics import BINS

_COLOURS = (MUTED_INK, BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY_BLUE)
_MARKERS = ("D", "o", "s", "^", "v", "P", "X")
"""Beside the colour, so that print and every eye tell curves apart."""
_BAND = (0.90, 0.91, 0.92)


def accuracies(report: dict[str, Any]) -> Figure:
    """The table as a picture: accuracy with its 95 % interval, rows grouped by what a predictor is told."""
    rows = by_information(report["rows"])
    figure = Figure(figsize=(13, 2.0 + 0.42 * (len(rows) + 4)), layout="constrained")
    axes, beside = figure.subplots(1, 2, sharey=True, width_ratios=(2.6, 1))
    labels, places, y = [], [], 0.0
    before = None
    for name, row in rows:
        if row["information"] != before:
            y -= 0.6 if before is not None else 0.0
            before = row["information"]
            axes.text(0.01, y, _told(before), transform=axes.get_yaxis_transform(), color=MUTED_INK, va="center")
            y -= 0.9
        _interval(axes, row, y)
        labels.append(f"{name} (mean of {row['seeds']['n']})" if row.get("seeds", {}).get("n", 1) > 1 else name)
        places.append(y)
        y -= 1.0
    _limits(axes, report)
    axes.set_yticks(places, labels)
    axes.set(xlabel="accuracy on test towers, 95 % interval over towers", ylim=(y + 0.3, 1.0))
    axes.grid(visible=False, axis="y")
    _numbers(beside, places, [row for _, row in rows])
    return figure


def _numbers(axes: Axes, places: Sequence[float], rows: Sequence[dict[str, Any]]) -> None:
    """Columns of figures beside the intervals."""
    axes.set_axis_off()
    columns = {
        "accuracy": [row["accuracy"]["rate"] for row in rows],
        **{
            title: [row[key] for row in rows] for title, key in (("AUROC", "auroc"), ("Brier", "brier"), ("ECE", "ece"))
        },
    }
    for column, (title, values) in enumerate(columns.items()):
        x = (column + 0.5) / len(columns)
        place = {"transform": axes.get_yaxis_transform(), "ha": "center", "va": "center"}
        axes.text(x, 0.75, title, color=MUTED_INK, fontsize=12, **place)
        for y, value in zip(places, values, strict=True):
            axes.text(x, y, _short(value), fontsize=12, **place)


def _told(information: str) -> str:
    return "told nothing" if information == "none" else f"told {information}"


def _short(value: float | None) -> str:
    return number(value) if value is None else f"{value:.3f}"


def _interval(axes: Axes, row: dict[str, Any], y: float) -> None:
    accuracy, is_model = row["accuracy"], row["kind"] == "model"
    colour = VERMILLION if is_model else BLUE
    low, high = accuracy.get("ci95_towers") or accuracy["ci95"]
    axes.hlines(y, low, high, color=colour)
    axes.plot(accuracy["rate"], y, "s" if is_model else "o", color=colour)
    seeds = row.get("seeds", {}).get("accuracies", [])
    if len(seeds) > 1:
        axes.plot(seeds, [y - 0.28] * len(seeds), "|", color=colour, markersize=6)


def _limits(axes: Axes, report: dict[str, Any]) -> None:
    """The share of the majority, and between which bounds the best possible accuracy lies."""
    axes.axvline(report["majority"]["rate"], color=MUTED_INK, linestyle=":", linewidth=1.5)
    if report["ceiling"]:
        low, high = report["ceiling"]["accuracy_bounds"]
        axes.axvspan(low, high, color=_BAND, zorder=0)
        axes.text((low + high) / 2, 1.0, "ceiling", transform=axes.get_xaxis_transform(), ha="center", va="bottom")


def reliability(predictions: Sequence[Prediction], test: Pulls) -> Figure:
    """Share of failures against predicted probability, in the bins of the calibration error; below, how many pulls."""
    figure = Figure(figsize=(6.4, 7.2), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    top.plot([0, 1], [0, 1], color=MUTED_INK, linestyle=":", linewidth=1.5)
    for p, colour, marker in zip(predictions, _COLOURS[1:], _MARKERS[1:], strict=False):
        at = np.minimum((p.probability * BINS).astype(int), BINS - 1)
        count = np.bincount(at, minlength=BINS)
        held = count > 0
        mean = np.bincount(at, weights=p.probability, minlength=BINS)[held] / count[held]
        share = np.bincount(at, weights=test.failure, minlength=BINS)[held] / count[held]
        top.plot(mean, share, "-", color=colour, linewidth=1.2)
        top.scatter(mean, share, s=12 + 160 * count[held] / len(test), color=colour, marker=marker, label=p.name)
        bottom.step(np.arange(BINS + 1) / BINS, np.append(count, count[-1]), where="post", color=colour)
    top.set(ylabel="share that failed", xlim=(-0.02, 1.02), ylim=(-0.02, 1.02))
    bottom.set(xlabel="predicted probability of failure", ylabel="pulls")
    if predictions:
        top.legend(loc="upper left")
    return figure


def by_round(report: dict[str, Any], names: Sequence[str]) -> Figure:
    """Accuracy of some rows by round of the game, with Wilson intervals."""
    figure = Figure(figsize=(9, 4.6), layout="constrained")
    axes = figure.subplots()
    for shift, (name, colour, marker) in enumerate(zip(names, _COLOURS, _MARKERS, strict=False)):
        groups = report["rows"][name]["by_round"]
        at = np.array([float(r) for r in groups]) + 0.14 * (shift - (len(names) - 1) / 2)
        rate = np.array([group["accuracy"]["rate"] for group in groups.values()])
        low, high = np.array([group["accuracy"]["ci95"] for group in groups.values()]).T
        bars = np.maximum([rate - low, high - rate], 0)
        axes.errorbar(at, rate, bars, fmt=f"{marker}-", color=colour, label=name, linewidth=1.4, capsize=2)
    axes.set(xlabel="round", ylabel="accuracy", ylim=(0, 1.02))
    axes.set_xticks([int(r) for r in report["rows"]["majority"]["by_round"]])
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(names))
    return figure


def learning_curve(report: dict[str, Any]) -> Figure:
    """Accuracy on the same test towers against the number of towers trained on, mean and standard deviation."""
    figure = Figure(figsize=(10.5, 5), layout="constrained")
    axes = figure.subplots()
    for (name, points), colour, marker in zip(
        report["learning_curve"].items(), _COLOURS[1:], _MARKERS[1:], strict=False
    ):
        towers = [p["towers"] for p in points]
        spread = [p["std"] or 0.0 for p in points]
        axes.errorbar(
            towers, [p["accuracy"] for p in points], spread, fmt=f"{marker}-", color=colour, label=name, capsize=3
        )
    axes.axhline(report["majority"]["rate"], color=MUTED_INK, linestyle=":", linewidth=1.5, label="majority")
    if report["ceiling"]:
        axes.axhspan(*report["ceiling"]["accuracy_bounds"], color=_BAND, zorder=0, label="ceiling")
    most = max((p["towers"] for points in report["learning_curve"].values() for p in points), default=0)
    shown = [size for size in SIZES if size <= most]
    axes.set(xlabel="training towers", ylabel="accuracy on test towers", xscale="log")
    axes.set_xticks(shown, [f"{size:,}" for size in shown])
    axes.set_xticks([], minor=True)
    figure.legend(loc="outside right center")
    return figure
