"""Evaluations as Markdown tables."""

from collections.abc import Sequence
from typing import Any

from jenga_control.selection.pulls import by_information
from jenga_data.report import MISSING, markdown_table, number, with_interval


def selection_tables(report: dict[str, Any]) -> str:
    """An evaluation of a selector: the paper's table I with baselines and ceiling, then by slot and round."""
    rows = [
        (
            name,
            entry["information"],
            entry["accuracy"],
            *(entry[key] for key in ("auroc", "brier", "ece")),
            entry["model_minus_baseline"]["p_value"],
        )
        for name, entry in report["baselines"].items()
    ]
    model = ("**model**", None, report["accuracy"], report["auroc"], report["brier"], report["ece"], None)
    ceiling = ("ceiling: two pulls agree", None, report["ceiling"], None, None, None, None)
    parts = [
        markdown_table(
            ("Predictor", "Is told", "Accuracy", "AUROC", "Brier", "ECE", "p against the model"),
            [*rows, model, ceiling],
        ),
        markdown_table(
            ("Probabilities of the model", "Value"),
            [
                (label, with_interval(report[key], report.get(f"{key}_ci95")))
                for label, key in (("AUROC", "auroc"), ("Brier score", "brier"), ("calibration error", "ece"))
            ],
        ),
    ]
    if "one_pull_a_tower" in report:
        first = report["one_pull_a_tower"]["accuracy"]
        parts.append(f"Of one pull a tower, as the paper has it: {number(first)} right.\n")
    return "\n".join([*parts, *_groups(report)])


def _groups(row: dict[str, Any]) -> list[str]:
    parts = []
    for title, key in (("Slot", "by_slot"), ("Round", "by_round"), ("Outcome", "by_outcome")):
        groups = [(name, group["accuracy"], group["failures"]) for name, group in row[key].items()]
        parts.append(markdown_table((title, "Accuracy", "Failures"), groups))
    return parts


def selection_report_tables(report: dict[str, Any]) -> str:
    """The whole report about selection: the table by information, tests, learning curve, groups and mistakes."""
    fitted = report["fitted_to"]
    parts = [
        f"{report['n']:,} pulls of {report['towers']:,} test towers of {report['dataset']}, "
        f"{report['failures']:.0%} of them failures. Baselines are fitted to {fitted['rows']:,} pulls of "
        f"{fitted['towers']:,} other towers of {', '.join(fitted['datasets'])}, "
        "their settings chosen by cross-validation over those towers.\n",
        *(f"Note: {note}.\n" for note in report["notes"]),
        _whole_table(report),
        _ceiling_words(report),
        _first_pulls_table(report["one_pull_a_tower"]),
        " ".join(entry["sentence"] for entry in report["poses"]) + "\n" if report["poses"] else "",
        _pairs_table(report["pairs"]),
        _curve_table(report["learning_curve"]),
    ]
    if report["best"]:
        parts += [f"{report['best']} in detail:\n", *_groups(report["rows"][report["best"]])]
        parts.append(_mistakes_table(report["mistakes"]))
    return "\n".join(part for part in parts if part)


def _whole_table(report: dict[str, Any]) -> str:
    rows = []
    for name, row in by_information(report["rows"]):
        against = row.get("minus_best_baseline")
        seeds = row.get("seeds")
        rows.append(
            (
                row["information"],
                f"**{name}**" if row["kind"] == "model" else name,
                row["accuracy"],
                "–" if seeds is None else _mean_and_spread(seeds["mean"], seeds["std"], seeds["n"]),
                with_interval(row["auroc"], row["auroc_ci95"]),
                row["brier"],
                row["ece"],
                "–" if against is None else with_interval(against["difference"], against["ci95"]),
                "–" if against is None else f"{number(against['p_value'])} ({row['best_baseline']})",
            )
        )
    scores = ("Accuracy", "Over seeds", "AUROC", "Brier", "ECE")
    header = ("Is told", "Predictor", *scores, "Above the best baseline", "p (which)")
    return markdown_table(header, rows)


def _mean_and_spread(mean: float, std: float | None, n: int) -> str:
    return f"{mean:.3f}" + (f" ± {std:.3f} ({n})" if std is not None else "")


def _ceiling_words(report: dict[str, Any]) -> str:
    if not report["ceiling"]:
        return f"Ceiling: {report['ceiling_reason']}.\n"
    low, high = report["ceiling"]["accuracy_bounds"]
    return (
        f"Ceiling: two pulls of the same block agree in {number(report['ceiling'])}, so that nobody's accuracy "
        f"can be above a value between {low:.3f} and {high:.3f}.\n"
    )


def _first_pulls_table(first: dict[str, Any]) -> str:
    if not first:
        return ""
    rows = [(name, row["accuracy"], row["auroc"], row["brier"], row["ece"]) for name, row in first["rows"].items()]
    table = markdown_table(("Predictor", "Accuracy", "AUROC", "Brier", "ECE"), rows)
    return f"One pull a tower, as the paper has it ({first['n']:,} pulls):\n\n{table}"


def _pairs_table(pairs: Sequence[dict[str, Any]]) -> str:
    if not pairs:
        return ""
    rows = [
        (f"{pair['first']} against {pair['second']}", with_interval(pair["difference"], pair["ci95"]), pair["p_value"])
        for pair in pairs
    ]
    return markdown_table(("Models on the same pulls", "Difference in accuracy", "McNemar's p"), rows)


def _curve_table(curves: dict[str, Any]) -> str:
    rows = [
        (name, point["towers"], point["rows"], _mean_and_spread(point["accuracy"], point["std"], point["n"]))
        for name, points in curves.items()
        for point in points
    ]
    return markdown_table(("Trained on fewer", "Towers", "Rows", "Accuracy"), rows) if rows else ""


def _mistakes_table(mistakes: Sequence[dict[str, Any]]) -> str:
    rows = [
        (f"`{m['replay']}`", m["round"], m["level"], m["slot"], m["probability"], m["outcome"], f"`{m['trace']}`")
        for m in mistakes
    ]
    header = ("Worst mistakes", "Round", "Level", "Slot", "Predicted failure", "Outcome", "Where it comes from")
    return markdown_table(header, rows) if rows else ""


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
    parts = [markdown_table(header, rows)]
    return "\n".join([*parts, ceiling_tables(report)] if "ceiling" in report else parts)


def ceiling_tables(report: dict[str, Any]) -> str:
    """The simulator restarted from what a model is told, and how well plans are ranked."""
    ceiling, ranking = report["ceiling"], report["ranking"]
    rows = []
    for known, horizons in ((k, v) for k, v in ceiling.items() if isinstance(v, dict)):
        for name, entry in horizons.items():
            if entry["n"]:
                skills = (
                    with_interval(entry[f"skill_{who}"], entry[f"skill_{who}_ci95"]) for who in ("others", "target")
                )
                errors = (entry["rmse_mm_others"], entry["rmse_mm_target"])
                rows.append((known, name.replace("_", " "), *skills, *errors, entry["n"]))
    header = ("Simulator restarted from", "Horizon", "Skill, others", "target", "RMSE others [mm]", "target [mm]", "n")
    ranked = [
        (label, with_interval(ranking[key]["mean"], ranking[key]["ci95"]), ranking[key]["median"], ranking["n"])
        for label, key in (("**model**", "model"), ("the faster, the worse", "faster_is_worse"))
    ]
    plans = f"{ranking['plans']} plans of {ranking['steps']} steps"
    return "\n".join(
        [
            markdown_table(header, rows),
            markdown_table((f"Ranking of {plans}", "Rank correlation", "Median", "Decisions"), ranked),
            f"In {ranking['alike']} more decisions all plans do the same to the tower.\n",
        ]
    )


def extraction_tables(reports: Sequence[dict[str, Any]]) -> str:
    """Evaluations of the closed loop side by side, then why each failed."""
    rows = [
        (
            report["way"],
            report["objective"],
            report["dynamics"],
            ", ".join(sorted(name for name, on in report["switches"].items() if on)) or "none",
            report["success"],
            report["control_hz"],
        )
        for report in reports
    ]
    causes = sorted({cause for report in reports for cause in report["causes"]})
    parts = [markdown_table(("Way", "Objective", "Dynamics", "Switches", "Success", "Decisions a second"), rows)]
    if causes:
        header = ("Cause of failure", *(report["way"] for report in reports))
        counts = [(cause or "none given", *(report["causes"].get(cause, 0) for report in reports)) for cause in causes]
        parts.append(markdown_table(header, counts))
    return "\n".join(parts)


def extraction_report_tables(report: dict[str, Any]) -> str:
    """Every way to pull in one table, what it adds to the best straight pull, then why and when pulls fail."""
    ways, best = report["ways"], report["best_straight"]
    rows = []
    for name, row in ways.items():
        above = row.get("above_best_straight")
        rows.append(
            (
                f"**{name}**" if name == best else name,
                row["success"],
                row["success_without_dragging"],
                row["median_disturbance_mm"],
                row["speed"],
                MISSING if above is None else with_interval(above["difference"], above["ci95"]),
                MISSING if above is None else above["p_value"],
            )
        )
    against = f"Above {best}" if best else "Above the best straight pull"
    scores = ("Success", "Without dragging", "Disturbance [mm]", "Speed [m/s]", against, "p")
    paper = ", ".join(f"{name} {rate:.0%}" for name, rate in report["paper"].items())
    parts = [
        f"{report['towers']:,} towers; every tower that was started counts, missed grasps and bad pushes included. "
        f"The disturbance is the median over towers of the largest displacement of another block. The paper: {paper} "
        "of 100.\n",
        markdown_table(("Way to pull", *scores), rows),
        f"At least one of these ways succeeds in {number(report['any']['success'])} of the towers that all have, "
        f"without dragging in {number(report['any']['success_without_dragging'])}.\n",
        "".join(
            f"{name} over {seed['n']} checkpoints: {_mean_and_spread(seed['mean'], seed['std'], seed['n'])}.\n"
            for name, seed in report["seeds"].items()
        ),
    ]
    groups = list(dict.fromkeys(group for row in ways.values() for group in row["by_round"]))
    by_round = [(name, *(row["by_round"].get(group) for group in groups)) for name, row in ways.items()]
    parts.append(markdown_table(("Success in rounds", *groups), by_round))
    if causes := sorted({cause for row in ways.values() for cause in row["causes"]}):
        counts = [(cause, *(row["causes"].get(cause, 0) for row in ways.values())) for cause in causes]
        parts.append(markdown_table(("Cause of failure", *ways), counts))
    return "\n".join(part for part in parts if part)
