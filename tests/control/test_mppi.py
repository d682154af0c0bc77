from dataclasses import replace

import numpy as np
import pytest

from jenga_control.planning.mppi import PRESETS, Controller, MPPIConfig, mppi_preset, softmax_weights
from jenga_data.errors import JengaError

FREE = MPPIConfig(
    samples=200,
    search_low=(-1.0, -1.0, -1.0),
    search_high=(1.0, 1.0, 1.0),
    execute_low=(-1.0, -1.0, -1.0),
    execute_high=(1.0, 1.0, 1.0),
    max_change_x=None,
    initial_action=(0.0, 0.0, 0.0),
)


def pull_hard(plans):
    """The paper's O_a, whose optimum lies at the limit of a_x."""
    return (1000 * plans[..., 0] + 800 * np.abs(plans[..., 1:]).sum(-1)).sum(-1)


def test_finds_the_optimum_of_a_quadratic():
    optimum = np.array([0.004, -0.003, 0.002])
    controller = Controller(FREE, np.random.default_rng(0))
    plans = [controller.plan(lambda plans: ((plans - optimum) ** 2).sum((1, 2))) for _ in range(30)]
    np.testing.assert_allclose(plans[-1].action, optimum, atol=5e-4)


@pytest.mark.parametrize("name", PRESETS)
def test_what_is_executed_stays_within_the_limits_and_reaches_them(name):
    config = mppi_preset(name)
    controller = Controller(config, np.random.default_rng(1))
    actions = np.array([controller.plan(lambda plans: -plans.sum((1, 2))).action for _ in range(60)])
    assert (actions >= config.execute_low).all()
    assert (actions <= config.execute_high).all()
    assert (np.abs(actions[-1] - config.execute_high) <= 1.5 * np.asarray(config.sigma)).all()


def test_best_samples_within_the_clip_and_paper_beyond_it():
    configs = PRESETS["paper"], replace(PRESETS["best"], sigma=1e-3)
    paper, best = (Controller(config, np.random.default_rng(2)) for config in configs)
    inside, outside = best.plan(pull_hard), paper.plan(pull_hard)
    assert np.abs(inside.plans[..., 1:]).max() == 0.001
    np.testing.assert_array_equal(inside.action, inside.unclipped)
    assert np.abs(outside.plans[..., 1:]).max() > 0.001

    up = [paper.plan(lambda plans: -plans[..., 2].sum(1)) for _ in range(5)][-1]
    assert up.unclipped[2] > 0.001
    assert up.action[2] == 0.001


def test_a_x_changes_by_at_most_its_limit():
    config = replace(MPPIConfig(), sigma=0.05, max_change_x=0.004)
    rng = np.random.default_rng(3)
    controller = Controller(config, rng)
    last = 0.0
    for _ in range(20):
        plan = controller.plan(lambda plans: rng.normal(size=len(plans)))
        with_last = np.insert(plan.plans[..., 0], 0, last, axis=1)
        assert np.abs(np.diff(with_last)).max() <= 0.004 + 1e-15
        assert abs(plan.action[0] - last) <= 0.004 + 1e-15
        last = plan.action[0]


def test_same_generator_same_plan():
    one, two = (Controller(MPPIConfig(), np.random.default_rng(4)) for _ in range(2))
    for _ in range(3):
        first, second = one.plan(pull_hard), two.plan(pull_hard)
        for name in ("action", "plans", "costs", "weights", "mean"):
            np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    one, other = (Controller(MPPIConfig(), np.random.default_rng(seed)).plan(pull_hard) for seed in (4, 5))
    assert not np.array_equal(one.plans, other.plans)


def test_weights_sum_to_one_and_favour_low_cost():
    costs = np.random.default_rng(6).normal(size=100)
    weights = softmax_weights(costs, 0.3)
    assert weights.sum() == pytest.approx(1)
    assert (np.diff(weights[np.argsort(costs)]) <= 0).all()
    median = np.abs(costs - np.median(costs)).argmin()
    assert weights[median] / weights.max() == pytest.approx(np.exp(-1 / 0.3), rel=0.1)


def test_weights_do_not_depend_on_the_scale_of_the_cost():
    costs = np.random.default_rng(7).normal(size=50)
    np.testing.assert_allclose(softmax_weights(1e4 * costs + 17, 0.3), softmax_weights(costs, 0.3), rtol=1e-8)


def test_one_diverged_plan_does_not_flatten_the_weights():
    costs = np.linspace(0, 1, 101)
    worse = np.append(costs, 1e12)
    np.testing.assert_allclose(softmax_weights(worse, 0.3)[:-1], softmax_weights(costs, 0.3), rtol=0.1)


@pytest.mark.parametrize(("temperature", "expected"), [(1e-12, [0, 1, 0, 0]), (1e12, [0.25] * 4)])
def test_limits_of_the_temperature(temperature, expected):
    weights = softmax_weights(np.array([3.0, 1.0, 2.0, 5.0]), temperature)
    np.testing.assert_allclose(weights, expected, atol=1e-9)


def test_equal_costs_weigh_the_same():
    np.testing.assert_allclose(softmax_weights(np.full(4, 7.0), 0.3), 0.25)


def test_plans_without_a_finite_cost_weigh_nothing():
    rng = np.random.default_rng(8)

    def half_diverges(plans):
        costs = rng.normal(size=len(plans))
        costs[::3], costs[1::3] = np.nan, -np.inf
        return costs

    plan = Controller(MPPIConfig(), np.random.default_rng(9)).plan(half_diverges)
    assert (plan.weights[::3] == 0).all()
    assert (plan.weights[1::3] == 0).all()
    assert np.isposinf(plan.costs[::3]).all()
    assert np.isposinf(plan.costs[1::3]).all()
    assert plan.weights.sum() == pytest.approx(1)


def test_refuses_when_no_cost_is_finite():
    controller = Controller(MPPIConfig(), np.random.default_rng(10))
    with pytest.raises(JengaError, match="none of 100 sampled plans has a finite cost"):
        controller.plan(lambda plans: np.full(len(plans), np.nan))


def test_refuses_costs_of_another_shape():
    controller = Controller(MPPIConfig(), np.random.default_rng(11))
    with pytest.raises(ValueError, match=r"\(100, 5\), not \(100,\)"):
        controller.plan(lambda plans: plans.sum(-1))


def test_warm_start_moves_the_mean_on_by_one_step():
    controller = Controller(MPPIConfig(), np.random.default_rng(12))
    first, second = controller.plan(pull_hard), controller.plan(pull_hard)
    np.testing.assert_array_equal(second.plans[0, :-1], first.mean[1:])
    np.testing.assert_array_equal(second.plans[0, -1], first.mean[-1])


def test_without_warm_start_and_after_reset_planning_starts_from_the_initial_action():
    cold = Controller(replace(MPPIConfig(), warm_start=False), np.random.default_rng(13))
    warm = Controller(MPPIConfig(), np.random.default_rng(13))
    for controller in (cold, warm):
        controller.plan(pull_hard)
    warm.reset()
    for controller in (cold, warm):
        np.testing.assert_array_equal(controller.plan(pull_hard).plans[0], np.tile((-0.002, 0, 0), (5, 1)))


def test_rollout_cannot_change_the_plans():
    def spoils(plans):
        plans[:] = 99.0
        return np.zeros(len(plans))

    assert np.abs(Controller(MPPIConfig(), np.random.default_rng(14)).plan(spoils).plans).max() <= 0.02


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"temperature": 0.0}, "temperature is 0.0"),
        ({"samples": 0}, "samples is 0"),
        ({"execute_low": (0.03, 0.0, 0.0), "execute_high": (0.04, 0.0, 0.0)}, "leave nothing"),
        ({"initial_action": (-0.5, 0.0, 0.0)}, "initial_action .* is outside"),
        ({"max_change_x": -1.0}, "max_change_x is -1.0"),
    ],
)
def test_refuses_a_configuration_that_cannot_work(change, message):
    with pytest.raises(JengaError, match=message):
        MPPIConfig(**change)


def test_unknown_preset_names_those_that_exist():
    with pytest.raises(JengaError, match=r"unknown MPPI preset 'fast'; allowed: paper, best"):
        mppi_preset("fast")
