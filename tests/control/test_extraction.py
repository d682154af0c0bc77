"""The closed loop: who pulls, from which tower, and that nothing but (seed, number, controller) decides."""

from dataclasses import replace

import numpy as np
import pytest
from closed_loops import CHEAP, MODEL, TARGET, evaluated, tower
from made_up_dataset import dynamics_dataset, untrained

from jenga_control.extraction.closed_loop import CONTROLLERS, ClosedLoop, MPPIPolicy, StraightPull
from jenga_control.planning.cost import CostConfig
from jenga_control.planning.dynamics import NothingMoves
from jenga_control.planning.mppi import mppi_preset
from jenga_data.collect.config import SEED_LIMIT, episode_key
from jenga_data.collect.workers import run_episodes
from jenga_data.episode import CONTROL_STEP_NS
from jenga_data.errors import JengaError
from jenga_data.log.reader import read_episode

SEARCH = mppi_preset("best")
FULL, NAIVE = CostConfig(objective="full"), CostConfig(objective="naive")


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """The episode of each controller, by name."""
    folder, _ = evaluated(tmp_path_factory.getbasetemp())
    return {name: next((folder / "logs" / name).glob("*.mcap")) for name in CONTROLLERS}


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return evaluated(tmp_path_factory.getbasetemp())[0] / "model"


class Sees:
    """Dynamics that keep what they are shown; all blocks but the target move, `shift` times as far as it is pulled."""

    def __init__(self, shift=0.0):
        self.shift, self.started = shift, []

    def start(self, state, target):
        self.started.append((state, target))
        self.pose = state.pose

    def rollout(self, actions):
        samples, horizon, _ = actions.shape
        poses = np.tile(self.pose, (samples, horizon + 1, 1, 1))
        others = np.arange(len(self.pose)) != self.started[-1][1]
        steps = np.cumsum(np.maximum(0, -actions[:, :, 0]), axis=1)
        poses[:, 1:, others, 0] -= self.shift * steps[..., None]
        return poses


def loop(controller, **changes):
    cost = FULL if controller == "full" else NAIVE
    return replace(ClosedLoop(CHEAP, controller, SEARCH, cost), **changes)


def test_the_full_objective_needs_dynamics():
    with pytest.raises(JengaError, match="'full' needs a dynamics model; give one with --model"):
        MPPIPolicy(SEARCH, FULL, None, np.random.default_rng(0))
    with pytest.raises(JengaError, match="needs a dynamics model"):
        loop("full").policy(np.random.default_rng(0))


def test_the_naive_objective_looks_at_actions_alone():
    unused = Sees()
    policy = MPPIPolicy(SEARCH, NAIVE, unused, np.random.default_rng(0))
    without = MPPIPolicy(SEARCH, NAIVE, None, np.random.default_rng(0))
    for _ in range(3):
        np.testing.assert_array_equal(policy.act(tower(), TARGET), without.act(tower(), TARGET))
    assert unused.started == []


def test_where_nothing_moves_the_full_objective_is_the_naive_one():
    full = MPPIPolicy(SEARCH, FULL, NothingMoves(), np.random.default_rng(0))
    naive = MPPIPolicy(SEARCH, NAIVE, None, np.random.default_rng(0))
    for _ in range(3):
        np.testing.assert_allclose(full.act(tower(), TARGET), naive.act(tower(), TARGET), atol=1e-12)


def test_it_plans_from_the_tower_it_is_shown():
    sees, state = Sees(), tower()
    policy = MPPIPolicy(SEARCH, FULL, sees, np.random.default_rng(0))
    policy.act(state, TARGET)
    policy.act(replace(state, pose=state.pose + 0.001), 4)
    (first, target), (second, other) = sees.started
    assert (target, other) == (TARGET, 4)
    assert first is state
    np.testing.assert_array_equal(second.pose, state.pose + 0.001)


def test_a_model_that_sees_the_tower_follow_pulls_less():
    """To pull by s gains 1000 s; 8 blocks that move ten times as far cost 100 * 8 * 10 s."""
    actions = []
    for shift in (0.0, 10.0):
        policy = MPPIPolicy(SEARCH, FULL, Sees(shift), np.random.default_rng(0))
        actions.append([policy.act(tower(), TARGET)[0] for _ in range(8)][-1])
    assert actions[0] < -0.005
    assert actions[1] > actions[0] / 2


def test_actions_are_a_function_of_the_generator():
    def acts(seed):
        policy = loop("naive").policy(np.random.default_rng(seed))
        return np.stack([policy.act(tower(), TARGET) for _ in range(3)])

    np.testing.assert_array_equal(acts(1), acts(1))
    assert (acts(1) != acts(2)).any()


def test_a_straight_pull_is_straight():
    policy = StraightPull(0.1)
    np.testing.assert_allclose(policy.act(tower(), TARGET), [-0.1 * CONTROL_STEP_NS * 1e-9, 0, 0])
    np.testing.assert_array_equal(policy.act(tower(1), 4), policy.act(tower(), TARGET))
    assert isinstance(loop("straight").policy(np.random.default_rng(0)), StraightPull)


def test_an_unknown_controller_is_told_the_known_ones():
    with pytest.raises(JengaError, match="unknown controller 'greedy'; allowed: full, naive, straight"):
        loop("greedy")


def test_an_episode_is_named_by_all_that_decides_it():
    def key(closed_loop, seed=SEED_LIMIT, number=0):
        return episode_key(closed_loop.config, seed, number, closed_loop.actor)

    full = loop("full", model_hash="a" * 64)
    others = [
        loop("full", model_hash="b" * 64),
        loop("full", model_hash="a" * 64, cost=CostConfig(objective="full", gamma=1.0)),
        loop("full", model_hash="a" * 64, search=mppi_preset("paper")),
        loop("naive"),
        loop("naive", search=mppi_preset("paper")),
        loop("straight"),
        loop("straight", speed=0.2),
    ]
    keys = [key(full), key(full, SEED_LIMIT + 1), key(full, number=1), *map(key, others)]
    assert len(set(keys)) == len(keys)


def test_what_decides_nothing_names_nothing(tmp_path):
    """Where a model lies, how many threads it uses, and a model that is not asked."""
    full = loop("full", model_hash="a" * 64)
    assert replace(full, model=tmp_path, threads=2).actor == full.actor
    naive, straight = loop("naive"), loop("straight")
    assert replace(naive, model=tmp_path, model_hash="a" * 64).actor == naive.actor
    assert replace(straight, model_hash="a" * 64, search=mppi_preset("paper")).actor == straight.actor


def test_all_controllers_see_the_same_tower_and_target(logs):
    full, *others = [read_episode(logs[name]) for name in CONTROLLERS]
    for other in others:
        assert other.header.key != full.header.key
        assert other.header.blocks.tower == full.header.blocks.tower
        np.testing.assert_array_equal(other.header.layout.grid, full.header.layout.grid)
        for name in ("seed", "number", "target", "turn", "face"):
            assert getattr(other.header, name) == getattr(full.header, name)
        np.testing.assert_array_equal(other.pose[0], full.pose[0])
        np.testing.assert_array_equal(other.sim_state[0], full.sim_state[0])
        before = full.action_frame[0]
        np.testing.assert_array_equal(other.sim_state[: before + 1], full.sim_state[: before + 1])
        assert (other.action[:3] != full.action[:3]).any()


def test_a_log_says_who_acted(logs, model):
    from jenga_models.checkpoint import load

    for name, log in logs.items():
        header = read_episode(log).header
        assert header.config["controller"]["name"] == name
        assert header.checkpoint == (load(model).hash if name == "full" else "")


@pytest.mark.parametrize("controller", ["full", "naive"])
def test_the_same_seed_number_and_controller_give_the_same_bytes(controller, logs, model, tmp_path):
    """Also in a worker process, and after another episode."""
    own = loop(controller)
    if controller == "full":
        from jenga_models.checkpoint import load

        own = replace(own, model=model, model_hash=load(model).hash)
    run_episodes(own, own.config, SEED_LIMIT, range(1), 2, tmp_path, own.actor)
    (again,) = tmp_path.glob("*.mcap")
    assert again.name == logs[controller].name
    assert again.read_bytes() == logs[controller].read_bytes()


def test_another_model_is_another_episode(logs, tmp_path):
    from jenga_models.checkpoint import load

    other = untrained(tmp_path / "other", replace(MODEL, seed=1), dynamics_dataset())
    own = loop("full", model=other, model_hash=load(other).hash)
    assert episode_key(own.config, SEED_LIMIT, 0, own.actor) != logs["full"].stem
