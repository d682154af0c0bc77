"""Pulls that share what comes before them leave the same logs as pulls that had the tower to themselves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from robot_stage import LOOSE
from short_tower import EXTRACTION, short_towers

from jenga_data.collect.branches import Trunk
from jenga_data.collect.config import Actor, ExtractionConfig
from jenga_data.collect.extraction import run_extraction
from jenga_data.log.reader import read_episode, read_header
from jenga_data.log.writer import EpisodeWriter
from jenga_data.sim.physics import GripperConfig

SPEEDS = (0.002, 0.016)


class Straight:
    def __init__(self, step: float) -> None:
        self.action = np.array([-step, 0.0, 0.0])

    def act(self, state, target) -> np.ndarray:
        return self.action


def actor(step: float) -> Actor:
    return Actor({"name": "straight", "step": step})


def log_in(folder: Path):
    folder.mkdir(exist_ok=True)
    return lambda header, scene: EpisodeWriter(folder / f"{header.key}.mcap", header, scene)


def alone(config: ExtractionConfig, number: int, step: float, folder: Path) -> Path:
    with short_towers():
        run_extraction(config, 0, number, log_in(folder), Straight(step), actor(step))
    return folder


@pytest.fixture(scope="module")
def branched(tmp_path_factory):
    """The logs of both speeds from one trunk, the slow one pulled before the fast one and once more after it."""
    tmp_path = tmp_path_factory.mktemp("branched")
    with short_towers():
        trunk = Trunk(EXTRACTION, 0, 0)
    slow, fast, again = (trunk.branch(Straight(step)) for step in (*SPEEDS, SPEEDS[0]))
    for step, branch in zip(SPEEDS, (slow, fast), strict=True):
        trunk.log(branch, log_in(tmp_path / "branched"), actor(step))
    trunk.log(again, log_in(tmp_path / "again"), actor(SPEEDS[0]))
    return tmp_path


@pytest.mark.usefixtures("unchecked_shapes")
def test_a_branch_is_the_episode_that_one_pull_alone_would_have_been_to_the_byte(branched):
    for step in SPEEDS:
        alone(EXTRACTION, 0, step, branched / "alone")
    one, other = ({p.name: p.read_bytes() for p in (branched / name).iterdir()} for name in ("alone", "branched"))
    assert len(one) == 2
    assert one == other


def test_a_branch_leaves_nothing_behind_for_the_next(branched):
    (again,) = (branched / "again").iterdir()
    assert again.read_bytes() == (branched / "branched" / again.name).read_bytes()


def test_branches_differ_from_the_pull_on_and_not_before(branched):
    slow, fast = (read_episode(path) for path in sorted((branched / "branched").iterdir()))
    (start,) = {phase.frame for phase in slow.phases + fast.phases if phase.name == "pull"}
    assert start > 10
    np.testing.assert_array_equal(slow.sim_state[: start + 1], fast.sim_state[: start + 1])
    assert not np.array_equal(slow.sim_state[start + 1], fast.sim_state[start + 1])


@pytest.mark.usefixtures("unchecked_shapes")  # which take a quarter of the time
def test_a_robots_branch_is_the_episode_that_it_alone_would_have_been(tmp_path):
    """With the sleeping tower, the arm's set points and what the fingers felt last."""
    with short_towers():
        trunk = Trunk(LOOSE, 0, 90)
    assert trunk.grasped
    trunk.log(trunk.branch(Straight(0.004)), log_in(tmp_path / "branched"), actor(0.004))
    (one,), (other,) = (alone(LOOSE, 90, 0.004, tmp_path / "alone").iterdir(), (tmp_path / "branched").iterdir())
    assert one.name == other.name
    assert one.read_bytes() == other.read_bytes()
    assert [phase.name for phase in read_episode(one).phases][-3:] == ["pull", "put_down", "observe"]


def test_a_tower_that_was_not_grasped_fails_for_every_pull(tmp_path):
    missing = replace(EXTRACTION, gripper=GripperConfig(grip_force=0.001))
    with short_towers():
        trunk = Trunk(missing, 0, 0)
    assert not trunk.grasped
    for step in SPEEDS:
        trunk.log(trunk.branch(Straight(step)), log_in(tmp_path / "logs"), actor(step))
    ends = [read_header(path)[1] for path in (tmp_path / "logs").iterdir()]
    assert len(ends) == 2
    assert all(end is not None and end.cause == "grasp_missed" and end.verdict.failure for end in ends)
    noted = replace(trunk.branch(Straight(SPEEDS[0])), notes={"hindsight_best": "straight-0.5"})
    trunk.log(noted, log_in(tmp_path / "noted"), actor(SPEEDS[0]))
    (log,) = (tmp_path / "noted").iterdir()
    assert read_header(log)[0].provenance["hindsight_best"] == "straight-0.5"
    assert "hindsight_best" not in read_header(tmp_path / "logs" / log.name)[0].provenance
