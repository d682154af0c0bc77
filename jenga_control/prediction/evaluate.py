"""How well a model predicts the tower's next poses: errors and skill on held-out towers, one step and open loop.

Skill is 1 - MSE / MSE of the trivial prediction: 1 is the truth, 0 no better than the other blocks staying where
they are and the target moving by the action, below 0 worse than that.
"""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from jenga_control.planning.dynamics import target_moves
from jenga_data.errors import JengaError
from jenga_data.statistics import ratio_bootstrap
from jenga_models.checkpoint import Checkpoint, check_dataset
from jenga_models.columns import Rows, dataset_name
from jenga_models.metrics import predict_dynamics, rollout_dynamics, windows
from jenga_models.predict import opened

HORIZONS = {"one_step": 1, "rollout_5": 5, "rollout_51": 51}
"""Steps of each figure: one step, the controller's horizon, a whole extraction (paper, section II-C)."""


@dataclass(frozen=True, eq=False)
class Predictions:
    """Predicted and true towers a number of steps after `start`, one row each, in the world [m].

    `action` is the sum of the actions of those steps. `clear`: the target is clear of the tower at `start`.
    `collapsed`: the tower has collapsed by the time of `truth`.
    """

    start: Float[np.ndarray, "row block 7"]
    predicted: Float[np.ndarray, "row block 7"]
    truth: Float[np.ndarray, "row block 7"]
    action: Float[np.ndarray, "row 3"]
    target: Int[np.ndarray, " row"]
    tower: Shaped[np.ndarray, " row"]
    clear: Bool[np.ndarray, " row"]
    collapsed: Bool[np.ndarray, " row"]

    def __len__(self) -> int:
        return len(self.target)

    def at(self, rows: Bool[np.ndarray, " row"]) -> "Predictions":
        return Predictions(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})


def rotation_angle(
    first: Float[np.ndarray, "*batch 4"], second: Float[np.ndarray, "*batch 4"]
) -> Float[np.ndarray, "*batch"]:
    """Angle between two rotations [rad], from the chord between their quaternions: exact for small angles too."""
    first = first / np.linalg.norm(first, axis=-1, keepdims=True)
    second = second / np.linalg.norm(second, axis=-1, keepdims=True)
    chord = np.minimum(np.linalg.norm(first - second, axis=-1), np.linalg.norm(first + second, axis=-1))
    return 4 * np.arcsin(np.minimum(chord / 2, 1.0))


def squared_errors(
    predicted: Float[np.ndarray, "row block 7"], truth: Float[np.ndarray, "row block 7"]
) -> dict[str, Float[np.ndarray, "row block"]]:
    """Squared error of each block: of its position [m^2] and of its rotation [rad^2]."""
    return {
        "position": ((predicted[..., :3] - truth[..., :3]) ** 2).sum(-1),
        "rotation": rotation_angle(predicted[..., 3:], truth[..., 3:]) ** 2,
    }


def horizon_report(rows: Predictions) -> dict[str, Any]:
    """Skill, with its interval over towers, and errors of the target and of all other blocks.

    Errors are root mean squares over rows and blocks. A value that cannot be computed (no rows, a trivial
    prediction without error, a model that diverged) is None; `not_finite` counts the rows on which it diverged.
    """
    diverged = ~np.isfinite(rows.predicted).all((1, 2))
    report: dict[str, Any] = {
        "n": len(rows),
        "towers": len(np.unique(rows.tower)),
        "not_finite": int(diverged.sum()),
    }
    is_target = np.arange(rows.start.shape[1]) == rows.target[:, None]
    start = rows.start.astype(float)
    trivial = target_moves(start, rows.action.astype(float), rows.target)
    truth, predicted = rows.truth.astype(float), rows.predicted.astype(float)
    with np.errstate(invalid="ignore", over="ignore"):
        model, baseline = squared_errors(predicted, truth), squared_errors(trivial, truth)
        for who, counted in (("others", ~is_target), ("target", is_target)):
            error, reference = (
                {kind: np.where(counted, squared, 0.0).sum(1) for kind, squared in errors.items()}
                for errors in (model, baseline)
            )
            blocks = float(counted.sum())
            interval = ratio_bootstrap(error["position"], reference["position"], rows.tower)
            report |= {
                f"skill_{who}": _known(1 - _ratio(error["position"].sum(), reference["position"].sum())),
                f"skill_{who}_ci95": None if interval is None else [1 - interval[1], 1 - interval[0]],
                f"rmse_mm_{who}": _known(1e3 * np.sqrt(_ratio(error["position"].sum(), blocks))),
                f"rmse_deg_{who}": _known(np.degrees(np.sqrt(_ratio(error["rotation"].sum(), blocks)))),
                f"trivial_rmse_mm_{who}": _known(1e3 * np.sqrt(_ratio(reference["position"].sum(), blocks))),
                f"trivial_rmse_deg_{who}": _known(np.degrees(np.sqrt(_ratio(reference["rotation"].sum(), blocks)))),
            }
    return report


def _ratio(above: float, below: float) -> float:
    return above / below if below > 0 else float("nan")


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def dynamics_report(horizons: dict[str, Predictions]) -> dict[str, Any]:
    """A report for each named horizon: rows of a pull in a standing tower, and the rest of them apart.

    `after_clear` holds the rows that start when the target is clear of the tower already, `collapse` those that
    end in a collapsed tower: in the first nothing is left to predict, in the second nothing can be.
    """
    report: dict[str, Any] = {}
    for name, rows in horizons.items():
        report[name] = {
            **horizon_report(rows.at(~rows.clear & ~rows.collapsed)),
            "after_clear": horizon_report(rows.at(rows.clear & ~rows.collapsed)),
            "collapse": horizon_report(rows.at(rows.collapsed)),
        }
    return {
        **report,
        "rank_correlation": None,
        "rank_correlation_reason": "not measured: it needs --truth, see `jenga eval simulator`, the simulator on plans",
    }


def _predictions(checkpoint: Checkpoint, dataset: Rows, window: Int[np.ndarray, "row step"]) -> Predictions:
    """What the model says of the tower at the end of each window, from its first row's poses and its actions."""
    first, last = window[:, 0], window[:, -1]
    if window.shape[1] == 1:
        predicted = predict_dynamics(checkpoint, dataset, first)
    else:
        predicted = rollout_dynamics(checkpoint, dataset, window)[:, -1]
    return Predictions(
        start=dataset.column("block_pose")[first],
        predicted=predicted,
        truth=dataset.column("next_pose")[last],
        action=dataset.column("action")[window].sum(1, dtype=float),
        target=dataset.column("target")[first],
        tower=dataset.column("tower")[first],
        clear=dataset.column("target_clear")[first],
        collapsed=np.asarray(dataset.column("collapsed")[window].any(1)),
    )


def evaluate_dynamics(checkpoint: Checkpoint | Path | str, dataset: Rows, truth: Path | None = None) -> dict[str, Any]:
    """Score a dynamics model on the test split of a dataset of transitions.

    A rollout is compared with the truth after its last step. Rollouts of one episode do not overlap. A horizon
    that no test episode is long enough for has no rows, and a `reason`.

    Args:
        truth: folder of `jenga eval simulator`, for the rank correlation of plans and the ceiling.

    Raises:
        JengaError: there are no test rows, or the checkpoint or the dataset is of another kind.
    """
    model = opened(checkpoint, "dynamics")
    note = check_dataset(model, dataset)
    test = dataset.rows("test")
    if len(test) == 0:
        raise JengaError(f"{dataset_name(dataset)} has no test rows: collect more towers and convert them together")
    horizons, too_long = {}, {}
    for name, steps in HORIZONS.items():
        try:
            window = windows(dataset, test, steps)
        except JengaError as error:
            window = np.zeros((0, steps), np.int64)
            too_long[name] = str(error)
        horizons[name] = _predictions(model, dataset, window)
    report = dynamics_report(horizons)
    for name, reason in too_long.items():
        report[name]["reason"] = reason
    return {
        "model": model.name,
        "model_hash": model.hash,
        "dataset": dataset_name(dataset),
        "dataset_hash": dataset.hash,
        "note": note,
        **report,
        **({} if truth is None else _against_simulator(model, truth)),
    }


def _against_simulator(model: Checkpoint, truth: Path) -> dict[str, Any]:
    from jenga_control.planning.dynamics import Learned
    from jenga_control.prediction.ceiling import from_folder  # it scores restarts by this file's means
    from jenga_models.predict import LearnedDynamics

    found = from_folder(truth, Learned(LearnedDynamics(model)))
    correlation = found["ranking"]["model"]["mean"]
    reason = f"no decision in {truth} has plans that differ" if correlation is None else ""
    return {**found, "rank_correlation": correlation, "rank_correlation_reason": reason}
