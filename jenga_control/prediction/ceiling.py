"""How good a model of the tower can be that is told so much, and how well one ranks the plans of a decision."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from jenga_control.planning.cost import CostConfig, disturbance_cost
from jenga_control.planning.dynamics import Dynamics, Learned
from jenga_control.prediction.evaluate import Predictions, horizon_report
from jenga_control.prediction.restarts import STEPS, Branches, stored
from jenga_data.blocks import Blocks
from jenga_data.collect.resume import KNOWN
from jenga_data.statistics import ratio_bootstrap, spearman
from jenga_data.tower import Layout, TowerState

VARIES = 1e-4
"""Decisions count whose plans' true disturbance has an interquartile range above this [m]: else all plans are alike."""


def ceiling_report(states: Iterable[Branches]) -> dict[str, Any]:
    """Skill and error of the simulator itself, restarted from what a model is told, against how the log goes on."""
    some = list(states)
    report: dict[str, Any] = {"states": len(some), "towers": len({state.tower for state in some})}
    for branch, known in enumerate(KNOWN):
        report[known] = {}
        for name, steps in (("one_step", 1), (f"rollout_{STEPS}", STEPS)):
            report[known][name] = horizon_report(_restarted(some, branch, steps)) if some else {"n": 0}
    return report


def _restarted(some: list[Branches], branch: int, steps: int) -> Predictions:
    no = np.zeros(len(some), bool)
    return Predictions(
        start=np.array([state.pose[0, 0] for state in some]),
        predicted=np.array([state.pose[branch, steps] for state in some]),
        truth=np.array([state.pose[-1, steps] for state in some]),
        action=np.array([state.plan[0, :steps].sum(0) for state in some]),
        target=np.array([state.target for state in some]),
        tower=np.array([state.tower for state in some]),
        clear=no,
        collapsed=no,
    )


def disturbance(pose: Float[np.ndarray, "plan moment block 7"], target: int) -> Float[np.ndarray, " plan"]:
    """How far all blocks but the target move over a plan, summed over blocks and steps [m] (the paper's O_d)."""
    return disturbance_cost(pose[:, :-1], pose[:, 1:], target, CostConfig(gamma=1.0)).sum(-1)


def ranking_report(decisions: Iterable[Branches], dynamics: Dynamics | None) -> dict[str, Any]:
    """Spearman's rank correlation between predicted and true disturbance over the plans of a decision.

    The mean over decisions whose true disturbance varies, with its interval over towers. `faster_is_worse` is the
    trivial ranking, by how far a plan pulls along -x.
    """
    said: dict[str, list[float]] = {"model": [], "faster_is_worse": []}
    towers, alike, plans, horizon = [], 0, 0, 0
    for decision in decisions:
        truth = disturbance(decision.pose, decision.target)
        if not varies(truth):
            alike += 1
            continue
        towers.append(decision.tower)
        plans, horizon = decision.plan.shape[:2]
        said["faster_is_worse"].append(spearman(-decision.plan[..., 0].sum(1), truth))
        if dynamics is not None:
            told = {"lag": decision.lag} if isinstance(dynamics, Learned) else {}
            dynamics.start(state_of(decision), decision.target, **told)
            predicted = disturbance(dynamics.rollout(decision.plan), decision.target)
            said["model"].append(spearman(predicted, truth))
    found: dict[str, Any] = {"n": len(towers), "alike": alike, "plans": plans, "steps": horizon}
    for name, values in said.items():
        known = np.nan_to_num(np.array(values))  # a model that says the same of all plans ranks none
        interval = ratio_bootstrap(known, np.ones(len(known)), np.array(towers)) if len(known) else None
        found[name] = {
            "mean": float(known.mean()) if len(known) else None,
            "ci95": None if interval is None else list(interval),
            "median": float(np.median(known)) if len(known) else None,
            "quartiles": np.quantile(known, [0.25, 0.75]).tolist() if len(known) else None,
        }
    return found


def varies(truth: Float[np.ndarray, " plan"]) -> bool:
    """Whether the plans of a decision differ in what they do to the tower."""
    low, high = np.quantile(truth, [0.25, 0.75])
    return bool(high - low > VARIES)


def state_of(branches: Branches) -> TowerState:
    """The tower from which they start."""
    blocks = Blocks(branches.block_size, branches.block_mass)
    layout = Layout.from_places(branches.level, branches.slot)
    return TowerState(blocks, layout, branches.pose[0, 0], branches.twist)


def from_folder(folder: Path, dynamics: Dynamics | None) -> dict[str, Any]:
    """Both reports, of what `jenga eval simulator` left in a folder."""
    ranking = ranking_report(stored(folder, "decision"), dynamics)
    return {"ceiling": ceiling_report(stored(folder, "restart")), "ranking": ranking}
