import numpy as np
import pytest

from jenga_control.planning.cost import CostConfig, action_cost, disturbance_cost, plan_cost
from jenga_data.errors import JengaError


def tower_of(positions):
    pose = np.zeros((*np.shape(positions)[:-1], 7))
    pose[..., :3], pose[..., 3] = positions, 1.0
    return pose


def test_action_cost_by_hand():
    # 1000 * -0.005 + 800 * 0.001 + 800 * 0.0005
    np.testing.assert_allclose(action_cost(np.array([-0.005, 0.001, -0.0005])), -5 + 0.8 + 0.4)


def test_disturbance_cost_by_hand():
    still = tower_of(np.zeros((4, 3)))
    moved = tower_of([[0.003, 0.004, 0], [9, 9, 9], [0, 0, -0.001], [0, 0, 0]])
    np.testing.assert_allclose(disturbance_cost(still, moved, target=1), 100 * (0.005 + 0.001))


def test_disturbance_ignores_whatever_the_target_does():
    pose = tower_of(np.random.default_rng(0).normal(size=(5, 3)))
    moved = pose.copy()
    moved[3] = np.nan
    assert disturbance_cost(pose, moved, target=3) == 0


def test_the_norm_of_poses_counts_rotation_once_and_no_change_of_sign():
    pose = tower_of(np.zeros((2, 3)))
    turned = pose.copy()
    turned[0, 3:] = -np.cos(0.1), 0, 0, -np.sin(0.1)
    chord = 2 * np.sin(0.05)
    assert disturbance_cost(pose, turned, 1) == 0
    np.testing.assert_allclose(disturbance_cost(pose, turned, 1, CostConfig(norm="pose")), 100 * chord)


def test_plan_cost_is_the_sum_over_steps_and_objectives_differ_by_the_disturbance():
    rng = np.random.default_rng(1)
    actions = rng.normal(size=(6, 5, 3)) * 1e-3
    poses = tower_of(np.cumsum(rng.normal(size=(6, 6, 4, 3)) * 1e-3, axis=1))
    by_hand = np.zeros(6)
    for sample in range(6):
        for step in range(5):
            by_hand[sample] += action_cost(actions[sample, step])
            by_hand[sample] += disturbance_cost(poses[sample, step], poses[sample, step + 1], 2)
    np.testing.assert_allclose(plan_cost(actions, poses, 2), by_hand)

    naive = CostConfig(objective="naive")
    np.testing.assert_allclose(plan_cost(actions, None, 2, naive), action_cost(actions).sum(-1))
    assert not naive.needs_dynamics
    with pytest.raises(ValueError, match="needs predicted poses"):
        plan_cost(actions, None, 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"objective": "best"}, "unknown objective 'best'; allowed: naive, full"),
        ({"norm": "l1"}, "unknown norm 'l1'; allowed: position, pose"),
        ({"gamma": float("nan")}, "gamma is nan"),
    ],
)
def test_refuses_unknown_names_and_weights(change, message):
    with pytest.raises(JengaError, match=message):
        CostConfig(**change)
