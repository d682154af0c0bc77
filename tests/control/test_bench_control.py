"""The loop without graph composition decides as the one with it, and faster; the simulator predicts itself."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import torch
from closed_loops import CHEAP, MODEL, TARGET, tower
from made_up_dataset import dynamics_dataset, untrained
from short_towers import short_towers

from jenga_control.extraction.simulator import Simulated
from jenga_control.planning.bench import bench_control
from jenga_control.planning.composed import Composed
from jenga_control.planning.dynamics import Learned
from jenga_data.collect.branches import Trunk
from jenga_data.collect.extraction import LIMITS, executable
from jenga_data.errors import JengaError
from jenga_models.predict import LearnedDynamics


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return untrained(tmp_path_factory.mktemp("bench") / "model", replace(MODEL, flow="both"), dynamics_dataset())


@pytest.fixture(scope="module")
def trunk():
    with short_towers(3):
        return Trunk(CHEAP, 900_000, 0)


def plans(samples=6, horizon=3):
    return np.random.default_rng(0).normal([-0.001, 0, 0], 2e-4, (samples, horizon, 3))


def test_both_loops_see_the_same_tower(model):
    """In the first step; a fresh network then throws the blocks about, and what rests on what is no longer the same."""
    opened = LearnedDynamics(model)
    found = []
    for dynamics in (Learned(opened), Composed(opened)):
        dynamics.start(tower(), TARGET)
        found.append(dynamics.rollout(plans(horizon=1)))
    assert np.abs(found[0][:, 1:] - found[0][:, :1]).max() > 1e-5
    np.testing.assert_allclose(found[0], found[1], atol=1e-5)


def test_a_graph_is_composed_for_each_sample_and_step(model, monkeypatch):
    made = []
    whole = Composed._graph
    monkeypatch.setattr(Composed, "_graph", lambda self, *given: made.append(given) or whole(self, *given))
    composed = Composed(LearnedDynamics(model))
    composed.start(tower(), TARGET)
    composed.rollout(plans(samples=4, horizon=3))
    assert len(made) == 12


class Decides:
    """Asks the simulator what will come of some plans, then makes the first action of the first one."""

    def __init__(self):
        self.simulated, self.expected, self.seen = Simulated(), [], []
        self.plans = np.clip(-np.abs(plans(samples=3, horizon=2)) * 4, -LIMITS, 0.0)

    def enter(self, view):
        self.simulated.enter(view)

    def act(self, state, target):
        self.seen.append(state.pose)
        self.simulated.start(state, target)
        poses = self.simulated.rollout(self.plans)
        assert (poses[:, 0] == state.pose).all()
        self.expected.append(poses[0, 1])
        self.action = executable(self.plans[0, 0], np.zeros(3))
        return self.action


@pytest.mark.usefixtures("unchecked_shapes")
def test_the_simulator_as_a_model_predicts_what_the_simulator_does(trunk):
    decides = Decides()
    trunk.branch(decides)
    assert len(decides.seen) > 10  # a tower whose target is out may sleep, which the model does not
    np.testing.assert_array_equal(np.array(decides.expected[:10]), np.array(decides.seen[1:11]))


def test_looking_ahead_changes_nothing(trunk):
    class Looks(Decides):
        def act(self, state, target):
            super().act(state, target)
            return np.array([-0.004, 0.0, 0.0])

    class Steady:
        def act(self, state, target):
            return np.array([-0.004, 0.0, 0.0])

    looked, steady = (trunk.branch(policy) for policy in (Looks(), Steady()))
    states = [[m.sim_state for m in branch.tape.messages if hasattr(m, "sim_state")] for branch in (looked, steady)]
    np.testing.assert_array_equal(states[0], states[1])


class Asks:
    """A model that wants to know how hard the block is pulled at."""

    device = torch.device("cpu")

    def start(self, state, target, lag=None):
        self.lag = np.asarray(lag)

    def step(self, pose, action):
        return pose


def test_a_model_that_asks_is_told_how_far_the_hand_is_ahead(trunk):
    view, asks = deepcopy(trunk.view), Asks()
    learned, state = Learned(asks), view.recording.world.tower_state()
    learned.enter(view)
    learned.start(state, view.recording.target)
    np.testing.assert_array_equal(asks.lag, np.zeros(3))
    view.hand.begin(np.array([-0.002, 0.0, 0.0005]))
    learned.start(state, view.recording.target)
    np.testing.assert_allclose(asks.lag, [-0.002, 0.0, 0.0005], atol=1e-12)


def test_the_simulator_as_a_model_needs_a_running_world():
    with pytest.raises(JengaError, match="needs the running world"):
        Simulated().start(tower(), TARGET)


@pytest.mark.usefixtures("unchecked_shapes")
def test_a_bench_reports_our_rate_and_two_ratios(model):
    with short_towers(3):
        found = bench_control(model, towers=1, threads=1, simulator_samples=1, config=CHEAP)
    assert found["against_composed"]["value"] == found["decisions"]["value"] > 0
    cpu = found["cpu_ms"]  # what else the machine does is no matter
    assert cpu["composed"] > 1.5 * cpu["ours"] > 0
    assert cpu["simulator"] > 5 * cpu["ours"]
    assert found["against_simulator"]["ratio"] > 1
    assert (found["samples"], found["horizon"]) == (100, 5)
    assert "100 samples of 5 steps" in found["text"]


def test_a_bench_of_nothing_is_refused(model):
    with pytest.raises(JengaError, match="towers is 0"):
        bench_control(model, towers=0)
