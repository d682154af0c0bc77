"""What a case measures, on towers of a few blocks whose answer is known."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from nominal_tower import layout_of
from short_towers import short_towers

from jenga_data.blocks import GRAVITY, NOMINAL_SIZE, Blocks
from jenga_data.calibrate import contacts, trial
from jenga_data.calibrate.ceiling import repeated_pulls
from jenga_data.calibrate.contacts import CHOSEN, SETTINGS
from jenga_data.calibrate.movable import PARTS, MovableConfig, PushConfig, _push, push_blocks
from jenga_data.calibrate.sleep import with_and_without
from jenga_data.calibrate.speed import pulls_at_speeds
from jenga_data.collect.config import SelectionConfig, SpawnConfig
from jenga_data.errors import JengaError
from jenga_data.outcome import Outcome
from jenga_data.sim.scene import add_tower, base_spec
from jenga_data.sim.world import World
from jenga_data.tower import nominal_poses

SPAWN = SpawnConfig(first_round=1, last_round=1, stand=0.32)
SELECTION = SelectionConfig(spawn=SPAWN, physics=SETTINGS["twice the step"])
SERVO_START = 0.1
"""What the servo of a push begins with [N]."""


def pushed(*levels: str, block: int, mass: dict[int, float] | None = None, sign: float = 1.0, **push: Any) -> Any:
    """What becomes of a push at a block of a tower drawn from the bottom, with some blocks of other masses [kg]."""
    world = settled(*levels, mass=mass or {})
    return _push(world, world.integration_state(), block, sign, MovableConfig(push=PushConfig(**push)))


def settled(*levels: str, mass: dict[int, float]) -> World:
    layout = layout_of(*levels)
    size = np.tile(NOMINAL_SIZE, (len(layout.level), 1))
    masses = np.full(len(size), 0.01927)
    for heavy, kilograms in mass.items():
        masses[heavy] = kilograms
    blocks = Blocks(size, masses)
    spec = base_spec(CHOSEN)
    add_tower(spec, blocks, nominal_poses(layout, air=0.0002), target=-1, physics=CHOSEN)
    world = World(spec, blocks, layout)
    world.step(50)
    return world


# --- a push --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mass", [0.05, 0.1])
@pytest.mark.parametrize(("levels", "block"), [(("xxx",), 1), (("xxx", "xxx"), 4)])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_loose_block_breaks_away_at_the_force_of_its_friction(mass, levels, block, sign):
    """Along x on the table, and along y on other blocks. What is above friction has set the block in motion."""
    found = pushed(*levels, block=block, mass={block: mass}, sign=sign)
    friction = CHOSEN.friction * mass * GRAVITY
    assert found["end"] == "movable"
    assert 20 <= found["travel"] < 25
    assert friction < found["breakaway"] < friction + SERVO_START + 0.05
    assert found["moved"] < 1


def test_a_light_block_moves_at_once():
    found = pushed("xxx", block=1)
    assert found["end"] == "movable"
    assert found["breakaway"] == pytest.approx(SERVO_START, abs=0.03)


@pytest.mark.parametrize("limit", [0.05, 1.0])
def test_a_block_under_a_heavy_load_is_stuck(limit):
    found = pushed("xxx", ".x.", block=1, mass={3: 2.0}, force_limit=limit)
    assert found["end"] == "stuck"
    assert found["breakaway"] is None
    assert found["travel"] < 1
    assert found["moved"] < 1


def test_a_push_has_the_time_to_reach_its_limit():
    """Friction takes more force than the servo has found when patience would end."""
    mass = 1.0
    needed = CHOSEN.friction * mass * GRAVITY
    assert needed > SERVO_START + PushConfig.gains[1] * PushConfig.speed * PushConfig.patience
    assert pushed("xxx", block=1, mass={1: mass}, force_limit=0.8 * needed)["end"] == "stuck"
    found = pushed("xxx", block=1, mass={1: mass}, force_limit=1.5 * needed)
    assert found["end"] == "movable"
    assert needed < found["breakaway"] < 1.2 * needed


def test_a_block_that_takes_another_along_drags_it():
    found = pushed("xxx", ".x.", ".x.", block=3)
    assert found["end"] == "dragged"
    assert found["moved"] > 5
    assert found["travel"] < 20


def test_a_block_that_falls_ends_the_push():
    """The pushed block is shot out from under another, which may be taken along for a while."""
    found = pushed("xxx", ".x.", ".x.", block=3, speed=2.0, force_limit=20.0, distance=0.2, others=0.05)
    assert found["end"] == "collapsed"


def test_a_push_knows_nothing_of_the_one_before():
    world = settled("xxx", "xxx", mass={})
    start, config = world.integration_state(), MovableConfig(push=PushConfig(distance=0.002))
    first, other, again = (_push(world, start, block, 1.0, config) for block in (4, 3, 4))
    assert first == again != other


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan"), float("inf")])
def test_a_force_that_is_none_is_refused(limit):
    with pytest.raises(JengaError, match=r"force-limit is .*; allowed: a positive number \[N\]"):
        PushConfig(force_limit=limit)


def test_every_block_of_a_tower_is_pushed_from_the_same_state_whichever_part_it_is_in():
    config = MovableConfig(spawn=replace(SPAWN), push=PushConfig(distance=0.002))
    with short_towers(2):
        parts = [push_blocks(config, 0, 0, part) for part in range(PARTS)]
        again, other = push_blocks(config, 0, 0, 1), push_blocks(config, 0, 1, 1)
    assert again == parts[1]
    assert {part["tower"] for part in parts} != {other["tower"]}
    places = [place for part in parts for place in zip(part["level"], part["slot"], strict=True)]
    assert sorted(places) == [(n, s) for n in range(2) for s in range(3)]
    assert all(len(part[name]) == 6 / PARTS for part in parts for name in ("end", "travel", "moved", "breakaway"))
    ends = [end for part in parts for end, level in zip(part["end"], part["level"], strict=True) if level == 1]
    assert ends == ["movable"] * 3  # nothing rests on them


# --- contact settings ----------------------------------------------------------------------------------------------


def test_no_two_settings_make_the_same_scene():
    scenes = set()
    for physics in SETTINGS.values():
        spec = base_spec(physics)
        add_tower(spec, *_one_block(), target=-1, physics=physics)
        model = spec.compile()
        geom = model.geom("block_0").id
        option = model.opt
        scenes.add(
            (
                option.timestep,
                option.integrator,
                option.impratio,
                *model.geom_solref[geom].tolist(),
                *model.geom_solimp[geom].tolist(),
            )
        )
        assert model.geom_friction[geom, 0] == CHOSEN.friction
    assert len(scenes) == len(SETTINGS)
    assert SETTINGS["chosen"] == SelectionConfig().physics


def _one_block() -> tuple[Blocks, np.ndarray]:
    return Blocks(np.array([NOMINAL_SIZE]), np.array([0.02])), np.array([[0, 0, 0.0075, 1.0, 0, 0, 0]])


def test_blocks_of_the_chosen_setting_sink_into_each_other_by_less_than_a_tenth_of_a_millimetre():
    found = contacts.sag(CHOSEN)
    assert 0 < found["sag"] <= 0.08
    assert found["sag"] <= found["worst"] < 0.12


def test_a_tower_that_rests_drifts_less_than_it_may(monkeypatch):
    monkeypatch.setattr(contacts, "REST_SECONDS", 0.96)
    monkeypatch.setattr(contacts, "SETTLED_SECONDS", 0.32)
    with short_towers(4):
        found = contacts.rest(CHOSEN, 0, 0)
    assert found["fell"] is False
    assert 0 < found["drift"] < 0.5
    assert found["realtime_factor"] > 0


@pytest.mark.parametrize("block", [0, -1])
def test_a_tower_of_which_any_block_drops_fell(monkeypatch, block):
    """The last block too."""

    class Dropping(World):
        def step(self, count: int = 1) -> None:
            pose = self.pose
            pose[block, 2] -= 0.001
            self.set_tower(pose)

    monkeypatch.setattr(contacts, "World", Dropping)
    with short_towers(3):
        assert contacts.rest(CHOSEN, 0, 0) == {"fell": True, "drift": None, "realtime_factor": None}


def test_a_short_tower_that_is_played_stands():
    with short_towers(3):
        found = contacts.play(CHOSEN, 0, 0, 2)
    assert (found["round"], found["stands"], found["quick"]) == (2, True, True)


def test_a_pull_is_repeated_and_a_tower_that_does_not_stand_is_told():
    with short_towers(2):
        found = contacts.pulls(SELECTION, 0, 0, 2)
        none = contacts.pulls(replace(SELECTION, spawn=replace(SPAWN, creep_allowance=1e-9, tries=1)), 0, 0, 2)
    assert found["stood"] is True
    assert len(found["repeats"]) == 2
    assert found["cpu"] > 0
    assert none == {"stood": False}


# --- pulls ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def pulls() -> dict[str, Any]:
    with short_towers(2):
        return repeated_pulls(SELECTION, 0, 0, 2, 2)


def test_repeats_of_a_pull_have_other_noise_and_the_same_start(pulls):
    assert len(pulls["pulls"]) == 2
    for pull in pulls["pulls"]:
        first, second = pull["repeats"]
        assert first["moved"] != second["moved"]
        assert pull["round"] == 1
        assert pull["level"] == 0
        assert pull["slot"] in range(3)
        for one in (first, second):
            assert one["failure"] == Outcome(one["outcome"]).failure
            assert one["strict_failure"] or not one["failure"]
    assert len({(pull["level"], pull["slot"]) for pull in pulls["pulls"]}) == 2
    assert len({pull["tower"] for pull in pulls["pulls"]}) == 1


def test_a_case_gives_the_same_numbers_again(pulls):
    with short_towers(2):
        assert repeated_pulls(SELECTION, 0, 0, 2, 1)["pulls"] == [
            pull | {"repeats": pull["repeats"][:1]} for pull in pulls["pulls"]
        ]


def test_more_targets_than_there_are_are_as_many_as_there_are():
    with short_towers(2):
        state, stages = trial.tower_and_targets(SELECTION, 0, 0, 100)
    assert sorted(stage.target for stage in stages) == state.layout.legal_targets()


def test_a_broken_pull_has_moved_by_nothing_that_can_be_told(monkeypatch):
    """NaN differs from itself: the same pull would not seem to repeat."""

    class Broken:
        class verdict:
            outcome, failure, strict_failure, moved = Outcome.INVALID, False, False, float("nan")

    monkeypatch.setattr(trial, "pull", lambda *_, **__: Broken)
    with short_towers(2):
        _, (stage,) = trial.tower_and_targets(SELECTION, 0, 0, 1)
    once, again = (trial.judged_pull(SELECTION, stage, 0, 0) for _ in range(2))
    assert once == again
    assert once["moved"] is None


def test_a_nudge_moves_every_block_by_about_its_distance():
    with short_towers(2):
        _, (stage,) = trial.tower_and_targets(SELECTION, 0, 0, 1)
    near = trial.nudged(stage, 1e-6, np.random.default_rng(0))
    by = near.state.pose - stage.state.pose
    assert 0.5e-6 < by[:, :3].std() < 1.5e-6
    assert (by[:, :3] != 0).all()
    assert not by[:, 3:].any()
    assert (near.target, near.turn, near.face) == (stage.target, stage.turn, stage.face)


def test_every_speed_pulls_at_the_same_target(monkeypatch):
    seen: list[SelectionConfig] = []

    def judged(config: SelectionConfig, stage: Any, seed: int, repeat: int) -> dict[str, Any]:
        seen.append(config)
        return {"target": stage.target}

    monkeypatch.setattr("jenga_data.calibrate.speed.judged_pull", judged)
    with short_towers(2):
        found = pulls_at_speeds(SELECTION, 0, 0, [0.05, 0.1, 0.4])
    assert len({pull["target"] for pull in found["pulls"]}) == 1
    assert [config.speed for config in seen] == [0.05, 0.1, 0.4]
    ways = [config.speed * config.pull_seconds for config in seen]
    assert ways == pytest.approx([SELECTION.speed * SELECTION.pull_seconds] * 3)
    assert [config.patience for config in seen] == pytest.approx([0.64, 0.32, 0.32])
    assert {config.physics for config in seen} == {SELECTION.physics}


def test_pulls_with_and_without_sleep_start_alike_and_one_starts_a_micrometre_away(monkeypatch):
    starts, slept = [], []

    def judged(config: SelectionConfig, stage: Any, seed: int, repeat: int, sleep: bool = True) -> dict[str, Any]:
        starts.append(stage.state.pose)
        slept.append(sleep)
        return {"asleep": sleep, "repeat": repeat}

    monkeypatch.setattr("jenga_data.calibrate.sleep.judged_pull", judged)
    with short_towers(2):
        found = with_and_without(SELECTION, 0, 1)
    assert slept == [True, False, False, True]
    assert found["repeats"] is True
    assert found["asleep"] == {"asleep": True, "repeat": 0}
    assert found["awake"] == found["nudged"] == {"asleep": False, "repeat": 0}
    away = [np.abs(start - starts[0]).max() for start in starts]
    assert away == [0, 0, pytest.approx(2e-6, abs=2e-6), 0]
    assert away[2] > 0
