"""The baselines by name, and what each says of pulls that it has not seen."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from jenga_control.selection.baselines.features import FeatureTable, Part
from jenga_control.selection.baselines.learners import fit
from jenga_control.selection.pulls import Prediction, Pulls
from jenga_data.progress import progress
from jenga_data.tower import CENTRE

Which = Literal["none", "quick", "all"]


@dataclass(frozen=True)
class Baseline:
    """One row of the table: what it is told, the features made of that, and the learner that is fitted to them."""

    name: str
    information: str
    features: str
    learner: str
    quick: bool = True
    """Takes seconds; the others solve two equilibria a row."""


LEARNED = (
    *(Baseline(f"{learner}_graph", "G_s", "graph", learner) for learner in ("logistic", "forest", "boosting")),
    *(Baseline(f"{learner}_layout", "G_s+layout", "layout", learner) for learner in ("logistic", "forest", "boosting")),
    Baseline("mechanics_logistic", "G_s+layout", "mechanics", "logistic", quick=False),
    Baseline("mechanics_forest", "G_s+layout", "mechanics+layout", "forest", quick=False),
    Baseline("mechanics_poses_logistic", "G_sp", "mechanics+poses", "logistic", quick=False),
    Baseline("mechanics_poses_forest", "G_sp", "mechanics+poses", "forest", quick=False),
)


@dataclass(frozen=True, eq=False)
class Side:
    """Pulls with what became of them and their features: those to fit on, or those to predict."""

    pulls: Pulls
    features: FeatureTable

    @classmethod
    def of(cls, parts: Sequence[Part], workers: int = 1) -> "Side":
        """Rows of one dataset or of several."""
        pulls = Pulls.joined([Pulls.of_dataset(dataset, rows) for dataset, rows in parts])
        return cls(pulls, FeatureTable(parts, workers))


def baselines(which: Which) -> list[Baseline]:
    """Those that are fitted: none, the quick ones, or all."""
    return [b for b in LEARNED if which == "all" or (which == "quick" and b.quick)]


def predict_baselines(train: Side, test: Side, which: Which) -> list[Prediction]:
    """What each baseline says of `test`, fitted to `train` alone: the rules always, the learned ones as asked for."""
    found = rules(train, test)
    learned = baselines(which)
    with progress("baselines", len(learned)) as bar:
        for baseline in learned:
            found.append(predict(baseline, train, test))
            bar.advance()
    return found


def predict(baseline: Baseline, train: Side, test: Side) -> Prediction:
    """One learned baseline."""
    fitted = fit(baseline.learner, train.features.matrix(baseline.features), train.pulls.failure, train.pulls.tower)
    probability = fitted.probability(test.features.matrix(baseline.features))
    return Prediction(baseline.name, baseline.information, probability, fitted.settings)


def rules(train: Side, test: Side) -> list[Prediction]:
    """Predictors without a learner.

    `majority` gives every pull the share of failures. `middle_first` says that a pull fails unless its target is the
    centre block, `loosest_first` unless the target is lower than the mean of its level mates: or the other way round,
    whichever is right more often on `train`. They give no probabilities but 0 and 1.
    """
    share = float(train.pulls.failure.mean())
    found = [Prediction("majority", "none", np.full(len(test.pulls), share), {})]
    for name, information in (("loosest_first", "G_s"), ("middle_first", "G_s+layout")):
        fails, when_so = _rule(name, train), train.pulls.failure
        as_named = bool((fails == when_so).mean() >= 0.5)
        found.append(Prediction(name, information, _certain(_rule(name, test) == as_named), {"as_named": as_named}))
    return found


def _rule(name: str, side: Side) -> Bool[np.ndarray, " row"]:
    """Whether the rule as it is named says that a pull fails."""
    if name == "middle_first":
        return side.pulls.slot != CENTRE
    return side.features.column("graph", "over_mean_of_siblings") >= 0


def _certain(fails: Bool[np.ndarray, " row"]) -> Float[np.ndarray, " row"]:
    return fails.astype(float)
