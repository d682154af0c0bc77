"""`jenga report selection`: the whole table of the paper's experiment, any number of models beside the baselines."""

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from jenga_control.selection import figures
from jenga_control.selection.baselines.suite import LEARNED, Side, Which, predict_baselines
from jenga_control.selection.curve import baseline_curve, model_curve
from jenga_control.selection.evaluate import NO_CEILING, read_ceiling, sides
from jenga_control.selection.mistakes import worst_mistakes
from jenga_control.selection.models import Family, families
from jenga_control.selection.pulls import INFORMATION, Prediction, first_pulls
from jenga_control.selection.scores import grouped_scores, more_often_right, scores
from jenga_control.selection.towers import shown_towers, towers_figure
from jenga_control.tables import selection_report_tables
from jenga_data.graph_spec import GRAPHS
from jenga_data.replay import style
from jenga_data.report import in_points, number, write_report
from jenga_models.columns import Rows, dataset_name

NAME = "selection"


def report_selection(
    models: Sequence[Path],
    dataset: Rows,
    out: Path,
    baselines: Which = "all",
    more: Sequence[Rows] = (),
    ceiling: Path | None = None,
    logs: Path | None = None,
    workers: int = 1,
) -> dict[str, Any]:
    """Write selection.json, selection.md and the figures into `out`.

    Args:
        models: folders of checkpoints.
        more: datasets whose train and validation towers fit the baselines as well, as they did the models.
        ceiling: the report that `jenga calibrate ceiling` wrote.
        logs: folder of the episodes' logs, for the commands that replay mistakes.
        workers: processes that compute mechanics.

    Raises:
        JengaError: a checkpoint or dataset is of another kind, a split is empty, or towers are on both sides.
    """
    measured = read_ceiling(ceiling) if ceiling else None
    train, test = sides(dataset, more, workers)
    rows = dataset.rows("test")
    trained, notes = families(models, dataset, rows)
    fitted = predict_baselines(train, test, baselines)
    shown = largest(trained)
    table = [entry(p, fitted, test) for p in fitted] + [entry(f.prediction, fitted, test, f) for f in shown]
    first = first_pulls(dataset, rows)
    chosen = best_family(shown, test)
    report: dict[str, Any] = {
        "dataset": dataset_name(dataset),
        "dataset_hash": dataset.hash,
        "notes": notes,
        "n": len(test.pulls),
        "towers": len(np.unique(test.pulls.tower)),
        "fitted_to": {
            "datasets": [dataset_name(part) for part in (dataset, *more)],
            "rows": len(train.pulls),
            "towers": len(np.unique(train.pulls.tower)),
        },
        "failures": float(test.pulls.failure.mean()),
        "majority": table[0]["accuracy"],
        "ceiling": measured,
        **({} if measured else {"ceiling_reason": NO_CEILING}),
        "rows": {row.pop("name"): row for row in table},
        "one_pull_a_tower": {} if first.all() else _first_only([*fitted, *(f.prediction for f in shown)], test, first),
        "pairs": pairs([f.prediction for f in shown], test),
        "poses": poses([*fitted, *(f.prediction for f in shown)], pose_pairs(shown), test),
        "learning_curve": curves(fitted, trained, train, test),
        "best": chosen.name if chosen else None,
    }
    report["mistakes"] = worst_mistakes(dataset, rows, chosen, test, logs) if chosen else []
    return _written(report, out, dataset, rows, test, [*fitted, *(f.prediction for f in shown)], chosen)


def information_of(graph: str) -> str:
    """The least information that holds what a graph's nodes hold."""
    if graph in INFORMATION:
        return graph
    held = GRAPHS[graph].node_features if graph in GRAPHS else ("block_pose",)
    return "G_sp" if "block_pose" in held else "G_s+layout" if {"level", "slot"} & set(held) else "G_s"


def told_no_more(information: str) -> tuple[str, ...]:
    """Kinds of information that hold nothing beyond this one."""
    return INFORMATION[: INFORMATION.index(information_of(information)) + 1]


def best_of(predictions: Sequence[Prediction], information: str, test: Side) -> Prediction:
    """The baseline with the highest accuracy on the test rows among those that were told no more: choosing on the
    test rows flatters the baseline, never the model that is compared with it."""
    told = [p for p in predictions if p.information in told_no_more(information)]
    return max(told, key=lambda p: float((p.said == test.pulls.failure).mean()))


def best_family(found: Sequence[Family], test: Side) -> Family | None:
    """Whose mistakes are shown: that with the least Brier score."""
    return min(found, key=lambda f: float(np.mean((f.prediction.probability - test.pulls.failure) ** 2)), default=None)


def largest(found: Sequence[Family]) -> list[Family]:
    """Of families that differ by the amount of training data alone, the one that was trained on the most."""
    kept: dict[str, Family] = {}
    for family in found:
        other = kept.setdefault(family.recipe, family)
        if family.size.get("training_rows", np.inf) > other.size.get("training_rows", np.inf):
            kept[family.recipe] = family
    return list(kept.values())


def entry(p: Prediction, fitted: Sequence[Prediction], test: Side, family: Family | None = None) -> dict[str, Any]:
    """One row of the table."""
    row: dict[str, Any] = {
        "name": p.name,
        "kind": "model" if family else "baseline",
        "information": information_of(p.information),
        **scores(p.probability, test.pulls),
        **grouped_scores(p.probability, test.pulls),
    }
    if family is None:
        return row | {"settings": p.settings}
    rival = best_of(fitted, p.information, test)
    return row | {
        "graph": p.information,
        "best_baseline": rival.name,
        "minus_best_baseline": more_often_right(p.said, rival.said, test.pulls),
        "seeds": family.spread(test.pulls),
        "size": family.size,
        "members": [{"model": m.name, "hash": m.hash} for m in family.members],
    }


def _first_only(found: Sequence[Prediction], test: Side, first: Bool[np.ndarray, " row"]) -> dict[str, Any]:
    pulls = test.pulls.of(first)
    return {"n": len(pulls), "rows": {p.name: scores(p.probability[first], pulls) for p in found}}


def pairs(found: Sequence[Prediction], test: Side) -> list[dict[str, Any]]:
    """Every two models on the same pulls."""
    return [
        {"first": a.name, "second": b.name, **more_often_right(a.said, b.said, test.pulls)}
        for a, b in combinations(found, 2)
    ]


def pose_pairs(found: Sequence[Family]) -> list[tuple[str, str]]:
    """Names of models that differ by the graph alone, one with poses and one without."""
    with_poses = [f for f in found if f.graph == "G_sp"]
    return [
        (a.name, b.name)
        for a in with_poses
        for b in found
        if b.graph == "G_s" and a.recipe_without_graph == b.recipe_without_graph
    ]


_BASELINE_PAIRS = (
    ("mechanics_poses_logistic", "mechanics_logistic"),
    ("mechanics_poses_forest", "mechanics_forest"),
)


def poses(found: Sequence[Prediction], named: Sequence[tuple[str, str]], test: Side) -> list[dict[str, Any]]:
    """Whether metric poses help, as the paper asks: with them against without, in a sentence made from the numbers."""
    known = {p.name: p for p in found}
    said = []
    for with_poses, without in (*named, *_BASELINE_PAIRS):
        if with_poses in known and without in known:
            compared = more_often_right(known[with_poses].said, known[without].said, test.pulls)
            sentence = verdict(with_poses, without, compared)
            said.append({"with": with_poses, "without": without, **compared, "sentence": sentence})
    return said


def verdict(with_poses: str, without: str, compared: dict[str, Any]) -> str:
    """One sentence: poses help, hurt, or make no difference that these pulls can show."""
    more, p = compared["difference"], compared["p_value"]
    shown = f"{in_points(more, compared['ci95'])} points, p = {number(p)}, n = {compared['n']:,}"
    effect = "make no difference that these pulls can show" if p >= 0.05 else "help" if more > 0 else "hurt"
    return f"Poses {effect}: {with_poses} against {without} {shown}."


def curves(fitted: Sequence[Prediction], trained: Sequence[Family], train: Side, test: Side) -> dict[str, Any]:
    """Accuracy against training towers: of the best learned baseline of each information, and of every model."""
    found: dict[str, Any] = {}
    by_name = {baseline.name: baseline for baseline in LEARNED}
    for information in INFORMATION[1:]:
        learned = [p for p in fitted if p.information == information and p.name in by_name]
        if learned:
            top = max(learned, key=lambda p: float((p.said == test.pulls.failure).mean()))
            found[top.name] = baseline_curve(by_name[top.name], top.settings, train, test)
    everything = len(np.unique(train.pulls.tower))
    for recipe in dict.fromkeys(f.recipe for f in trained):
        same = [f for f in trained if f.recipe == recipe]
        found[largest(same)[0].name] = model_curve(same, test, everything)
    return found


def _written(
    report: dict[str, Any],
    out: Path,
    dataset: Rows,
    rows: np.ndarray,
    test: Side,
    found: Sequence[Prediction],
    chosen: Family | None,
) -> dict[str, Any]:
    out.mkdir(parents=True, exist_ok=True)
    drawn = {
        "table": lambda: figures.accuracies(report),
        "reliability": lambda: figures.reliability(_most_telling(report, found), test.pulls),
        "rounds": lambda: figures.by_round(report, _compared(report)),
        "curve": lambda: figures.learning_curve(report),
    }
    if chosen is not None:
        shown = shown_towers(dataset, rows)
        drawn["towers"] = lambda: towers_figure(dataset, rows, shown, chosen.members)
    pictures = {}
    with style.applied():
        for name, draw in drawn.items():
            pictures[name] = out / f"{NAME}-{name}.png"
            style.save(draw(), pictures[name])
    text = selection_report_tables(report)
    images = "\n".join(f"![{name}]({path.name})" for name, path in pictures.items())
    written = write_report(out, NAME, report, f"{text}\n{images}\n")
    return report | {"written": [str(path) for path in (*written, *pictures.values())], "text": text}


def _compared(report: dict[str, Any]) -> list[str]:
    """Rows worth a curve of their own: majority, the best baseline and the best model."""
    rows = report["rows"]

    def top(kind: str) -> list[str]:
        of_kind = [name for name, row in rows.items() if row["kind"] == kind and name != "majority"]
        return sorted(of_kind, key=lambda name: -rows[name]["accuracy"]["rate"])[:1]

    return ["majority", *top("baseline"), *([report["best"]] if report["best"] else [])]


def _most_telling(report: dict[str, Any], found: Sequence[Prediction]) -> list[Prediction]:
    """Probabilities worth a reliability diagram: the best model's and the best learned baseline's."""
    learned = {baseline.name for baseline in LEARNED}
    rivals = sorted((p for p in found if p.name in learned), key=lambda p: report["rows"][p.name]["brier"])[:1]
    return [*rivals, *(p for p in found if p.name == report["best"])]
