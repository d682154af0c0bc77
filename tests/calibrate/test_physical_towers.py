"""Cases of whole towers: how they are made round by round, and turned."""

from dataclasses import replace

from nominal_tower import layout_of
from short_towers import short_towers

from jenga_data.calibrate.contacts import CHOSEN, SETTINGS
from jenga_data.calibrate.rounds import _taken, tries_of_round
from jenga_data.calibrate.turntable import turn_case
from jenga_data.collect.config import SelectionConfig, SpawnConfig

SPAWN = SpawnConfig(first_round=1, last_round=1, stand=0.32)
SELECTION = SelectionConfig(spawn=SPAWN, physics=SETTINGS["twice the step"])


def test_tries_of_a_round():
    with short_towers(4):
        found = tries_of_round(SPAWN, CHOSEN, 0, 0, 1)
    assert found["round"] == 1
    assert found["tries"] == len(found["rejected"]) + 1 == 1
    assert found["first"] == "stands"
    character = found["accepted"]
    assert 0.05 < character["height_spread_mm"] < 1
    assert 15.9 < character["mass_g"] < 23.0
    assert (character["levels"], character["middles_taken"], character["sides_taken"]) == (4, 0, 0)


def test_what_was_taken_is_counted():
    with short_towers(6):
        found = tries_of_round(replace(SPAWN, last_round=4), CHOSEN, 0, 0, 4)["accepted"]
    assert found["middles_taken"] + found["sides_taken"] in (2, 3)  # three moves; the third may fill the level on top
    assert found["levels"] == 7


def test_middles_and_sides_are_counted_apart():
    """Below the highest complete level: what is free above it was never taken."""
    layout = layout_of("x.x", ".xx", "xx.", "xxx", "x..")
    assert (_taken(layout, {1}), _taken(layout, {0, 2})) == (1, 2)


def test_a_round_in_which_nothing_stands_has_no_tries():
    strict = replace(SPAWN, creep_allowance=1e-9, tries=2)
    with short_towers(3):
        found = tries_of_round(strict, CHOSEN, 0, 0, 1)
    assert (found["tries"], found["first"], found["accepted"]) == (0, "falls", None)
    assert len(found["rejected"]) == 2


def test_a_tower_that_is_turned_keeps_its_place_on_the_table(monkeypatch):
    monkeypatch.setattr("jenga_data.calibrate.turntable.TURN_SECONDS", 2.0)
    with short_towers(2):
        found = turn_case(SELECTION, 0)
    assert found["round"] == 1
    assert found["displaced_mm"] < 1e-6
    assert found["fell"] is False
    assert 0 <= found["after_mm"] < 1
    assert 0 <= found["unturned_mm"] < 1
    assert 0 < found["friction"] < 0.2
