from collections.abc import Callable

import numpy as np
import pytest
from kept_record import Kept
from puppet import PHYSICS, Stage
from short_tower import EXTRACTION, short_tower, world_of

from jenga_data.collect.extraction import LIMITS, MAX_STEP_CHANGE, RandomPull, executable
from jenga_data.collect.observe import observe
from jenga_data.collect.recording import Recorder, Recording
from jenga_data.collect.rest import WINDOW
from jenga_data.outcome import Outcome

PERIOD_NS = 32_000_000
FRAMES_IN_TWO_SECONDS = 63
CLEAR = 0.2


@pytest.fixture
def stage() -> Stage:
    return Stage()


def watch(stage: Stage, happens: Callable[[int], None] = lambda _: None) -> int:
    """Observe to the end; `happens(n)` is called within the n-th control step. Returns how many there were."""
    before = stage.recording.frame

    def substep(i: int) -> None:
        stage.world.step()
        if i == 0:
            happens(stage.recording.frame - before + 1)

    observe(stage.recording, PHYSICS, substep)
    return stage.recording.frame - before


# --- what is recorded ----------------------------------------------------------------------------------------------


def test_a_kept_recorder_is_a_recorder():
    assert isinstance(Kept(), Recorder)


def test_frames_count_from_the_state_before_anything_happens(stage):
    stage.wait(3)
    assert [f.index for f in stage.kept.frames] == [0, 1, 2, 3]
    assert [f.time_ns for f in stage.kept.frames] == [0, PERIOD_NS, 2 * PERIOD_NS, 3 * PERIOD_NS]
    assert stage.recording.frame == 3


def test_phases_and_actions_are_stamped_with_their_frame(stage):
    stage.wait(2)
    stage.recording.phase("pull")
    stage.wait(1)
    stage.recording.action(2, np.array([-0.01, 0, 0]), np.array([-0.009, 0, 0]))
    assert [(p.frame, p.time_ns, p.name) for p in stage.kept.phases] == [(2, 2 * PERIOD_NS, "pull")]
    assert [(a.frame, a.time_ns) for a in stage.kept.actions] == [(2, 2 * PERIOD_NS)]


def test_each_control_step_runs_all_its_substeps(stage):
    seen = []
    stage.recording.advance(seen.append, 16)
    assert seen == list(range(16))
    assert stage.recording.frame == 1


# --- what is known of a pull while it goes on ----------------------------------------------------------------------


def test_clear_counts_from_the_last_time_the_target_became_clear(stage):
    assert stage.recording.clear_frame() == -1
    stage.wait(2)
    stage.move(stage.target, -CLEAR, 0, 0)
    stage.wait(2)
    assert stage.recording.clear_frame() == 3
    stage.move(stage.target, CLEAR, 0, 0)
    stage.wait(1)
    assert stage.recording.clear_frame() == -1
    stage.move(stage.target, -CLEAR, 0, 0)
    stage.wait(3)
    assert stage.recording.clear_frame() == 6


def test_distance_clear_is_measured_along_minus_x_from_where_it_became_clear(stage):
    stage.wait(1)
    assert stage.recording.distance_clear() == 0
    stage.move(stage.target, -CLEAR, 0, 0)
    stage.wait(1)
    assert stage.recording.distance_clear() == 0
    stage.move(stage.target, -0.03, 0.01, 0)
    stage.wait(1)
    assert stage.recording.distance_clear() == pytest.approx(0.03)


def test_the_recording_knows_what_the_verdict_will_say(stage):
    stage.move(stage.target, -CLEAR, 0, 0)
    stage.wait(FRAMES_IN_TWO_SECONDS)
    assert not stage.recording.stood_for(2.0)
    assert stage.recording.verdict().outcome is Outcome.STUCK
    stage.wait(1)
    assert stage.recording.stood_for(2.0)
    assert stage.recording.verdict().outcome is Outcome.EXTRACTED
    stage.move(int(stage.world.layout.grid[3, 0]), 0, 0, -0.008)
    stage.wait(1)
    assert stage.recording.has_collapsed()
    assert stage.recording.finish("slipped") == stage.kept.results[0]
    assert stage.kept.results[0].verdict.outcome is Outcome.COLLAPSED
    assert stage.kept.results[0].cause == "slipped"


# --- watching the tower afterwards ---------------------------------------------------------------------------------


def test_a_clear_target_is_watched_until_the_tower_has_stood_for_two_seconds(stage):
    stage.wait(1)
    stage.move(stage.target, -CLEAR, 0, 0)
    stage.wait(1)
    assert watch(stage) == FRAMES_IN_TWO_SECONDS
    assert stage.recording.verdict().outcome is Outcome.EXTRACTED


def test_a_target_that_is_not_clear_is_watched_for_two_seconds_too(stage):
    assert watch(stage) == FRAMES_IN_TWO_SECONDS
    assert stage.recording.verdict().outcome is Outcome.STUCK


def test_a_target_that_gets_clear_late_is_watched_on(stage):
    def gets_clear(frame: int) -> None:
        if frame == 40:
            stage.move(stage.target, -CLEAR, 0, 0)

    assert watch(stage, gets_clear) == 40 + FRAMES_IN_TWO_SECONDS
    assert stage.recording.verdict().outcome is Outcome.EXTRACTED


def test_of_a_collapse_a_little_is_shown(stage):
    def falls(frame: int) -> None:
        if frame == 20:
            stage.move(int(stage.world.layout.grid[3, 0]), 0, 0, -0.05)

    assert watch(stage, falls) == 20 + 10
    assert stage.recording.verdict().outcome is Outcome.COLLAPSED


def test_a_tower_may_sleep_only_after_it_was_seen_to_rest_while_it_was_watched(stage):
    stage.wait(3 * WINDOW)
    began = stage.world.time_ns
    watch(stage)
    assert stage.world.allowed_at_ns[0] - began == WINDOW * PERIOD_NS


def test_a_tower_does_not_sleep_before_it_has_rested_for_as_long_after_its_last_motion(stage):
    began = stage.world.time_ns

    def stirs(frame: int) -> None:
        if frame <= 20:
            stage.move(int(stage.world.layout.grid[3, 0]), 0, 0.0005, 0)

    watch(stage, stirs)
    assert stage.world.allowed_at_ns[0] - began == (20 + WINDOW) * PERIOD_NS


def test_a_target_keeps_a_tower_awake_until_it_is_clear(stage):
    """A block that is carried away may sink or drift, but one that is still in the tower may yet bring it down: only
    from when it is clear does the tower count as left alone, and has to be seen at rest."""
    began = stage.world.time_ns

    def drifts(frame: int) -> None:
        stage.move(stage.target, -CLEAR if frame == 20 else -0.0005, 0, 0)

    watch(stage, drifts)
    assert stage.world.allowed_at_ns[0] - began == (20 + WINDOW) * PERIOD_NS


def test_a_tower_that_may_not_sleep_does_not(stage):
    observe(stage.recording, PHYSICS, lambda _: stage.world.step(), sleep=False)
    assert not stage.world.allowed_at_ns
    assert stage.recording.frame == FRAMES_IN_TWO_SECONDS


# --- physics that break --------------------------------------------------------------------------------------------


def test_broken_physics_are_invalid_and_no_tower_that_never_moved(monkeypatch, tmp_path):
    """MuJoCo would answer with a silent reset to where the tower started."""
    monkeypatch.chdir(tmp_path)  # MuJoCo leaves a note of it in the working directory
    world = world_of(short_tower())
    recording = Recording(world, Kept(), target=1)
    recording.advance(lambda _: world.step(), 16)
    world.data.qvel[0] = 1e12
    for _ in range(3):
        recording.advance(lambda _: world.step(), 16)
    assert recording.time_ns() == 4 * PERIOD_NS
    assert recording.verdict().outcome is Outcome.INVALID


# --- actions -------------------------------------------------------------------------------------------------------


def test_an_executable_action_keeps_within_the_limits_of_paper_and_arm():
    rng = np.random.default_rng(0)
    action = np.zeros(3)
    for _ in range(200):
        wanted = rng.normal(0, 0.02, 3)
        previous, action = action, executable(wanted, action)
        assert (np.abs(action) <= [0.02, 0.001, 0.001]).all()
        assert abs(action[0] - previous[0]) <= 0.013 + 1e-15


def test_an_action_that_can_be_made_is_made_as_it_is():
    wanted = np.array([-0.012, 0.0005, -0.001])
    np.testing.assert_array_equal(executable(wanted, np.zeros(3)), wanted)
    assert executable(np.array([-0.02, 0, 0]), np.array([0.02, 0, 0]))[0] == pytest.approx(0.02 - MAX_STEP_CHANGE)
    np.testing.assert_array_equal(LIMITS, [0.02, 0.001, 0.001])


def test_an_action_is_not_changed_where_it_came_from():
    wanted, previous = np.array([-0.1, 0.1, 0.1]), np.zeros(3)
    executable(wanted, previous)
    np.testing.assert_array_equal(wanted, [-0.1, 0.1, 0.1])
    assert not previous.any()


def test_random_pulls_go_along_minus_x_at_speeds_that_are_uniform_in_their_logarithm():
    world = world_of(short_tower())
    state, means = world.tower_state(), []
    for seed in range(300):
        pull = RandomPull(EXTRACTION, np.random.default_rng(seed))
        actions = np.array([pull.act(state, 0) for _ in range(20)])
        means.append(-actions[:, 0].mean())
        assert (np.abs(actions[:, 1:]) <= EXTRACTION.side).all()
        assert np.ptp(actions[:, 1]) > EXTRACTION.side
    logs = np.log(means)
    low, high = np.log([EXTRACTION.slowest, EXTRACTION.fastest])
    assert low - 0.2 < logs.min() < logs.max() < high + 0.2
    assert logs.mean() == pytest.approx((low + high) / 2, abs=0.15)
    assert logs.std() == pytest.approx((high - low) / np.sqrt(12), rel=0.1)
