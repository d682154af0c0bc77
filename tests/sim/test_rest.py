from dataclasses import replace

import numpy as np
import pytest
from kept_record import Kept
from short_tower import PHYSICS

from jenga_data.blocks import NOMINAL_SIZE, sample_blocks
from jenga_data.collect.observe import observe
from jenga_data.collect.recording import Recording
from jenga_data.collect.rest import REST_SPEED, WINDOW, at_rest
from jenga_data.outcome import Outcome
from jenga_data.sim.physics import PhysicsConfig
from jenga_data.sim.scene import add_tower, base_spec
from jenga_data.sim.world import World
from jenga_data.tower import Layout

FRAME = 0.032
BLOCKS = 6
TARGET = 1


def watched(motion, frames: int = WINDOW + 1) -> list[np.ndarray]:
    """Poses of frames, the latest at t = 0; `motion(t)` is where the blocks are (block xyz), from where they stood."""
    stood = np.random.default_rng(0).normal(0, 0.1, (BLOCKS, 7))
    poses = []
    for t in FRAME * np.arange(1 - frames, 1):
        pose = stood.copy()
        pose[:, :3] += motion(t)
        poses.append(pose)
    return poses


def drift(speed: float, block: int = 3, axis: int = 0) -> np.ndarray:
    velocity = np.zeros((BLOCKS, 3))
    velocity[block, axis] = speed
    return velocity


# --- what counts as rest -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("frames", range(WINDOW + 1))
def test_too_few_frames_are_no_rest(frames):
    assert not at_rest(watched(lambda t: 0.0, frames))


def test_what_does_not_move_rests():
    assert at_rest(watched(lambda t: 0.0))


def test_creep_is_rest():
    """All blocks together, at a tenth of the speed that is none."""
    assert at_rest(watched(lambda t: np.full((BLOCKS, 3), 0.1 * REST_SPEED) * t))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("block", [0, 3, BLOCKS - 1])
def test_a_single_block_that_gets_on_is_no_rest(block, axis):
    for direction in (-1, 1):
        assert at_rest(watched(lambda t, d=direction: drift(0.99 * d * REST_SPEED, block, axis) * t))
        assert not at_rest(watched(lambda t, d=direction: drift(1.01 * d * REST_SPEED, block, axis) * t))


def test_a_fall_that_has_just_begun_is_no_rest():
    """After a single frame: g t^2 / 2 is 5 mm in 0.032 s."""
    assert not at_rest(watched(lambda t: drift(-9.81 / 2, axis=2) * max(0.0, t + FRAME) ** 2))


def test_a_tower_that_begins_to_tip_over_is_no_rest():
    """From standing still 0.15 mm out of balance, with the time constant of 0.2 s that a whole tower has: what it does
    at first is less than creep, so that only a window of a quarter of a second tells."""
    began = -WINDOW * FRAME

    def tips(t: float) -> np.ndarray:
        return np.outer(np.linspace(0, 1, BLOCKS), [0.00015 * (np.cosh((t - began) / 0.2) - 1), 0.0, 0.0])

    assert not at_rest(watched(tips))


def test_rattling_that_does_not_get_on_is_rest():
    """Three hundredths of a millimetre to and fro, at ten times the speed of rest."""
    rng = np.random.default_rng(1)
    assert at_rest(watched(lambda t: rng.uniform(-1, 1, (BLOCKS, 3)) * 1.5e-5))
    assert 3e-5 / FRAME > REST_SPEED


def test_only_the_latest_frames_count():
    """It moved until the window began, and rests since; one frame earlier it does not."""
    poses = watched(lambda t: drift(0.1) * min(t, -WINDOW * FRAME), frames=3 * WINDOW)
    assert at_rest(poses)
    assert not at_rest(poses[:-1])


def test_the_block_that_is_ignored_may_move_and_no_other_may():
    carried = watched(lambda t: drift(0.1, block=3) * t)
    assert at_rest(carried, ignore=3)
    assert not at_rest(carried)
    assert not at_rest(carried, ignore=2)
    # -1 is none, not the last block.
    assert not at_rest(watched(lambda t: drift(0.1, block=BLOCKS - 1) * t), ignore=-1)


def test_numbers_that_are_none_are_no_rest():
    broken = watched(lambda t: 0.0)
    broken[-1][2, 0] = np.nan
    assert not at_rest(broken)


# --- slow falls are no rest ----------------------------------------------------------------------------------------


def leaning(off: float, slope: float, physics: PhysicsConfig) -> World:
    """A level, a block across it, and one across that, `off` its middle [m], on a table that slopes by `slope`."""
    _, width, height = NOMINAL_SIZE
    grid = np.array([[0, 1, 2], [-1, 3, -1], [-1, 4, -1]])
    pose = np.zeros((5, 7))
    pose[:, 1] = np.array([-1, 0, 1, 0, 0]) * (width + 0.0002)
    pose[:, 2] = (np.array([0, 0, 0, 1, 2]) + 0.5) * height
    pose[:, 3] = 1.0
    pose[3, [3, 6]] = np.sqrt(0.5)
    pose[4, 0] = off
    blocks = sample_blocks("nominal", np.random.default_rng(0), 5)
    spec = base_spec(physics)
    spec.option.gravity = [9.81 * slope, 0.0, -9.81]
    add_tower(spec, blocks, pose, TARGET, physics)
    return World(spec, blocks, Layout(grid))


SLIDING = replace(PHYSICS, impratio=0.05)
"""With so little, a block creeps down a slope of a tenth by 0.4 mm/s against the one below."""
SLOW_FALLS = pytest.mark.parametrize(
    ("off", "slope", "physics", "falls_after"),
    [(0.012383, 0.0, PHYSICS, 0.6), (0.0113, 0.1, SLIDING, 1.2)],
    ids=["tips over its edge", "creeps to its edge"],
)


@SLOW_FALLS
def test_a_tower_that_falls_slowly_is_not_put_to_sleep(off, slope, physics, falls_after):
    """The target stays where it is; the label and every pose are those of a tower that may not sleep."""
    recordings = []
    for sleep in (True, False):
        world = leaning(off, slope, physics)
        recordings.append(Recording(world, Kept(), TARGET))
        observe(recordings[-1], physics, lambda _, world=world: world.step(), sleep)
    may_sleep, may_not = recordings
    assert may_sleep.verdict() == may_not.verdict()
    assert may_sleep.verdict().outcome is Outcome.COLLAPSED
    assert may_sleep.frame * FRAME > falls_after + 0.32  # which is how much of a collapse is shown
    np.testing.assert_array_equal(may_sleep.poses, may_not.poses)


@SLOW_FALLS
def test_by_itself_mujoco_would_freeze_a_tower_that_falls_slowly(off, slope, physics, falls_after):
    """Or the test above would show nothing: a tower that may sleep from the start never falls."""
    world = leaning(off, slope, physics)
    world.allow_sleep(True)
    start = world.pose
    for _ in range(70):
        world.step(physics.steps_a_frame)
    assert world.asleep
    assert (start[:, 2] - world.pose[:, 2]).max() < 0.001


def test_a_tower_at_rest_sleeps_before_it_was_watched_to_the_end():
    world = leaning(0.0, 0.0, PHYSICS)
    recording = Recording(world, Kept(), TARGET)
    observe(recording, PHYSICS, lambda _: world.step())
    assert world.asleep
    assert recording.verdict().outcome is Outcome.STUCK
    np.testing.assert_array_equal(recording.poses[-1], recording.poses[2 * WINDOW])
