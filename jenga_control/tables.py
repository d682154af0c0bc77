"""Evaluations as Markdown tables."""

from collections.abc import Sequence
from typing import Any

from jenga_data.report import markdown_table, with_interval


def selection_tables(report: dict[str, Any]) -> str:
    """An evaluation of a selector: the paper's table I with baselines and ceiling, then by slot and round."""
    by_label = [("majority", report["majority"])]
    by_label += [(name, entry["accuracy"]) for name, entry in report["baselines"].items() if name != "majority"]
    rows = [
        (name, accuracy, report["baselines"][name]["model_minus_baseline"]["p_value"]) for name, accuracy in by_label
    ]
    parts = [
        markdown_table(
            ("Predictor", "Accuracy", "p against the model"),
            [*rows, ("**model**", report["accuracy"], None), ("ceiling", report["ceiling"], None)],
        ),
        markdown_table(
            ("Probabilities", "Value"),
            [
                (label, with_interval(report[key], report.get(f"{key}_ci95")))
                for label, key in (("AUROC", "auroc"), ("Brier score", "brier"), ("calibration error", "ece"))
            ],
        ),
    ]
    for title, key in (("Slot", "by_slot"), ("Round", "by_round"), ("Outcome", "by_outcome")):
        groups = [(name, group["accuracy"], group["failures"]) for name, group in report[key].items()]
        parts.append(markdown_table((title, "Accuracy", "Failures"), groups))
    return "\n".join(parts)


def dynamics_tables(report: dict[str, Any]) -> str:
    """An evaluation of a dynamics model: skill and error by horizon, then the rows reported apart, if there are any."""
    titles = {"one_step": "1 step", "rollout_5": "5 steps", "rollout_51": "51 steps"}
    groups = {"": "pull", "after_clear": "target clear", "collapse": "collapse"}
    rows = []
    for key, kind in groups.items():
        for name, steps in titles.items():
            entry = report[name][key] if key else report[name]
            if key and entry["n"] == 0:
                continue
            rows += [
                (
                    f"{kind}, {steps}, {who}",
                    with_interval(entry[f"skill_{who}"], entry[f"skill_{who}_ci95"]),
                    *(entry[f"{prefix}rmse_{unit}_{who}"] for unit in ("mm", "deg") for prefix in ("", "trivial_")),
                    entry["n"],
                )
                for who in ("others", "target")
            ]
    header = ("Rows", "Skill", "RMSE [mm]", "trivial [mm]", "RMSE [deg]", "trivial [deg]", "n")
    return markdown_table(header, rows)


def extraction_tables(reports: Sequence[dict[str, Any]]) -> str:
    """Evaluations of the closed loop side by side, then why each failed."""
    rows = [
        (
            report["objective"],
            report["dynamics"],
            ", ".join(sorted(name for name, on in report["switches"].items() if on)) or "none",
            report["success"],
            report["control_hz"],
        )
        for report in reports
    ]
    causes = sorted({cause for report in reports for cause in report["causes"]})
    parts = [markdown_table(("Objective", "Dynamics", "Switches", "Success", "Decisions a second"), rows)]
    if causes:
        header = ("Cause of failure", *(f"{report['objective']}, {report['dynamics']}" for report in reports))
        counts = [(cause or "none given", *(report["causes"].get(cause, 0) for report in reports)) for cause in causes]
        parts.append(markdown_table(header, counts))
    return "\n".join(parts)
