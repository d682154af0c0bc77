"""Towers that many pull at, with worker processes: each tower once, each pull once, and deaths are made up for."""

import os
import signal
from functools import partial
from pathlib import Path

import numpy as np
from short_tower import EXTRACTION, short_towers

from jenga_data.collect.branch_workers import branch_path, run_branches
from jenga_data.collect.branches import Trunk
from jenga_data.collect.config import Actor
from jenga_data.log.reader import read_header

SPEEDS = {"slow": 0.004, "fast": 0.016}
ACTORS = {name: Actor({"name": "straight", "step": step}) for name, step in SPEEDS.items()}


class Straight:
    def __init__(self, step: float) -> None:
        self.action = np.array([-step, 0.0, 0.0])

    def act(self, state, target) -> np.ndarray:
        return self.action


def short_trunk(notes: Path, config, seed: int, number: int) -> Trunk:
    """A tower of few levels; a file says that it was simulated."""
    (notes / f"{number}-{os.getpid()}").touch()
    with short_towers(3):
        return Trunk(config, seed, number)


def pulls_and_dies_once(notes: Path, trunk: Trunk):
    """Both pulls; the first worker dies between the two."""

    def pull(name: str):
        if name == "fast" and not (notes / "died").exists():
            (notes / "died").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return trunk.branch(Straight(SPEEDS[name]))

    return pull


def test_a_worker_that_dies_between_two_pulls_is_replaced_and_the_first_is_kept(tmp_path):
    notes, out = tmp_path / "notes", tmp_path / "logs"
    notes.mkdir()
    work = partial(pulls_and_dies_once, notes), ACTORS, EXTRACTION, 900_000, range(2), 2, out
    lost = run_branches(*work, make_trunk=partial(short_trunk, notes))
    assert lost == {"slow": [], "fast": []}
    ends = [read_header(path)[1] for path in out.glob("*/*.mcap")]
    assert len(ends) == 4
    assert None not in ends
    assert not list(out.glob("*/*.partial"))
    simulated = [path.name.split("-")[0] for path in notes.iterdir() if path.name != "died"]
    assert sorted(set(simulated)) == ["0", "1"]
    assert len(simulated) == 3
    log = branch_path(out, "slow", EXTRACTION, 900_000, 0, ACTORS["slow"])
    before = log.stat().st_mtime_ns
    assert run_branches(*work, make_trunk=partial(short_trunk, notes)) == lost
    assert log.stat().st_mtime_ns == before
    assert len(list(notes.iterdir())) == 4
