"""The plots of the report on extraction. Each is a matplotlib figure, drawn in the style that the caller applies."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from jenga_control.extraction.hindsight import FASTEST
from jenga_control.extraction.scores import ROUNDS, switch_words
from jenga_data.clock import CONTROL_STEP_NS
from jenga_data.collect.extraction import MAX_STEP_CHANGE
from jenga_data.palette import BLUE, GREEN, MUTED_INK, ORANGE, PURPLE, SKY_BLUE, UNKNOWN, VERMILLION, YELLOW

_COLOURS = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY_BLUE, YELLOW, UNKNOWN)
_MARKERS = ("o", "s", "^", "v", "P", "X", "D", "*")
_CARTESIAN = 1.7
"""The arm's own limit of its hand's speed [m/s], by its maker."""
_FIRST_STEP = MAX_STEP_CHANGE / (CONTROL_STEP_NS * 1e-9)
"""Fastest in the first control step from rest, at the arm's 13 m/s^2 [m/s]."""

Ways = Mapping[str, dict[str, Any]]


def speed_figure(ways: Ways) -> Figure:
    """Success against the speed of the pull: straight ones as a curve, controllers where they pull on average."""
    figure = Figure(figsize=(11.5, 5.4), layout="constrained")
    axes = figure.subplots()
    straight: dict[str, list[dict[str, Any]]] = {}
    for row in ways.values():
        if row["name"] == "straight":
            straight.setdefault(switch_words(row["settings"]), []).append(row)
    curves = len(straight)
    for colour, (switches, rows) in zip(_COLOURS, straight.items(), strict=False):
        rows = sorted(rows, key=lambda row: row["speed"])
        speeds = [row["speed"] for row in rows]
        rates = np.array([(row["success"]["rate"], *row["success"]["ci95"]) for row in rows])
        clean = [row["success_without_dragging"]["rate"] for row in rows]
        axes.fill_between(speeds, rates[:, 1], rates[:, 2], color=colour, alpha=0.12, linewidth=0)
        axes.plot(speeds, rates[:, 0], color=colour, marker="o", label=f"straight{switches}")
        axes.plot(speeds, clean, color=colour, marker="o", linestyle=":", label="  and no block dragged")
    others = {name: row for name, row in ways.items() if row["name"] != "straight"}
    for place, (name, row) in enumerate(others.items()):
        if row["speed"] is None or row["success"]["rate"] is None:
            continue
        colour, marker = _COLOURS[(place + curves) % len(_COLOURS)], _MARKERS[(place + 1) % len(_MARKERS)]
        low, high = row["success"]["ci95"]
        axes.plot([row["speed"]] * 2, [low, high], color=colour, linewidth=1.2)
        axes.plot(row["speed"], row["success"]["rate"], color=colour, marker=marker, linestyle="", label=name)
    for limit, text in (
        (_FIRST_STEP, "13 m/s², first step"),
        (FASTEST, "2 cm a step"),
        (_CARTESIAN, "the arm's speed"),
    ):
        axes.axvline(limit, color=MUTED_INK, linewidth=1.0, linestyle="--")
        axes.text(limit, 0.02, f" {text}", color=MUTED_INK, rotation=90, va="bottom", ha="right")
    axes.set_xscale("log")
    axes.set(xlabel="speed of the pull [m/s]", ylabel="share of all towers started, 95 % interval", ylim=(0, 1))
    ticks = [0.05, 0.1, 0.2, 0.5, 1.0, 2.0]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_title("Success against pull speed", loc="left")
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize="small")
    return figure


def causes_figure(ways: Ways) -> Figure:
    """What became of every tower, way by way: success, and each cause of failure."""
    causes = sorted({cause for row in ways.values() for cause in row["causes"]})
    figure = Figure(figsize=(11, 1.8 + 0.5 * len(ways)), layout="constrained")
    axes = figure.subplots()
    names = list(ways)
    total = np.array([max(ways[name]["success"]["n"], 1) for name in names])
    left = np.zeros(len(names))
    colours = [colour for colour in _COLOURS if colour != GREEN]  # that is success, and nothing else
    parts = [("success", GREEN, "")] + [
        (cause, colours[place % len(colours)], "///"[: place // len(colours)]) for place, cause in enumerate(causes)
    ]
    for cause, colour, hatch in parts:
        counts = [
            ways[name]["outcomes"]["extracted"] if cause == "success" else ways[name]["causes"].get(cause, 0)
            for name in names
        ]
        share = np.array(counts) / total
        axes.barh(names, share, left=left, color=colour, hatch=hatch or None, label=cause, edgecolor="white")
        for y, (value, start, count) in enumerate(zip(share, left, counts, strict=True)):
            if value > 0.03:
                axes.text(start + value / 2, y, str(count), ha="center", va="center", color="white")
        left += share
    axes.invert_yaxis()
    axes.set(xlabel="share of all towers started", xlim=(0, 1))
    axes.grid(visible=False, axis="y")
    axes.set_title("What became of the towers", loc="left")
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize="small")
    return figure


def rounds_figure(ways: Ways) -> Figure:
    """Success by groups of rounds."""
    figure = Figure(figsize=(9.5, 5.0), layout="constrained")
    axes = figure.subplots()
    groups = [f"{low}-{high}" for low, high in ROUNDS]
    for place, (name, row) in enumerate(ways.items()):
        x = [k for k, group in enumerate(groups) if group in row["by_round"]]
        rates = np.array([(g["rate"], *g["ci95"]) for k in x for g in [row["by_round"][groups[k]]]]).reshape(-1, 3)
        shift = np.array(x) + (place - (len(ways) - 1) / 2) * 0.6 / max(len(ways), 1)
        colour, marker = _COLOURS[place % len(_COLOURS)], _MARKERS[place % len(_MARKERS)]
        axes.errorbar(
            shift, rates[:, 0], yerr=np.abs(rates[:, 1:].T - rates[:, 0]), color=colour, marker=marker,
            linestyle="", capsize=2, label=name,
        )  # fmt: skip
    axes.set_xticks(range(len(groups)), groups)
    axes.set(xlabel="round of the game", ylabel="success, 95 % interval", ylim=(0, 1), xlim=(-0.5, len(groups) - 0.5))
    axes.set_title("Success by round", loc="left")
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize="small")
    return figure
