"""Classical classifiers whose settings are chosen by cross-validation over towers, within the rows that fit them."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Shaped
from sklearn.dummy import DummyClassifier
from sklearn.ensemble import HistGradientBoostingClassifier, RandomForestClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GridSearchCV, GroupKFold
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from threadpoolctl import threadpool_limits

FOLDS = 5
SEED = 0
"""Of the folds and of every learner's own draws: the same rows give the same predictions."""


@dataclass(frozen=True, eq=False)
class Learner:
    """A kind of classifier: `new` makes an unfitted one, `choices` are the settings to choose from; while they are
    compared, `meanwhile` makes fitting cheaper."""

    new: Callable[[], Any]
    choices: dict[str, list[Any]]
    meanwhile: dict[str, Any] = field(default_factory=dict)


LEARNERS: dict[str, Learner] = {
    "logistic": Learner(
        lambda: make_pipeline(StandardScaler(), LogisticRegression(max_iter=5000)),
        {"logisticregression__C": [0.01, 0.1, 1.0, 10.0]},
    ),
    "forest": Learner(
        lambda: RandomForestClassifier(300, random_state=SEED),
        {"min_samples_leaf": [2, 8], "max_features": ["sqrt", 0.5]},
        {"n_estimators": 60},
    ),
    "boosting": Learner(
        lambda: HistGradientBoostingClassifier(
            learning_rate=0.06,
            min_samples_leaf=10,
            early_stopping=False,  # pyright: ignore[reportArgumentType]  # its stub takes the default for the type
            random_state=SEED,
        ),
        {"max_iter": [50, 150], "max_leaf_nodes": [4, 12]},
    ),
}


@dataclass(frozen=True, eq=False)
class Fitted:
    """A fitted classifier and the settings that were chosen for it."""

    model: Any
    settings: dict[str, Any]

    def probability(self, feature: Float[np.ndarray, "row feature"]) -> Float[np.ndarray, " row"]:
        """Of a failure."""
        classes = list(self.model.classes_)
        if len(feature) == 0 or True not in classes:
            return np.zeros(len(feature))
        with threadpool_limits(1):
            return self.model.predict_proba(feature)[:, classes.index(True)].astype(float)


def fit(
    learner: str,
    feature: Float[np.ndarray, "row feature"],
    failure: Bool[np.ndarray, " row"],
    tower: Shaped[np.ndarray, " row"],
    settings: dict[str, Any] | None = None,
) -> Fitted:
    """Fit a learner; its settings are those with the least Brier score on towers left out, or `settings`.

    Rows of one class alone give that class always; too few towers to leave some out, the learner's own defaults.
    """
    if len(np.unique(failure)) < 2:
        return Fitted(DummyClassifier(strategy="prior").fit(feature, failure), {})
    kind = LEARNERS[learner]
    with threadpool_limits(1):  # threads that wait for each other on busy cores take many times longer
        if settings is None:
            settings = _chosen(kind, feature, failure, tower)
        return Fitted(kind.new().set_params(**settings).fit(feature, failure), settings)


def _chosen(kind: Learner, feature: np.ndarray, failure: np.ndarray, tower: np.ndarray) -> dict[str, Any]:
    splits = _splits(failure, tower)
    if not splits:
        return {}
    model = kind.new().set_params(**kind.meanwhile)
    search = GridSearchCV(model, kind.choices, scoring=_minus_brier, cv=splits, refit=False)
    return dict(search.fit(feature, failure).best_params_)


def _splits(failure: Bool[np.ndarray, " row"], tower: Shaped[np.ndarray, " row"]) -> list[tuple[Any, Any]]:
    """Folds of whole towers that leave both classes to fit on."""
    folds = min(FOLDS, len(np.unique(tower)))
    if folds < 2:
        return []
    found = GroupKFold(folds, shuffle=True, random_state=SEED).split(failure, failure, tower)
    return [(fitted, held) for fitted, held in found if len(np.unique(failure[fitted])) == 2]


def _minus_brier(model: Any, feature: np.ndarray, failure: np.ndarray) -> float:
    probability = model.predict_proba(feature)[:, list(model.classes_).index(True)]
    return -float(np.mean((probability - failure) ** 2))
