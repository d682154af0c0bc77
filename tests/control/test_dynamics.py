import numpy as np
import pytest
import torch
from made_up_dataset import dynamics_dataset, nominal_pose, untrained

from jenga_control.planning.cost import CostConfig, plan_cost
from jenga_control.planning.dynamics import Learned, NothingMoves, StepModel, target_moves
from jenga_data.blocks import sample_blocks
from jenga_data.tower import Layout, TowerState
from jenga_models.config import DynamicsTraining
from jenga_models.predict import LearnedDynamics


def tower(blocks=6):
    rng = np.random.default_rng(0)
    pose = rng.normal(size=(blocks, 7))
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    return TowerState(
        sample_blocks("nominal", rng, blocks), Layout.fresh(np.arange(blocks)), pose, np.zeros((blocks, 6))
    )


ACTIONS = np.random.default_rng(1).normal(size=(4, 5, 3)) * 1e-3


class Drift:
    """Stands in for a trained model: the target follows the action, every block rises by a tenth of a millimetre."""

    device = torch.device("cpu")

    def start(self, state, target):
        self.target = target

    def step(self, pose, action):
        out = pose.clone()
        out[:, self.target, :3] += action
        out[..., 2] += 1e-4
        return out


class Trained(Drift):
    """Has a parameter, as every network does."""

    def __init__(self):
        self.gain = torch.nn.Parameter(torch.ones(()))

    def step(self, pose, action):
        return pose * self.gain


def learned():
    return Learned(Drift())


@pytest.mark.parametrize("make", [NothingMoves, learned])
def test_a_rollout_starts_at_the_tower_and_has_one_pose_more_than_actions(make):
    dynamics, state = make(), tower()
    dynamics.start(state, 2)
    poses = dynamics.rollout(ACTIONS)
    assert poses.shape == (4, 6, 6, 7)
    assert poses.dtype == np.float64
    np.testing.assert_allclose(poses[:, 0], np.broadcast_to(state.pose, (4, 6, 7)), atol=1e-6)


@pytest.mark.parametrize("make", [NothingMoves, learned])
def test_rollouts_start_anew_each_time_and_leave_the_tower_alone(make):
    dynamics, state = make(), tower()
    before = state.pose.copy()
    dynamics.start(state, 2)
    first = dynamics.rollout(ACTIONS)
    first_again = dynamics.rollout(ACTIONS)
    np.testing.assert_array_equal(first, first_again)
    np.testing.assert_array_equal(state.pose, before)


def test_nothing_moves_but_the_target_by_the_sum_of_the_actions():
    dynamics, state = NothingMoves(), tower()
    dynamics.start(state, 2)
    poses = dynamics.rollout(ACTIONS)
    others = [0, 1, 3, 4, 5]
    np.testing.assert_array_equal(poses[:, :, others], np.broadcast_to(state.pose[others], (4, 6, 5, 7)))
    np.testing.assert_allclose(poses[:, 5, 2, :3], state.pose[2, :3] + ACTIONS.sum(1))
    np.testing.assert_array_equal(poses[:, 5, 2, 3:], np.broadcast_to(state.pose[2, 3:], (4, 4)))


def test_under_nothing_moves_the_full_objective_is_the_naive_one():
    dynamics = NothingMoves()
    dynamics.start(tower(), 2)
    poses = dynamics.rollout(ACTIONS)
    naive = plan_cost(ACTIONS, None, 2, CostConfig(objective="naive"))
    np.testing.assert_array_equal(plan_cost(ACTIONS, poses, 2), naive)


def test_the_learned_model_is_stepped_on_its_own_predictions():
    dynamics, state = learned(), tower()
    dynamics.start(state, 2)
    poses = dynamics.rollout(ACTIONS)
    np.testing.assert_allclose(poses[:, :, 0, 2] - state.pose[0, 2], np.tile(np.arange(6) * 1e-4, (4, 1)), atol=1e-6)
    np.testing.assert_allclose(poses[:, 3, 2, :2], state.pose[2, :2] + ACTIONS[:, :3, :2].sum(1), atol=1e-6)


def test_the_learned_model_keeps_no_gradients():
    dynamics = Learned(Trained())
    dynamics.start(tower(), 0)
    assert np.isfinite(dynamics.rollout(ACTIONS)).all()


def test_each_row_has_its_own_target():
    pose = np.zeros((3, 4, 7))
    moved = target_moves(pose, np.array([[1.0, 2, 3]] * 3), np.array([0, 2, 3]))
    assert np.argwhere(moved[..., 0]).tolist() == [[0, 0], [1, 2], [2, 3]]
    assert not pose.any()


def test_a_checkpoint_predicts_rollouts(tmp_path):
    dataset = dynamics_dataset()
    config = DynamicsTraining(width=8, hidden_layers=1)
    model = LearnedDynamics(untrained(tmp_path / "gns", config, dataset))
    assert isinstance(model, StepModel)
    dynamics, blocks = Learned(model), 9
    state = TowerState(
        sample_blocks("nominal", np.random.default_rng(0), blocks),
        Layout.fresh(np.arange(blocks)),
        nominal_pose(),
        np.zeros((blocks, 6)),
    )
    dynamics.start(state, 4)
    poses = dynamics.rollout(ACTIONS)
    assert poses.shape == (4, 6, 9, 7)
    np.testing.assert_allclose(np.linalg.norm(poses[..., 3:], axis=-1), 1, atol=1e-5)
    # Samples do not see each other, but the accuracy of a product depends on how many there are.
    np.testing.assert_allclose(dynamics.rollout(ACTIONS[2:3])[0], poses[2], atol=1e-4)
    assert not np.allclose(poses[0], poses[1])
