"""Made-up results of cases, told by their arguments alone: what reports are written from without a simulation."""

from collections.abc import Callable
from typing import Any

import pytest

from jenga_data.calibrate.movable import PARTS
from jenga_data.collect.config import CollectConfig, SelectionConfig, SpawnConfig
from jenga_data.outcome import Outcome
from jenga_data.sim.physics import PhysicsConfig

BLOCKS = 6


def some_blocks(config: Any, seed: int, number: int, part: int) -> dict[str, Any]:
    """A part of two levels: the middles move at 0.2 and 0.4 N, one block is dragged at 0.6 N, the others are stuck."""
    all_blocks = {
        "level": [0, 0, 0, 1, 1, 1],
        "slot": [0, 1, 2, 0, 1, 2],
        "end": ["stuck", "movable", "stuck", "dragged", "movable", "stuck"],
        "travel": [0.1, 20.5, 0.1, 7.0, 20.5, 0.1],
        "moved": [0.0, 0.5, 0.0, 6.0, 0.5, 0.0],
        "breakaway": [None, 0.2, None, 0.6, 0.4, None],
    }
    share = BLOCKS // PARTS
    return {
        "tower": f"tower {number}",
        "tries": 1,
        **{name: values[part * share : (part + 1) * share] for name, values in all_blocks.items()},
    }


def verdict(outcome: Outcome, dragged: bool = False) -> dict[str, Any]:
    failure = outcome.failure
    return {"outcome": outcome.value, "failure": failure, "strict_failure": failure or dragged, "moved": 0.001}


def described(number: int, level: int = 3, slot: int = 1) -> dict[str, Any]:
    return {"tower": f"tower {number}", "round": 1 + number % 3, "level": level, "slot": slot}


def some_repeated(config: CollectConfig, seed: int, number: int, targets: int, repeats: int) -> dict[str, Any]:
    """The first target always comes out, the second never, of the third every second pull collapses the tower."""
    ways = [[Outcome.EXTRACTED, Outcome.EXTRACTED], [Outcome.STUCK, Outcome.STUCK]]
    ways.append([Outcome.COLLAPSED, Outcome.EXTRACTED])
    return {
        "pulls": [
            described(number, slot=t % 3) | {"repeats": [verdict(ways[t % 3][i % 2], t == 0) for i in range(repeats)]}
            for t in range(targets)
        ]
    }


def some_speeds(config: CollectConfig, seed: int, number: int, speeds: list[float]) -> dict[str, Any]:
    """A tower with an even number falls above 0.1 m/s; the others never do."""
    fast = [speed > 0.1 and number % 2 == 0 for speed in speeds]
    return described(number) | {"pulls": [verdict(Outcome.COLLAPSED if f else Outcome.EXTRACTED) for f in fast]}


def some_sleep(config: CollectConfig, seed: int, number: int) -> dict[str, Any]:
    """The nudged start of tower 0 ends otherwise."""
    same = {name: verdict(Outcome.STUCK) for name in ("asleep", "awake", "nudged")}
    return described(number) | same | {"repeats": True} | ({"nudged": verdict(Outcome.COLLAPSED)} if not number else {})


def some_tries(spawn: SpawnConfig, physics: PhysicsConfig, seed: int, number: int, round_number: int) -> dict[str, Any]:
    """Towers stand at the first try up to round 9, then at the third; of round 15 none does."""
    tries = 1 if round_number < 10 else 3
    names = ("height_spread_mm", "mass_g", "levels", "middles_taken", "sides_taken")
    character = {name: float(i + round_number) for i, name in enumerate(names)}
    fails = round_number == 15
    return {
        "round": round_number,
        "tries": 0 if fails else tries,
        "first": "stands" if tries == 1 else "falls",
        "rejected": [] if tries == 1 else [character, character],
        "accepted": None if fails else character,
    }


def some_turn(config: CollectConfig, seed: int, number: int) -> dict[str, Any]:
    """Tower 0 is at the brink of its equilibrium, tower 3 never comes to rest."""
    assert isinstance(config, SelectionConfig)
    if number == 3:
        return {"round": config.spawn.last_round, "rested": False}
    return {
        "round": config.spawn.last_round,
        "rested": True,
        "displaced_mm": 0.0,
        "after_mm": 0.1 + 0.1 * number,
        "unturned_mm": 0.1 * number,
        "fell": False,
        "friction": None if number == 0 else 0.05 * number,
    }


def some_rest(physics: PhysicsConfig, seed: int, number: int) -> dict[str, Any]:
    """Under an impratio of 1 every tower falls."""
    fell = physics.impratio == 1.0
    return {
        "fell": fell,
        "drift": None if fell else 0.01 * (1 + number),
        "realtime_factor": None if fell else 2.0 + number,
    }


def some_sag(physics: PhysicsConfig) -> dict[str, Any]:
    return {"sag": 0.05, "worst": 0.06}


def some_play(physics: PhysicsConfig, seed: int, number: int, round_number: int) -> dict[str, Any]:
    stands = physics.impratio != 1.0 or round_number < 10
    return {"round": round_number, "stands": stands, "quick": stands, "cpu": 0.5}


def some_pulls(config: SelectionConfig, seed: int, number: int, repeats: int) -> dict[str, Any]:
    """Under an impratio of 1 even towers do not stand, and the others fall when pulled at."""
    loose = config.physics.impratio == 1.0
    if loose and number % 2 == 0:
        return {"stood": False}
    one = verdict(Outcome.COLLAPSED if loose else Outcome.EXTRACTED)
    return {"stood": True, "cpu": 0.25, "tries": 1, **described(number), "repeats": [one] * repeats}


CASES: dict[str, Callable[..., dict[str, Any]]] = {
    "movable.push_blocks": some_blocks,
    "ceiling.repeated_pulls": some_repeated,
    "speed.pulls_at_speeds": some_speeds,
    "sleep.with_and_without": some_sleep,
    "rounds.tries_of_round": some_tries,
    "turntable.turn_case": some_turn,
    "contacts.rest": some_rest,
    "contacts.sag": some_sag,
    "contacts.play": some_play,
    "contacts.pulls": some_pulls,
}


def replace_cases(patch: pytest.MonkeyPatch) -> None:
    """Put made-up results in the place of every simulation."""
    for name, answer in CASES.items():
        patch.setattr(f"jenga_data.calibrate.{name}", answer)
