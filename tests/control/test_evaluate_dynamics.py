import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from made_up_dataset import dynamics_dataset, selection_dataset, untrained

from jenga_control.planning.dynamics import target_moves
from jenga_control.prediction.evaluate import (
    HORIZONS,
    Predictions,
    dynamics_report,
    evaluate_dynamics,
    horizon_report,
    rotation_angle,
)
from jenga_control.prediction.figure import draw_towers, telling
from jenga_control.tables import dynamics_tables
from jenga_data.errors import JengaError
from jenga_data.report import to_json
from jenga_models.checkpoint import load
from jenga_models.config import DynamicsTraining

TRIVIAL = DynamicsTraining(width=8, hidden_layers=1, edge_memory=False, scale_targets="none", residual_to_action=True)


def made_up(rows=40, blocks=5, seed=0):
    """Towers that really move, with the truth as the prediction."""
    rng = np.random.default_rng(seed)
    start = rng.normal(size=(rows, blocks, 7))
    truth = start + 0.01 * rng.normal(size=start.shape)
    for pose in (start, truth):
        pose[..., 3:] /= np.linalg.norm(pose[..., 3:], axis=-1, keepdims=True)
    return Predictions(
        start=start,
        predicted=truth.copy(),
        truth=truth,
        action=0.005 * rng.normal(size=(rows, 3)),
        target=rng.integers(0, blocks, rows),
        tower=np.arange(rows) // 4,
        clear=np.arange(rows) % 5 == 0,
        collapsed=np.arange(rows) % 7 == 0,
    )


def test_the_truth_has_skill_one_and_no_error():
    report = horizon_report(made_up())
    for who in ("others", "target"):
        assert report[f"skill_{who}"] == 1
        assert report[f"skill_{who}_ci95"] == [1, 1]
        assert report[f"rmse_mm_{who}"] == 0
        assert report[f"rmse_deg_{who}"] == 0
        assert report[f"trivial_rmse_mm_{who}"] > 1
        assert report[f"trivial_rmse_deg_{who}"] > 0.1


def test_the_trivial_prediction_has_skill_zero():
    rows = made_up()
    report = horizon_report(replace(rows, predicted=target_moves(rows.start, rows.action, rows.target)))
    for who in ("others", "target"):
        assert report[f"skill_{who}"] == pytest.approx(0)
        assert report[f"skill_{who}_ci95"] == pytest.approx([0, 0])
        assert report[f"rmse_mm_{who}"] == pytest.approx(report[f"trivial_rmse_mm_{who}"])
        assert report[f"rmse_deg_{who}"] == pytest.approx(report[f"trivial_rmse_deg_{who}"])


def test_errors_of_the_target_and_of_the_others_do_not_mix():
    rows = made_up()
    predicted = rows.truth.copy()
    predicted[np.arange(len(rows)), rows.target, 0] += 0.003
    report = horizon_report(replace(rows, predicted=predicted))
    assert report["rmse_mm_target"] == pytest.approx(3)
    assert report["rmse_mm_others"] == 0
    assert report["skill_target"] < 1 == report["skill_others"]


def test_error_in_degrees_is_the_angle_whatever_the_sign_of_the_quaternion():
    rows = made_up()
    angle = np.radians(0.25)
    w, x, y, z = np.moveaxis(rows.truth[..., 3:], -1, 0)
    c, s = np.cos(angle / 2), np.sin(angle / 2)
    predicted = rows.truth.copy()
    predicted[..., 3:] = -np.stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w], axis=-1)
    report = horizon_report(replace(rows, predicted=predicted))
    assert report["rmse_deg_others"] == pytest.approx(0.25)
    assert report["rmse_deg_target"] == pytest.approx(0.25)


def test_rotation_angle_does_not_see_the_length_of_a_prediction():
    quat = np.array([[0.5, 0.5, 0.5, 0.5]])
    assert rotation_angle(3 * quat, quat) == pytest.approx(0, abs=1e-7)
    np.testing.assert_allclose(rotation_angle(np.array([[1.0, 0, 0, 0]]), np.array([[0.0, 1, 0, 0]])), np.pi)


def test_rows_after_the_target_is_clear_and_rows_of_collapse_are_apart():
    rows = made_up()
    spoilt = rows.predicted.copy()
    spoilt[rows.clear | rows.collapsed] += 1.0
    report = dynamics_report({"one_step": replace(rows, predicted=spoilt)})["one_step"]
    assert report["skill_others"] == 1
    assert report["after_clear"]["skill_others"] < 0
    assert report["collapse"]["skill_others"] < 0
    assert report["n"] + report["after_clear"]["n"] + report["collapse"]["n"] == len(rows)
    assert report["collapse"]["n"] == rows.collapsed.sum()


def test_a_model_that_diverges_has_no_skill_and_is_counted():
    rows = made_up()
    predicted = rows.predicted.copy()
    predicted[3] = np.nan
    predicted[5] = np.inf
    report = horizon_report(replace(rows, predicted=predicted))
    assert report["not_finite"] == 2
    assert report["skill_others"] is None


def test_no_rows_make_an_empty_report():
    report = horizon_report(made_up().at(np.zeros(40, bool)))
    assert report["n"] == 0
    assert report["skill_others"] is report["rmse_mm_target"] is report["skill_target_ci95"] is None


def test_rank_correlation_says_why_it_is_missing():
    report = dynamics_report({"one_step": made_up()})
    assert report["rank_correlation"] is None
    assert "simulator" in report["rank_correlation_reason"]


def test_a_checkpoint_that_says_the_trivial_has_skill_zero_at_every_horizon(tmp_path):
    dataset = dynamics_dataset()
    model = untrained(tmp_path / "gns", TRIVIAL, dataset)
    checkpoint = load(model)
    with torch.no_grad():
        for parameter in checkpoint.model.parameters():
            parameter.zero_()
    report = evaluate_dynamics(checkpoint, dataset)
    for name in HORIZONS:
        for who in ("others", "target"):
            assert report[name][f"rmse_mm_{who}"] == pytest.approx(report[name][f"trivial_rmse_mm_{who}"], abs=1e-4)
        # The target follows its actions exactly, all others creep by a random walk.
        assert report[name]["rmse_mm_target"] < 1e-3
        creep = 1e3 * 1e-5 * np.sqrt(3 * HORIZONS[name])
        assert report[name]["trivial_rmse_mm_others"] == pytest.approx(creep, rel=0.2)
    assert {"skill_others", "skill_target", "rmse_mm_others", "rmse_mm_target"} <= set(report["rollout_51"])
    assert json.loads(to_json(report)) == report
    text = dynamics_tables(report)
    assert "| pull, 51 steps, others |" in text
    assert "| target clear, 5 steps, target |" in text
    assert "collapse" not in text


def test_windows_are_of_the_test_split_and_rows_are_sorted_by_where_they_start(tmp_path):
    dataset = dynamics_dataset()
    report = evaluate_dynamics(untrained(tmp_path / "gns", TRIVIAL, dataset), dataset)
    assert set(dataset.asked) == {"test"}
    assert (report["one_step"]["n"], report["one_step"]["after_clear"]["n"]) == (3 * 42, 3 * 10)
    assert (report["rollout_5"]["n"], report["rollout_5"]["after_clear"]["n"]) == (3 * 9, 3 * 1)
    assert (report["rollout_51"]["n"], report["rollout_51"]["towers"]) == (3, 3)
    assert report["model"] == "gns"


def test_a_window_that_ends_in_a_collapse_is_one(tmp_path):
    dataset = dynamics_dataset()
    dataset.columns["collapsed"] = (dataset.columns["tower"] == "tower 1") & (dataset.columns["frame"] >= 7)
    report = evaluate_dynamics(untrained(tmp_path / "gns", TRIVIAL, dataset), dataset)
    assert report["one_step"]["collapse"]["n"] == 52 - 7
    assert report["rollout_5"]["collapse"]["n"] == 9
    assert report["rollout_51"]["collapse"]["n"] == 1


def test_a_horizon_that_no_episode_reaches_says_so(tmp_path):
    dataset = dynamics_dataset(steps=20)
    report = evaluate_dynamics(untrained(tmp_path / "gns", TRIVIAL, dataset), dataset)
    assert report["rollout_51"]["n"] == 0
    assert report["rollout_51"]["skill_others"] is None
    assert "no episode of 51 transitions" in report["rollout_51"]["reason"]
    assert report["rollout_5"]["n"] > 0
    dynamics_tables(report)


def test_refuses_a_dataset_of_pulls_and_one_without_test_rows(tmp_path):
    dataset = dynamics_dataset()
    model = untrained(tmp_path / "gns", TRIVIAL, dataset)
    with pytest.raises(JengaError, match="wanted: selection"):
        evaluate_dynamics(model, selection_dataset())
    dataset.splits[:] = "train"
    with pytest.raises(JengaError, match="has no test rows"):
        evaluate_dynamics(model, dataset)


def test_the_figure_shows_towers_of_different_motion_from_the_median_on(tmp_path):
    moved = np.array([0.1, 5.0, 0.2, 3.0, 0.4, 0.3, 1.0])
    tower = np.array(["a", "a", "b", "c", "d", "e", "f"])
    chosen = telling(moved, tower, 3)
    assert chosen[-1] == 1
    assert (np.diff(moved[chosen]) > 0).all()
    assert len(set(tower[chosen])) == 3
    dataset = dynamics_dataset()
    path = draw_towers(untrained(tmp_path / "gns", TRIVIAL, dataset), dataset, tmp_path / "towers.png")
    assert path.read_bytes().startswith(b"\x89PNG")
