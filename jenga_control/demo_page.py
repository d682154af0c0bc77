"""The page that shows what a demo made, without a server."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jenga_control.page import Code, Figure, Files, KeyFigure, Page, Section, Table, write_page
from jenga_data.agreement import Agreement
from jenga_data.collect.workers import CollectSummary
from jenga_data.dataset.manifest import Manifest
from jenga_data.report import number, with_interval


@dataclass(frozen=True)
class DemoResults:
    """Everything that one demo made."""

    out: Path
    collected: dict[str, CollectSummary]
    manifests: dict[str, Manifest]
    selection: dict[str, Any]
    dynamics: dict[str, Any]
    extraction: dict[str, Any]
    agreement: Agreement
    episode: Path
    replay: Path
    robot: Path
    robot_replay: Path
    pictures: dict[str, Path]
    checkpoints: tuple[Path, Path]
    trained: tuple[Path, Path]
    seconds: float


def write_demo_page(results: DemoResults) -> Path:
    """Write `index.html` into the demo's folder and return its path."""
    index = results.out / "index.html"
    page = Page(
        title="Jenga demo",
        subtitle="Simulate, log, convert, train, evaluate, control, replay: the whole loop once, with small numbers",
        sections=[
            _control(results),
            _data(results),
            _models(results),
            _files(results),
        ],
        key_figures=_key_figures(results),
        footer=[
            "The figures here come from a handful of towers: they show that everything works, not how well it can.",
            "Method: Puthuveetil, Zhang, Yokoyama, Narita, Strategic Jenga Play via Graph Based Dynamics Modeling "
            "(arXiv 2505.09377).",
        ],
    )
    write_page(index, page)
    return index


def _key_figures(r: DemoResults) -> list[KeyFigure]:
    episodes = sum(summary.episodes for summary in r.collected.values())
    rows = sum(manifest.counts.rows for manifest in r.manifests.values())
    return [
        KeyFigure(str(episodes), "rollouts logged", "one MCAP file each"),
        KeyFigure(str(rows), "graphs in two datasets", "Parquet with a manifest, verified"),
        KeyFigure(_percent(r.extraction["success"]), "blocks extracted", f"MPPI, n = {r.extraction['success']['n']}"),
        KeyFigure(f"{r.seconds:.0f} s", "for all of it", "collection and training included"),
    ]


def _control(r: DemoResults) -> Section:
    reports = [r.extraction, *r.extraction["baselines"].values()]
    rows = [
        (
            report["objective"],
            with_interval(report["success"]["rate"], report["success"]["ci95"]),
            report["success"]["n"],
            number(report["median_disturbance_mm"]),
            number(report["control_hz"]),
        )
        for report in reports
    ]
    head = ("Way to pull", "Extracted", "n", "Median of the largest motion of another block [mm]", "Decisions a second")
    return Section(
        "Pulling a block",
        [
            Figure(
                r.pictures["robot"],
                "Key frames of the robot",
                "The whole robot with the trained models that jenga comes with: the selector chose the block, MPPI "
                "with the dynamics model pulled it.",
            ),
            Code(
                shlex.join(["jenga", "replay", str(r.robot), "--model", *map(str, r.trained)]),
                "Open it in rerun, with the plans and what both models predict",
            ),
            Figure(r.pictures["film"], "Six moments of a pull", "MPPI with the learned model on a tower it never saw."),
            Figure(
                r.pictures["curves"],
                "Curves of the pull over time",
                "What was commanded, what the fingertips felt, how far other blocks moved, and how far the model's "
                "one-step prediction was off.",
            ),
            Table(head, rows, "The same towers and targets for every way to pull."),
            Code(
                shlex.join(["jenga", "replay", str(r.episode), "--model", str(r.checkpoints[1])]),
                "Open this pull in rerun, the model's prediction as a ghost over the truth",
            ),
        ],
    )


def _data(r: DemoResults) -> Section:
    outcomes = sorted({name for summary in r.collected.values() for name in summary.outcomes})
    rows = [
        (kind, summary.episodes, *(summary.outcomes[name] for name in outcomes))
        for kind, summary in r.collected.items()
    ]
    sets = [
        (manifest.identifier, manifest.kind, manifest.counts.rows, len(manifest.files), manifest.hash[:12])
        for manifest in r.manifests.values()
    ]
    contacts = r.agreement.both + r.agreement.contact_only
    return Section(
        "Towers, rollouts, datasets",
        [
            Figure(r.pictures["towers"], "Towers at several rounds", "Towers as they were spawned; targets in blue."),
            Figure(r.pictures["selection"], "Six moments of a servo pull", "A pull of the selection data."),
            Table(("Kind of rollout", "Rollouts", *outcomes), rows, "How the collected rollouts ended."),
            Table(("Dataset", "Kind", "Rows", "Files", "Hash"), sets, "What the converter made of them."),
            "A graph's edges come from poses and sizes alone. Before the pull they hold "
            f"{number(r.agreement.recall)} of the simulator's {contacts:,} contacts between blocks, and "
            f"{number(r.agreement.precision)} of the edges touch; the rest belong to loose blocks.",
        ],
    )


def _models(r: DemoResults) -> Section:
    s, one = r.selection, r.dynamics["one_step"]
    selection = [
        ("graph network", with_interval(s["accuracy"]["rate"], s["accuracy"]["ci95"]), s["accuracy"]["n"]),
        *(
            (name, with_interval(b["accuracy"]["rate"], b["accuracy"]["ci95"]), b["accuracy"]["n"])
            for name, b in s["baselines"].items()
        ),
    ]
    dynamics = [
        (horizon.replace("_", " "), number(values["skill_others"]), number(values["skill_target"]))
        for horizon, values in (("one_step", one), ("rollout_5", r.dynamics["rollout_5"]))
    ]
    return Section(
        "Models on held-out towers",
        [
            Table(("Which block fails?", "Accuracy", "n"), selection, "Against rules that need no training."),
            Table(
                ("How does the tower move?", "Skill, other blocks", "Skill, target"),
                dynamics,
                "1 - MSE / MSE of the trivial prediction (nothing moves, the target moves by the action): 0: as good.",
            ),
        ],
    )


def _files(r: DemoResults) -> Section:
    entries = [
        (r.out / "logs", "MCAP logs; each opens as it is in rerun and Foxglove"),
        (r.out / "datasets", "two datasets: Parquet files and a manifest each"),
        (r.out / "checkpoints", "two models: safetensors and a JSON card each"),
        (r.out / "tables", "evaluations as JSON and Markdown"),
        (r.robot_replay, "the robot's pull for rerun, with the plans and what the trained models predict"),
        (r.replay, "the pull of the models trained here for rerun, with the prediction"),
    ]
    return Section("Files", [Files(entries, "jenga demo")])


def _percent(proportion: dict[str, Any]) -> str:
    return "–" if proportion["rate"] is None else f"{100 * proportion['rate']:.0f} %"
