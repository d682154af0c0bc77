"""What is made of the simulator's branches: skill of a restart, and how well a model ranks plans."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from closed_loops import tower
from made_up_dataset import BLOCKS
from short_towers import short_towers

from jenga_control.planning.dynamics import NothingMoves
from jenga_control.prediction.ceiling import ceiling_report, disturbance, from_folder, ranking_report, state_of, varies
from jenga_control.prediction.restarts import (
    STEPS,
    Branches,
    Candidates,
    Restarts,
    choose,
    eligible,
    simulate,
)
from jenga_control.tables import ceiling_tables
from jenga_data.collect.config import ExtractionConfig, SpawnConfig
from jenga_data.collect.extraction import LIMITS, MAX_STEP_CHANGE, run_extraction
from jenga_data.collect.resume import KNOWN
from jenga_data.dataset.split import TEST_SHARE, position
from jenga_data.episode import CONTROL_STEP_NS, Contacts, Episode, EpisodeHeader, GripperTrack, Result
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.log.reader import read_header
from jenga_data.log.writer import EpisodeWriter
from jenga_data.outcome import Outcome, Verdict

TARGET = 4


def branches(number: int, plans: int = 20, gain: float = 0.3) -> Branches:
    """One step of plans: the neighbour follows a part of what the target is pulled."""
    rng, state = np.random.default_rng(number), tower(number)
    plan = rng.normal(0, 2e-3, (plans, 1, 3))
    pose = np.repeat(state.pose[None, None], plans, axis=0).repeat(2, axis=1)
    pose[:, 1, TARGET, :3] += plan[:, 0]
    pose[:, 1, 1, 0] += gain * plan[:, 0, 0]
    return Branches(
        tower=f"tower {number}",
        target=TARGET,
        block_size=state.blocks.size,
        block_mass=state.blocks.mass,
        level=state.layout.level,
        slot=state.layout.slot,
        twist=state.twist,
        lag=np.zeros(3),
        plan=plan,
        pose=pose,
    )


class Follows(NothingMoves):
    """Knows how the made-up neighbour moves, with the given sign."""

    def __init__(self, gain: float) -> None:
        self.gain = gain

    def rollout(self, actions: np.ndarray) -> np.ndarray:
        pose = super().rollout(actions)
        pose[:, 1:, 1, 0] += self.gain * np.cumsum(np.abs(actions[..., 0]), axis=1)
        return pose


def test_disturbance_is_the_way_of_all_others():
    some = branches(0)
    np.testing.assert_allclose(disturbance(some.pose, TARGET), 0.3 * np.abs(some.plan[:, 0, 0]))


def test_who_knows_the_way_ranks_perfectly_and_who_says_the_same_of_all_ranks_nothing():
    decisions = [branches(number) for number in range(4)]
    perfect, nothing = ranking_report(decisions, Follows(0.1)), ranking_report(decisions, NothingMoves())
    assert perfect["model"]["mean"] == pytest.approx(1)
    assert perfect["model"]["ci95"] == pytest.approx([1, 1])
    assert nothing["model"]["mean"] == 0
    assert (perfect["n"], perfect["plans"], perfect["steps"]) == (4, 20, 1)
    assert abs(perfect["faster_is_worse"]["mean"]) < 0.5  # its plans push as often as they pull
    assert ranking_report(decisions, None)["model"]["mean"] is None


def test_decisions_whose_plans_are_alike_do_not_count():
    still = branches(0, gain=0.0)
    assert not varies(disturbance(still.pose, TARGET))
    found = ranking_report([still, branches(1)], Follows(0.1))
    assert (found["n"], found["alike"]) == (1, 1)
    assert ranking_report([still], None)["faster_is_worse"]["mean"] is None


def restarted(number: int, error: float) -> Branches:
    """A log in which block 1 moves by 1 mm a step, and restarts that miss it by a share."""
    state = tower(number)
    pose = np.repeat(state.pose[None, None], len(KNOWN) + 1, axis=0).repeat(STEPS + 1, axis=1)
    for step in range(STEPS + 1):
        pose[:, step, 1, 0] += 1e-3 * step
        pose[0, step, 1, 0] -= error * 1e-3 * step
    plan = np.zeros((len(KNOWN) + 1, STEPS, 3))
    return replace(branches(number), plan=plan, pose=pose)


def test_the_skill_of_a_restart_is_counted_against_the_log(tmp_path: Path):
    for number in range(3):
        restarted(number, 0.5).write(tmp_path / f"restart-{number}.npz")
        branches(number).write(tmp_path / f"decision-{number}.npz")
    report = from_folder(tmp_path, None)
    ceiling = report["ceiling"]
    assert (ceiling["states"], ceiling["towers"]) == (3, 3)
    assert ceiling["poses"]["one_step"]["skill_others"] == pytest.approx(0.75)
    assert ceiling["poses"]["rollout_5"]["rmse_mm_others"] == pytest.approx(2.5 / np.sqrt(BLOCKS - 1))
    assert ceiling["all"]["rollout_5"]["skill_others"] == 1
    text = ceiling_tables(report)
    assert "| poses, " not in text
    assert "| poses | one step | 0.75 [0.75, 0.75]" in text
    assert ceiling_report([])["all"]["one_step"]["n"] == 0
    ceiling_tables({**report, "ceiling": ceiling_report([]), "ranking": ranking_report([], None)})


def test_branches_survive_a_file_and_damage_is_told(tmp_path: Path):
    some, path = branches(3), tmp_path / "decision-3.npz"
    some.write(path)
    again = Branches.read(path)
    np.testing.assert_array_equal(again.pose, some.pose)
    assert (again.tower, again.target) == (some.tower, some.target)
    np.testing.assert_array_equal(state_of(again).layout.grid, tower(3).layout.grid)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(CheckFailed, match="damaged: delete it"):
        Branches.read(path)


def episode(frames: int = 12, clear: int = -1, fall: int = 99) -> Episode:
    state = tower()
    pose = np.repeat(state.pose[None], frames, axis=0)
    pose[:, TARGET, 0] -= 0.9e-3 * np.arange(frames)
    pose[fall:, 7, 2] -= 0.01
    no_contacts = Contacts(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)))
    time, actions = np.arange(frames) * CONTROL_STEP_NS, np.tile([-1e-3, 0.0, 0.0], (frames - 1, 1))
    track = GripperTrack(time, np.zeros((frames, 7)), np.zeros(frames), *np.zeros((2, frames, 3)))
    header = EpisodeHeader("ab", "extraction", 1, 0, state.blocks, state.layout, TARGET, 0, 0, {})
    return Episode(
        header=header,
        time_ns=time,
        pose=pose,
        twist=np.zeros((frames, BLOCKS, 6)),
        contacts=[no_contacts] * frames,
        sim_state=np.zeros((frames, 0)),
        action_frame=np.arange(frames - 1),
        action=actions,
        action_reached=actions,
        gripper=track,
        phases=[],
        result=Result(Verdict(Outcome.EXTRACTED, False, 0.0, clear)),
        turntable=np.zeros(frames),
        robot=None,
    )


def test_states_have_their_steps_before_them_and_the_target_in_the_tower():
    assert eligible(episode()) == list(range(7))
    assert eligible(episode(clear=4)) == [0, 1, 2, 3]
    assert eligible(episode(fall=7)) == [0, 1]
    assert eligible(episode(frames=STEPS)) == []


def test_the_lag_grows_by_what_the_target_falls_short():
    np.testing.assert_allclose(episode().lag[6], [-0.6e-3, 0, 0], atol=1e-12)
    np.testing.assert_array_equal(episode().lag[0], 0.0)


def test_candidate_plans_are_around_the_last_action_and_within_the_arms_limits(tmp_path: Path):
    work = Candidates(tmp_path, 500, 3)
    plans = work.plans(episode(), 3)
    assert plans.shape == (500, 3, 3)
    assert (np.abs(plans) <= LIMITS).all()
    assert (np.abs(np.diff(plans[..., 0], axis=1)) <= MAX_STEP_CHANGE).all()
    assert plans[..., 0].mean() == pytest.approx(-2e-3, abs=1e-4)
    assert plans[:, 0, 0].std() == pytest.approx(1e-3, rel=0.1)
    np.testing.assert_array_equal(plans, work.plans(episode(), 3))
    assert (plans != work.plans(episode(), 4)).any()


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A loose block of a short tower, pulled by a gripper."""
    path = tmp_path_factory.mktemp("logs") / "pull.mcap"
    spawn = SpawnConfig(last_round=2, stand=0.32)
    config = ExtractionConfig(body="gripper", spawn=spawn, side=0.0001, slowest=0.004, fastest=0.006)
    with short_towers():
        run_extraction(config, 0, 1, lambda header, scene: EpisodeWriter(path, header, scene))
    return path


def test_states_of_a_real_log_are_restarted_and_branched_from_once(log: Path, tmp_path: Path):
    states = choose([log], 2, seed=0, held_out=False)
    assert [(some.log, len(some.numbers)) for some in states] == [(log, 2)]
    simulate(Restarts(tmp_path), states, 1, "restarting")
    simulate(Candidates(tmp_path, 3, 1), choose([log], 1, seed=0, held_out=False), 1, "branching")
    report = from_folder(tmp_path, NothingMoves())
    assert report["ceiling"]["all"]["rollout_5"]["rmse_mm_others"] == 0
    assert report["ceiling"]["poses"]["one_step"]["rmse_mm_target"] > 0
    assert report["ranking"]["n"] + report["ranking"]["alike"] == 1
    written = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    simulate(Restarts(tmp_path), states, 1, "restarting")
    assert written == {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}


def test_logs_without_held_out_towers_or_pulls_are_refused(log: Path):
    held_out = position(read_header(log)[0].blocks.tower) < TEST_SHARE
    if held_out:
        assert choose([log], 1, 0, held_out=True)
    else:
        with pytest.raises(JengaError, match="no pull of 5 actions in held-out towers"):
            choose([log], 1, 0, held_out=True)
    with pytest.raises(JengaError, match="0 logs hold no pull"):
        choose([], 1, 0, held_out=False)
