"""How well anyone can predict the outcome of a pull: the same pull is made again with other noise.

If pull i fails with probability p_i, nobody who knows the tower alone is right more often than in
c = mean(max(p_i, 1 - p_i)) of the cases. Two pulls agree with probability a = mean(p_i^2 + (1 - p_i)^2), and
a <= c <= (1 + sqrt(2 a - 1)) / 2; the left bound is reached where every p_i is 0, 1/2 or 1, the right one where they
are all alike (Jensen).
"""

from collections import Counter
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from jenga_data.calibrate import figures
from jenga_data.calibrate.cases import Case
from jenga_data.calibrate.run import Run
from jenga_data.calibrate.trial import described, judged_pull, tower_and_targets
from jenga_data.collect.config import SelectionConfig
from jenga_data.errors import JengaError
from jenga_data.outcome import Outcome
from jenga_data.report import markdown_table, with_interval
from jenga_data.statistics import Interval, proportion_over_towers, ratio_bootstrap


def repeated_pulls(config: SelectionConfig, seed: int, number: int, targets: int, repeats: int) -> dict[str, Any]:
    """Pull `targets` random legal targets of one tower, each `repeats` times from the same state with other noise."""
    _, stages = tower_and_targets(config, seed, number, targets)
    return {
        "pulls": [
            described(stage) | {"repeats": [judged_pull(config, stage, seed, repeat) for repeat in range(repeats)]}
            for stage in stages
        ]
    }


def accuracy_bounds(agreement: float) -> tuple[float, float]:
    """Between what the accuracy of the best predictor lies, given how often two pulls agree."""
    return agreement, (1 + float(np.sqrt(max(0.0, 2 * agreement - 1)))) / 2


def agreement(failure: Bool[np.ndarray, "pull repeat"]) -> Float[np.ndarray, " pull"]:
    """For each pull the share of all pairs of repeats that agree: unbiased for p^2 + (1 - p)^2."""
    repeats = failure.shape[1]
    failed = failure.sum(1)
    pairs = failed * (failed - 1) + (repeats - failed) * (repeats - failed - 1)
    return pairs / (repeats * (repeats - 1))


def best_accuracy(failure: Bool[np.ndarray, "pull repeat"]) -> tuple[Float[np.ndarray, " pull"], ...]:
    """For each pull two estimates of max(p, 1 - p) that bracket it in expectation.

    The lower one says of each repeat what most of the others say (a tie is worth a half): a predictor that has seen
    that many pulls. The upper one is max(p', 1 - p') with p' the share that failed, which fits its own noise.
    """
    repeats = failure.shape[1]
    failed = failure.sum(1, keepdims=True)
    others = failed - failure
    vote = np.sign(2 * others - (repeats - 1))
    right = np.where(vote == 0, 0.5, (vote > 0) == failure)
    share = failed[:, 0] / repeats
    return right.mean(1), np.maximum(share, 1 - share)


def mean_over_towers(values: Float[np.ndarray, " pull"], tower: np.ndarray) -> tuple[float, Interval | None]:
    """A mean with its 95 % interval over towers."""
    return float(values.mean()), ratio_bootstrap(values, np.ones(len(values)), tower)


def ceiling_report(run: Run, config: SelectionConfig, targets: int, repeats: int, repeated: int) -> dict[str, Any]:
    """Pull targets of many towers twice, and about `repeated` of them `repeats` times.

    Raises:
        JengaError: fewer than one target, than two repeats, or than no repeated pulls.
    """
    if targets < 1 or repeats < 2 or repeated < 0:
        raise JengaError(
            f"targets is {targets}, repeats is {repeats}, repeated is {repeated}; "
            "allowed: 1 or more, 2 or more, 0 or more"
        )
    many = -(-repeated // targets)
    cases: list[Case] = [
        (
            repeated_pulls,
            {
                "config": config, "seed": run.seed, "number": n, "targets": targets,
                "repeats": repeats if n < many else 2,
            },
        )
        for n in range(run.towers)
    ]  # fmt: skip
    pulls = [pull for result in run.cases("ceiling", cases) for pull in result["pulls"]]
    tower = np.array([p["tower"] for p in pulls])
    outcome = np.array([[r["outcome"] for r in p["repeats"][:2]] for p in pulls])
    failure = np.array([[r["failure"] for r in p["repeats"][:2]] for p in pulls], bool)
    strict = np.array([[r["strict_failure"] for r in p["repeats"][:2]] for p in pulls], bool)
    round_number, slot = np.array([p["round"] for p in pulls]), np.array([p["slot"] for p in pulls])
    same = failure[:, 0] == failure[:, 1]
    deep = [p for p in pulls if len(p["repeats"]) == repeats]
    votes = np.array([[r["failure"] for r in p["repeats"]] for p in deep], bool).reshape(-1, repeats)
    every = Counter(r["outcome"] for p in pulls for r in p["repeats"])
    report: dict[str, Any] = {
        "agreement": proportion_over_towers(same, tower),
        "accuracy_bounds": list(accuracy_bounds(float(same.mean()))),
        "strict_agreement": proportion_over_towers(strict[:, 0] == strict[:, 1], tower),
        "failure": proportion_over_towers(failure[:, 0], tower),
        "strict_failure": proportion_over_towers(strict[:, 0], tower),
        "outcomes": dict(sorted(Counter(outcome[:, 0].tolist()).items())),
        "episodes": sum(every.values()),
        "invalid": every[Outcome.INVALID.value],
        "by_round": {
            str(r): _group(failure, tower, round_number == r) for r in np.unique(round_number)
        },
        "by_slot": {
            name: _group(failure, tower, (slot == 1) == middle) for name, middle in (("middle", True), ("side", False))
        },
        "towers": run.towers,
        "seed": run.seed,
    }  # fmt: skip
    if repeats > 2 and len(deep):
        where = np.array([p["tower"] for p in deep])
        low, high = best_accuracy(votes)
        means = {"agreement": agreement(votes), "lower": low, "upper": high}
        summed = {name: mean_over_towers(values, where) for name, values in means.items()}
        report["repeated"] = {
            "pulls": len(deep),
            "repeats": repeats,
            **{name: {"mean": mean, "ci95": None if ci is None else list(ci)} for name, (mean, ci) in summed.items()},
        }
    rows: list[tuple[Any, ...]] = [
        ("two pulls agree (failure or not)", report["agreement"]),
        ("two pulls agree, strict failure", report["strict_agreement"]),
        ("failure rate", report["failure"]),
        ("strict failure rate", report["strict_failure"]),
    ]
    low, high = report["accuracy_bounds"]
    text = (
        f"{len(pulls)} targets of {run.towers} towers of rounds {config.spawn.first_round} to "
        f"{config.spawn.last_round}, pulled at {config.speed} m/s with at most {config.force_limit} N; "
        f"{report['episodes']:,} pulls in all, {report['invalid']} of them invalid.\n\n"
        + markdown_table(("", "Share"), rows)
        + f"\nThe best accuracy that anyone can reach lies between {low:.3f} and {high:.3f}"
    )
    if "repeated" in report:
        r = report["repeated"]
        narrow = ", ".join(
            f"{label} {with_interval(r[name]['mean'], r[name]['ci95'])}"
            for name, label in (("lower", "a vote of the other repeats is right in"), ("upper", "at most"))
        )
        text += f"; {r['repeats']} repeats of {r['pulls']} pulls narrow that: {narrow}"
    text += ".\n"
    for title, key in (("Round", "by_round"), ("Slot", "by_slot")):
        groups = [(name, group["failure"], group["agreement"]) for name, group in report[key].items()]
        text += "\n" + markdown_table((title, "Failure", "Two pulls agree"), groups)
    text += "\n" + markdown_table(("Outcome", "Pulls"), list(report["outcomes"].items()))
    return run.write("ceiling", report, text, partial(figures.ceiling, report["by_round"], votes))


def _group(failure: np.ndarray, tower: np.ndarray, which: np.ndarray) -> dict[str, Any]:
    return {
        "failure": proportion_over_towers(failure[which, 0], tower[which]),
        "agreement": proportion_over_towers(failure[which, 0] == failure[which, 1], tower[which]),
    }
