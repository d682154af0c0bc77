"""The ways to pull by their names."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from closed_loops import CHEAP, MODEL, tower
from made_up_dataset import dynamics_dataset, untrained

from jenga_control.extraction.closed_loop import ClosedLoop, StraightPull
from jenga_control.extraction.hindsight import PULLS, Hindsight, named_pull
from jenga_control.extraction.touch import TouchConfig
from jenga_control.extraction.ways import Choices, Puller, ways
from jenga_control.planning.mppi import mppi_preset
from jenga_data.collect.branches import Branch, Tape, Trunk
from jenga_data.episode import CONTROL_STEP_NS, Result
from jenga_data.errors import JengaError
from jenga_data.outcome import Outcome, Verdict

STEP = CONTROL_STEP_NS * 1e-9


class MadeUpTrunk(Trunk):
    """A grasped tower that comes out at some speeds only; notes at which speeds it was pulled."""

    seed, number = 900_000, 3

    def __init__(self, ends):
        self.ends, self.pulled = ends, []

    @property
    def grasped(self) -> bool:
        return True

    def branch(self, policy, all_actions=False):
        speed = 0.0
        if isinstance(policy, StraightPull):
            speed = round(-policy.act(tower(), 0)[0] / STEP, 6)
        self.pulled.append(speed)
        outcome, dragged, moved = self.ends.get(speed, (Outcome.STUCK, False, 0.05))
        return Branch(Tape(), Result(Verdict(outcome, dragged, moved, -1)))


def named(*names, **choices) -> dict[str, Any]:
    return ways(names, Choices(CHEAP, **choices))


def test_names_say_objective_speed_preset_and_dynamics():
    found = named("naive-paper", "straight-0.05", "straight", "full-simulator", "full-paper-trivial", "hindsight")
    assert found["naive-paper"].search == mppi_preset("paper")
    assert [found[name].speed for name in ("straight-0.05", "straight")] == [0.05, 0.15]
    simulator, trivial = found["full-simulator"], found["full-paper-trivial"]
    assert (simulator.dynamics, simulator.search.samples, simulator.search.horizon) == ("simulator", 16, 3)
    assert (trivial.dynamics, trivial.search) == ("trivial", mppi_preset("paper"))
    assert isinstance(found["hindsight"], Hindsight)
    assert named("naive", preset="paper")["naive"] == replace(found["naive-paper"])


def test_each_way_has_settings_of_its_own():
    names = ("naive", "naive-paper", "straight-0.05", "straight", "full-simulator", "full-trivial", "hindsight")
    plain = [way.actor for way in named(*names).values()]
    touched = [way.actor for way in named(*names[:-1], touch=TouchConfig()).values()]
    settings = [repr(actor) for actor in (*plain, *touched)]
    assert len(set(settings)) == len(settings)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("greedy", "unknown way to pull 'greedy'; allowed: full, naive"),
        ("naive-fast", "unknown way to pull 'naive-fast'"),
        ("straight-0.7", "'0.7' is no speed of a pull; allowed: above 0 up to 0.625 m/s"),
        ("straight-quick", "'quick' is no speed"),
        ("hindsight-3", "hindsight of 3 pulls; allowed: 8 and more"),
        ("hindsight-13", "hindsight of '13' pulls; allowed: 8 to 12"),
        ("full", "no trained dynamics model; name one: --model"),
    ],
)
def test_a_name_that_means_nothing_is_refused(name, message, tmp_path, monkeypatch):
    monkeypatch.setattr("jenga_models.pretrained.FOLDER", tmp_path)
    with pytest.raises(JengaError, match=message):
        named(name)


def test_the_model_that_jenga_comes_with_is_asked_where_none_is_named(tmp_path, monkeypatch):
    model = untrained(tmp_path / "dynamics", MODEL, dynamics_dataset())
    monkeypatch.setattr("jenga_models.pretrained.FOLDER", tmp_path)
    found = named("full")["full"]
    assert isinstance(found, ClosedLoop)
    assert found.model == model


def test_several_models_are_several_ways(tmp_path):
    models = [untrained(tmp_path / f"model{i}", replace(MODEL, seed=i), dynamics_dataset()) for i in (0, 1)]
    found = named("full", "naive", models=tuple(models))
    assert len(found) == 3
    assert all(name == f"full-{found[name].model_hash[:8]}" for name in list(found)[:2])
    assert len({found[name].actor.checkpoint for name in list(found)[:2]}) == 2
    with pytest.raises(JengaError, match="given twice"):
        named("full", models=(models[0], models[0]))


def test_hindsight_succeeds_if_any_pull_does_and_says_which():
    trunk = MadeUpTrunk({0.3: (Outcome.EXTRACTED, False, 0.002), 0.15: (Outcome.EXTRACTED, True, 0.03)})
    branch = Hindsight(CHEAP).pull(trunk)
    assert branch.result.verdict.moved == 0.002
    assert branch.notes["hindsight_best"] == "straight-0.3"
    assert trunk.pulled == [0.5, 0.15, 0.05, 0.3]
    assert branch.notes["hindsight_tried"].count("extracted") == 2


def test_hindsight_prefers_any_success_and_then_the_least_disturbance():
    dragged = Hindsight(CHEAP).pull(MadeUpTrunk({0.1: (Outcome.EXTRACTED, True, 0.04)}))
    assert dragged.notes["hindsight_best"] == "straight-0.1"
    trunk = MadeUpTrunk({0.6: (Outcome.COLLAPSED, False, 0.01)})
    assert Hindsight(CHEAP).pull(trunk).notes["hindsight_best"] == "straight-0.6"
    assert len(trunk.pulled) == 8
    assert len(named(f"hindsight-{len(PULLS)}").popitem()[1].pulls) == len(PULLS) == 12


def test_hindsight_of_few_pulls_is_refused():
    with pytest.raises(JengaError, match="hindsight of 2 pulls; allowed: 8 and more"):
        Hindsight(CHEAP, PULLS[:2])


def test_noisy_pulls_are_those_of_the_data_and_repeat():
    trunk = MadeUpTrunk({})
    one, two = (np.array([named_pull("noisy-0.3", CHEAP, trunk).act(tower(), 0)]) for _ in range(2))
    np.testing.assert_array_equal(one, two)
    many = named_pull("noisy-0.3", CHEAP, trunk)
    drawn = np.array([many.act(tower(), 0) for _ in range(200)])
    assert drawn[:, 0].mean() == pytest.approx(-0.3 * STEP, rel=0.05)
    assert 0.0009 < np.abs(drawn[:, 1:]).max() <= 0.001


def test_a_straight_pull_is_simulated_once_a_tower():
    trunk = MadeUpTrunk({})
    found = named("straight-0.5", "hindsight", "straight-0.05")
    puller = Puller(found, trunk)
    for name in found:
        puller(name)
    assert trunk.pulled.count(0.5) == trunk.pulled.count(0.05) == 1
    assert isinstance(found["straight-0.5"], ClosedLoop)
