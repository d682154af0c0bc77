import numpy as np
import pytest
from nominal_tower import layout_of, nominal_state
from scipy.spatial.transform import Rotation

from jenga_data.outcome import THRESHOLDS, Outcome, Verdict, collapsed, judge

STATE = nominal_state(layout_of("xxx", "xxx", "xxx"))
TARGET = 1
"""In the centre of level 0, along x."""
FRAME_SECONDS = 0.25
STANDING_FRAMES = 8
"""Frames in the 2 s for which the tower must stand."""
CLEAR = 0.0751
"""So far along -x the target is out from under the 75 mm of the level above [m]."""


def frames(count: int = 1 + STANDING_FRAMES) -> np.ndarray:
    """A tower that nothing touches."""
    return np.repeat(STATE.pose[None], count, axis=0)


def pulled(clear_from: int, count: int) -> np.ndarray:
    """The target is clear from frame `clear_from` on."""
    pose = frames(count)
    pose[clear_from:, TARGET, 0] -= CLEAR
    return pose


def verdict(pose: np.ndarray) -> Verdict:
    return judge(pose, STATE.blocks.size, TARGET, FRAME_SECONDS)


# --- one outcome at a time -----------------------------------------------------------------------------------------


def test_a_tower_that_nothing_happens_to_is_stuck():
    assert verdict(frames()) == Verdict(Outcome.STUCK, dragged=False, moved=0.0, clear_frame=-1)


def test_a_clear_target_and_a_tower_that_stands_for_two_seconds_is_extracted():
    assert verdict(pulled(3, 4 + STANDING_FRAMES)) == Verdict(Outcome.EXTRACTED, False, 0.0, clear_frame=3)


def test_standing_counts_from_the_frame_in_which_the_target_is_clear():
    assert verdict(pulled(3, 4 + STANDING_FRAMES - 1)).outcome is Outcome.STUCK
    assert verdict(pulled(0, 1 + STANDING_FRAMES)).outcome is Outcome.EXTRACTED


def test_two_seconds_of_control_steps_are_enough_although_they_do_not_add_up_exactly():
    frames_needed = 63  # 62.5 steps of 32 ms
    pose = pulled(1, 2 + frames_needed)
    assert judge(pose, STATE.blocks.size, TARGET, 0.032).outcome is Outcome.EXTRACTED
    assert judge(pose[:-1], STATE.blocks.size, TARGET, 0.032).outcome is Outcome.STUCK
    pose = pulled(1, 2 + 49)
    assert 49 * (2 / 49) < 2
    assert judge(pose, STATE.blocks.size, TARGET, 2 / 49).outcome is Outcome.EXTRACTED


def test_a_target_that_comes_back_starts_anew():
    pose = pulled(2, 3 + STANDING_FRAMES)
    pose[5, TARGET] = STATE.pose[TARGET]
    assert verdict(pose) == Verdict(Outcome.STUCK, False, 0.0, clear_frame=6)
    pose[-1, TARGET] = STATE.pose[TARGET]
    assert verdict(pose).clear_frame == -1


@pytest.mark.parametrize(("drop", "outcome"), [(-1e-9, Outcome.STUCK), (1e-9, Outcome.COLLAPSED)])
@pytest.mark.parametrize("block", [0, 8])
def test_a_block_that_drops_by_more_than_half_its_height_is_a_collapse(block, drop, outcome):
    pose = frames()
    pose[2:, block, 2] -= 0.0075 + drop
    assert verdict(pose).outcome is outcome


def test_a_collapse_counts_also_if_the_block_is_back_up_in_the_end():
    pose = frames()
    pose[3, 8, 2] -= 0.02
    assert verdict(pose).outcome is Outcome.COLLAPSED


def test_the_target_may_drop():
    pose = pulled(3, 4 + STANDING_FRAMES)
    pose[4:, TARGET, 2] -= 0.3
    assert verdict(pose) == Verdict(Outcome.EXTRACTED, False, 0.0, clear_frame=3)


def test_a_block_that_is_lifted_is_no_collapse():
    pose = frames()
    pose[2:, 8, 2] += 0.02
    assert verdict(pose).outcome is Outcome.STUCK


@pytest.mark.parametrize(("value", "coordinate"), [(np.nan, 0), (np.nan, 5), (np.inf, 2), (np.inf, 5), (1e200, 0)])
def test_numbers_that_are_none_or_beyond_all_bounds_are_invalid(value, coordinate):
    pose = frames()
    pose[4:6, 3, coordinate] = value
    found = verdict(pose)
    assert found.outcome is Outcome.INVALID
    assert np.isnan(found.moved)


@pytest.mark.parametrize(("speed", "outcome"), [(49.99, Outcome.STUCK), (50.01, Outcome.INVALID)])
def test_faster_than_any_fall_is_invalid(speed, outcome):
    pose = frames()
    direction = np.array([0.6, 0.0, 0.8])
    pose[5:, 8, :3] += speed * FRAME_SECONDS * direction
    assert verdict(pose).outcome is outcome


# --- the order in which they are decided ---------------------------------------------------------------------------


def test_outcomes_are_decided_in_the_order_of_their_members():
    """Each of these adds one more thing that went wrong to the one before, and takes its place."""
    assert list(Outcome) == ["invalid", "collapsed", "extracted", "stuck"]
    pose = frames(4 + STANDING_FRAMES)
    found = [verdict(pose).outcome]
    pose[3:, TARGET, 0] -= CLEAR
    found.append(verdict(pose).outcome)
    pose[-1, 8, 2] -= 0.01
    found.append(verdict(pose).outcome)
    pose[-1, 7, 0] = np.nan
    found.append(verdict(pose).outcome)
    assert found == list(Outcome)[::-1]


def test_failure_is_stuck_or_collapsed():
    assert [outcome for outcome in Outcome if outcome.failure] == [Outcome.COLLAPSED, Outcome.STUCK]


# --- what moved ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("sideways", "dragged"), [(0.015 - 1e-9, False), (0.015 + 1e-9, True)])
def test_dragged_is_another_block_moved_sideways_by_more_than_a_blocks_height(sideways, dragged):
    pose = pulled(3, 4 + STANDING_FRAMES)
    pose[2:, 4, :2] += sideways * np.array([0.6, -0.8])
    found = verdict(pose)
    assert found.dragged is dragged
    assert found.moved == pytest.approx(sideways)
    assert (found.outcome, found.failure, found.strict_failure) == (Outcome.EXTRACTED, False, dragged)


def test_up_is_not_sideways():
    pose = frames()
    pose[2:, 4, 2] += 0.02
    found = verdict(pose)
    assert not found.dragged
    assert found.moved == pytest.approx(0.02)


def test_moved_is_the_largest_displacement_at_any_time_of_any_block_but_the_target():
    pose = pulled(3, 4 + STANDING_FRAMES)
    pose[4, 7, :3] += [0.001, 0.002, 0.002]
    pose[6:, 3, 0] += 0.002
    assert verdict(pose).moved == pytest.approx(0.003)


def test_every_failure_is_a_strict_failure():
    assert verdict(frames()).strict_failure


# --- the collapse of a batch ---------------------------------------------------------------------------------------


def test_collapsed_frame_by_frame():
    pose = frames(5)
    pose[1, TARGET, 2] -= 1.0
    pose[3:, 0, 2] -= 0.008
    many = collapsed(pose[0], pose, TARGET, THRESHOLDS.drop)
    assert many.tolist() == [False, False, False, True, True]
    assert [bool(collapsed(pose[0], p, TARGET, THRESHOLDS.drop)) for p in pose] == many.tolist()


def test_the_verdict_does_not_depend_on_where_the_tower_stands_or_how_it_is_turned():
    pose = pulled(3, 4 + STANDING_FRAMES)
    pose[4:, 7, :3] += [0.003, 0.004, 0.0]
    rotation = Rotation.from_euler("z", 1.1)
    turned = pose.copy()
    turned[..., :3] = rotation.apply(pose[..., :3].reshape(-1, 3)).reshape(*pose.shape[:2], 3)
    turned[..., :3] += [0.1, 0.2, 0.3]
    x, y, z, w = (rotation * Rotation.from_quat(pose[..., [4, 5, 6, 3]].reshape(-1, 4))).as_quat().T
    turned[..., 3:] = np.stack([w, x, y, z], axis=1).reshape(*pose.shape[:2], 4)
    before, after = verdict(pose), verdict(turned)
    assert (before.outcome, before.clear_frame, before.dragged) == (after.outcome, after.clear_frame, after.dragged)
    assert before.moved == pytest.approx(after.moved)


def test_without_a_target_every_block_counts():
    pose = frames(len(STATE.blocks))
    for block in range(len(pose)):
        pose[block, block, 2] -= 0.008
    assert collapsed(STATE.pose, pose, -1, THRESHOLDS.drop).all()
    assert not collapsed(STATE.pose, frames(3), -1, THRESHOLDS.drop).any()
