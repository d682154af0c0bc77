# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

"""One log of each kind, simulated once on a short tower: what it holds, and what follows from it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import mujoco
import numpy as np
import pytest
from short_tower import EXTRACTION, LEVELS, SELECTION, run_short, short_towers

from jenga_data.blocks import GRAVITY
from jenga_data.collect.config import Actor, CollectConfig, config_from_dict, episode_key
from jenga_data.collect.extraction import LIMITS, MAX_STEP_CHANGE, run_extraction
from jenga_data.collect.rollout import OpenLog
from jenga_data.dataset.rows import Ragged, rows_of
from jenga_data.episode import LEFT_FINGER, RIGHT_FINGER, TABLE, Episode, Result
from jenga_data.geometry import clear_of_others, in_table_frame
from jenga_data.graph import support_edges
from jenga_data.log.reader import attachment, read_episode
from jenga_data.log.report import doctor
from jenga_data.log.writer import EpisodeWriter
from jenga_data.outcome import Outcome, judge
from jenga_data.sim.servo import BlockServo
from jenga_data.sim.world import STATE_SPEC
from jenga_data.tower import TowerState

SEED = 0
STEP_NS = 32_000_000
AWAY = 0.05
TOUCH_NS = 4_000_000


@dataclass(frozen=True)
class Logged:
    """A log, what was read back from it, and what the rollout said at its end."""

    path: Path
    config: CollectConfig
    episode: Episode
    result: Result


Rollout = Callable[[CollectConfig, int, int, OpenLog], Result]


def roll(folder: Path, config: CollectConfig, number: int, rollout: Rollout = run_short) -> Logged:
    paths = []

    def open_log(header, xml):
        paths.append(folder / f"{header.key}.mcap")
        return EpisodeWriter(paths[-1], header, xml)

    result = rollout(config, SEED, number, open_log)
    return Logged(paths[0], config, read_episode(paths[0]), result)


def first(folder: Path, config: CollectConfig, outcome: Outcome) -> Logged:
    """The first episode of the seed that ends so."""
    for number in range(20):
        logged = roll(folder, config, number)
        if logged.result.verdict.outcome is outcome and not logged.result.cause:
            return logged
    raise AssertionError(f"none of 20 episodes ends {outcome}")


@pytest.fixture(scope="module")
def extracted(tmp_path_factory: pytest.TempPathFactory) -> Logged:
    """A selection whose target came out."""
    return first(tmp_path_factory.mktemp("extracted"), SELECTION, Outcome.EXTRACTED)


@pytest.fixture(scope="module")
def gripped(tmp_path_factory: pytest.TempPathFactory) -> Logged:
    """An extraction whose target came out."""
    return first(tmp_path_factory.mktemp("gripped"), EXTRACTION, Outcome.EXTRACTED)


@pytest.fixture(params=["extracted", "gripped"])
def logged(request: pytest.FixtureRequest) -> Logged:
    return request.getfixturevalue(request.param)


def frames_of(episode: Episode, phase: str) -> slice:
    """From the first frame of a phase to the first of the next."""
    starts = [p.frame for p in episode.phases]
    at = [p.name for p in episode.phases].index(phase)
    return slice(starts[at], ([*starts, len(episode.pose)])[at + 1])


# --- a log of either kind ------------------------------------------------------------------------------------------


def test_a_log_reads_back_as_it_was_made(logged):
    header = logged.episode.header
    assert logged.episode.result == logged.result
    assert config_from_dict(header.config) == logged.config
    assert header.key == episode_key(logged.config, SEED, header.number) == logged.path.stem
    assert (header.kind, header.seed) == (logged.config.kind, SEED)
    assert header.layout.is_legal(header.target)
    assert len(header.blocks) == 3 * LEVELS
    assert doctor(logged.path).ok


def test_the_same_episode_has_the_same_bytes(logged, tmp_path):
    again = roll(tmp_path, logged.config, logged.episode.header.number)
    assert again.path.read_bytes() == logged.path.read_bytes()


def test_provenance_names_versions_and_no_moment_or_place(logged):
    provenance = logged.episode.header.provenance
    assert {"jenga_version", "mujoco_version", "numpy_version", "python_version", "git_commit", "machine"} <= set(
        provenance
    )
    assert int(provenance["spawn_tries"]) >= 1
    for value in provenance.values():
        assert "/" not in value


def test_frames_are_a_control_step_apart_and_begin_at_rest(logged):
    episode = logged.episode
    np.testing.assert_array_equal(episode.time_ns, np.arange(len(episode.pose)) * STEP_NS)
    assert not episode.twist[0].any()
    np.testing.assert_array_equal(episode.action_frame, episode.action_frame[0] + np.arange(len(episode.action)))


def test_the_verdict_is_that_of_the_logged_poses(logged):
    episode = logged.episode
    pose = in_table_frame(episode.pose, episode.turntable)  # a pull turns its drive a little
    again = judge(pose, episode.header.blocks.size, episode.header.target, STEP_NS * 1e-9)
    assert again == logged.result.verdict
    assert clear_of_others(episode.pose[-1], episode.header.blocks.size, episode.header.target)


def test_the_scene_starts_at_frame_0(logged):
    model = mujoco.MjModel.from_xml_string(attachment(logged.path, "scene.xml").decode())
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    poses = np.array([data.joint(f"block_{i}").qpos for i in range(3 * LEVELS)])
    np.testing.assert_allclose(poses, logged.episode.pose[0], atol=1e-6)
    assert not data.qvel.any()


def test_plain_mujoco_goes_on_from_any_logged_state(logged):
    """A state holds its frame exactly, and the next frame follows, as well as six digits of a block's size allow.

    Just after the pull, when the tower is watched awake; the servo goes on to hold the target.
    """
    episode = logged.episode
    others = np.delete(np.arange(3 * LEVELS), episode.header.target)
    model = mujoco.MjModel.from_xml_string(attachment(logged.path, "scene.xml").decode())
    data = mujoco.MjData(model)

    def poses() -> np.ndarray:
        return np.array([data.joint(f"block_{i}").qpos for i in range(3 * LEVELS)])

    frame = frames_of(episode, "observe").start + 4
    for at in (0, len(episode.pose) - 1, frame):
        mujoco.mj_setState(model, data, episode.sim_state[at], STATE_SPEC)
        np.testing.assert_array_equal(poses(), episode.pose[at])
    mujoco.mj_step(model, data, nstep=16)
    np.testing.assert_allclose(poses()[others, :3], episode.pose[frame + 1, others, :3], atol=1e-4)


def test_contacts_carry_the_tower_at_every_frame_at_rest(logged):
    """Also while it sleeps, when MuJoCo itself finds none. A loose block may be on its way up or down."""
    episode = logged.episode
    others = np.delete(episode.header.blocks.mass, episode.header.target).sum() * GRAVITY
    for contacts in episode.contacts[-5:]:
        on_table = (contacts.second == TABLE) & (contacts.first != episode.header.target)
        assert contacts.force[on_table, 2].sum() == pytest.approx(others, rel=0.15)


def test_the_stored_graph_is_that_of_the_live_tower(logged):
    """Rows of the dataset against `support_edges` of the state that the controller sees."""
    episode, rows = logged.episode, rows_of(logged.episode)
    upper, lower, frames = rows["edge_upper"], rows["edge_lower"], rows["frame"]
    assert isinstance(upper, Ragged)
    assert isinstance(lower, Ragged)
    assert isinstance(frames, np.ndarray)
    for row, frame in enumerate(frames.tolist()):
        live = episode.tower_state(frame)
        part = slice(upper.offset[row], upper.offset[row + 1])
        stored = np.stack([upper.values[part], lower.values[part]])
        np.testing.assert_array_equal(stored, support_edges(live.pose, live.blocks.size))
        assert stored.size > 0


# --- a pull without a robot ----------------------------------------------------------------------------------------


def test_a_selection_pulls_and_then_observes(extracted):
    assert [p.name for p in extracted.episode.phases] == ["pull", "observe"]
    assert len(extracted.episode.gripper.time_ns) == 0
    assert extracted.episode.action_frame[0] == 0


def test_the_servo_pulls_along_minus_x_with_noise_across(extracted):
    action = extracted.episode.action / (STEP_NS * 1e-9)
    np.testing.assert_allclose(action[:, 0], -SELECTION.speed)
    assert 0.3 * SELECTION.noise < action[:, 1:].std() < 3 * SELECTION.noise


def test_what_a_pull_reached_is_how_the_target_moved(extracted):
    episode = extracted.episode
    moved = np.diff(episode.pose[:, episode.header.target, :3], axis=0)
    np.testing.assert_allclose(episode.action_reached, moved[episode.action_frame], atol=1e-15)
    np.testing.assert_allclose(episode.action_reached[5:, 0], episode.action[5:, 0], atol=1.5e-3)


def test_a_stuck_block_is_given_up_and_left_alone(tmp_path):
    """With next to no force nothing moves; the servo then lets go, and the tower is watched for two seconds."""
    logged = roll(tmp_path, replace(SELECTION, force_limit=0.01), 0)
    assert logged.result.verdict.outcome is Outcome.STUCK
    assert logged.result.verdict.moved < 0.002
    pull, rest = frames_of(logged.episode, "pull"), frames_of(logged.episode, "observe")
    assert (pull.stop - pull.start) * STEP_NS <= (SELECTION.patience + 0.1) * 1e9
    assert (rest.stop - rest.start) * STEP_NS >= 2e9


def test_broken_physics_end_as_invalid_in_a_log_that_reads_back(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo leaves a note of it in the working directory
    pulls = BlockServo.step

    def breaks(servo: BlockServo) -> None:
        servo._world.data.qvel[:] = 1e12
        pulls(servo)

    with patch.object(BlockServo, "step", breaks):
        logged = roll(tmp_path, SELECTION, 0)
    assert logged.result.verdict.outcome is Outcome.INVALID
    assert logged.episode.result is not None
    assert logged.episode.result.verdict.outcome is Outcome.INVALID


# --- a pull by the gripper -----------------------------------------------------------------------------------------


def test_an_extraction_approaches_grasps_pulls_and_observes(gripped):
    assert [p.name for p in gripped.episode.phases] == ["approach", "grasp", "pull", "observe"]


def test_all_51_actions_are_made_one_a_frame(gripped):
    episode = gripped.episode
    pull = frames_of(episode, "pull")
    np.testing.assert_array_equal(episode.action_frame, np.arange(pull.start, pull.stop))
    assert len(episode.action) == 51


def test_actions_are_what_the_arm_can_make(gripped):
    action = gripped.episode.action
    assert (np.abs(action) <= LIMITS).all()
    assert (np.abs(np.diff(action[:, 0], prepend=0.0)) <= MAX_STEP_CHANGE + 1e-15).all()
    start = gripped.episode.action_frame[0]
    x = gripped.episode.pose[:, gripped.episode.header.target, 0]
    clear = gripped.result.verdict.clear_frame
    away = int(np.argmax(x[clear] - x > AWAY)) - start  # from here on the hand is at rest
    assert 10 < away < len(action) - 3
    assert (action[:away, 0] < 0).all()
    assert not action[away + 2 :].any()


def test_the_hand_reaches_what_is_commanded_and_takes_the_block_along(gripped):
    episode = gripped.episode
    np.testing.assert_allclose(episode.action_reached, episode.action, atol=1e-3)
    pull = frames_of(episode, "pull")
    target = episode.pose[[pull.start, pull.stop], episode.header.target, :3]
    np.testing.assert_allclose(target[1] - target[0], episode.action_reached.sum(axis=0), atol=5e-3)


def test_nothing_moves_before_the_fingers_touch(gripped):
    before = gripped.episode.pose[frames_of(gripped.episode, "approach")]
    assert np.abs(before[..., :3] - before[0, :, :3]).max() < 5e-4


def test_fingertips_are_sampled_every_four_milliseconds(gripped):
    episode = gripped.episode
    samples = np.arange(1, 1 + (len(episode.pose) - 1) * STEP_NS // TOUCH_NS) * TOUCH_NS
    np.testing.assert_array_equal(episode.gripper.time_ns, samples)


def test_fingertips_feel_nothing_until_the_grasp_and_the_grip_while_they_pull(gripped):
    episode, track = gripped.episode, gripped.episode.gripper
    grasp, pull, rest = (
        episode.phases[[p.name for p in episode.phases].index(name)].time_ns for name in ("grasp", "pull", "observe")
    )
    early, pulling = track.time_ns <= grasp, (track.time_ns > pull) & (track.time_ns <= rest)
    assert not track.left_force[early].any()
    assert not track.right_force[early].any()
    grip = EXTRACTION.gripper.grip_force
    assert np.median(track.left_force[pulling, 1]) == pytest.approx(grip, rel=0.1)
    assert np.median(track.right_force[pulling, 1]) == pytest.approx(-grip, rel=0.1)


def test_fingers_are_in_the_contacts_while_they_hold(gripped):
    episode = gripped.episode
    pull = frames_of(episode, "pull")
    target, fingers = episode.header.target, (LEFT_FINGER, RIGHT_FINGER)
    touching = np.array(
        [
            [target in c.first[c.second == finger] for finger in fingers]
            for c in episode.contacts[pull.start : pull.stop]
        ]
    )
    assert touching.any(axis=1).all()
    assert np.asarray(touching[2:]).all()  # at the jerk with which it starts one of them may let go for a moment


class Puller:
    """A policy that remembers what it saw and where it was told to pull."""

    def __init__(self, step: float) -> None:
        self.step = step
        self.seen: list[TowerState] = []
        self.targets: list[int] = []

    def act(self, state: TowerState, target: int) -> np.ndarray:
        self.seen.append(state)
        self.targets.append(target)
        return np.array([-self.step, 0.5, -0.5])


@pytest.fixture(scope="module")
def controlled(gripped: Logged, tmp_path_factory: pytest.TempPathFactory) -> tuple[Logged, Puller]:
    """The same tower pulled by a policy of our own, fast, that wants more across than the limits allow."""
    puller = Puller(0.008)
    actor = Actor({"name": "puller"}, "0123abcd")

    def rollout(config, seed, number, open_log):
        with short_towers():
            return run_extraction(config, seed, number, open_log, puller, actor)

    folder = tmp_path_factory.mktemp("controlled")
    return roll(folder, EXTRACTION, gripped.episode.header.number, rollout), puller


def test_a_policy_sees_the_tower_as_it_is_logged(controlled):
    """And so builds from the live tower the graph that the dataset stores."""
    logged, puller = controlled
    episode, rows = logged.episode, rows_of(logged.episode)
    upper, lower = rows["edge_upper"], rows["edge_lower"]
    assert isinstance(upper, Ragged)
    assert isinstance(lower, Ragged)
    assert len(puller.seen) == len(episode.action_frame)
    assert set(puller.targets) == {episode.header.target}
    for row, (frame, live) in enumerate(zip(episode.action_frame, puller.seen, strict=True)):
        np.testing.assert_array_equal(live.pose, episode.pose[frame])
        np.testing.assert_array_equal(live.twist, episode.twist[frame])
        part = slice(upper.offset[row], upper.offset[row + 1])
        stored = np.stack([upper.values[part], lower.values[part]])
        np.testing.assert_array_equal(stored, support_edges(live.pose, live.blocks.size))


def test_a_policy_stops_when_the_block_is_well_clear(controlled):
    episode = controlled[0].episode
    target, clear = episode.header.target, controlled[0].result.verdict.clear_frame
    assert clear >= 0
    assert len(episode.action) < 51
    pull = frames_of(episode, "pull")
    way = episode.pose[clear, target, 0] - episode.pose[pull.stop - 1 : pull.stop + 1, target, 0]
    assert way[0] <= 0.05 < way[1]


def test_a_policy_gets_what_can_be_made_of_what_it_wants(controlled):
    action = controlled[0].episode.action
    np.testing.assert_allclose(action, np.tile([-0.008, 0.001, -0.001], (len(action), 1)))


def test_who_acted_is_in_the_header_and_in_the_name(controlled, gripped):
    header = controlled[0].episode.header
    assert header.checkpoint == "0123abcd"
    assert header.config["controller"] == {"name": "puller"}
    assert header.key != gripped.episode.header.key
    assert header.blocks.tower == gripped.episode.header.blocks.tower
    assert gripped.episode.header.checkpoint == ""


def test_fingers_that_find_no_block_are_a_missed_grasp(tmp_path):
    """Fingers too weak to close in time do not hold it; the tower is watched all the same."""
    config = replace(EXTRACTION, gripper=replace(EXTRACTION.gripper, grip_force=0.01))
    logged = roll(tmp_path, config, 0)
    assert logged.result.cause == "grasp_missed"
    assert len(logged.episode.action) == 0
    assert [p.name for p in logged.episode.phases] == ["approach", "grasp", "observe"]
