from dataclasses import replace

import numpy as np
import pytest
from kept_record import Kept
from short_tower import SELECTION, SPAWN, short_towers

from jenga_data.collect.draws import episode_rng
from jenga_data.collect.selection import pull, run_selection
from jenga_data.collect.stage import Stage, set_stage, standing_tower
from jenga_data.episode import Result
from jenga_data.geometry import rotation_matrices

SEED = 0
CONFIG = replace(SELECTION, pull_seconds=1.0)
"""Short, and long enough for a loose block to come out."""


class KeptLog(Kept):
    """A log that is opened as a file is."""

    def __enter__(self) -> "KeptLog":
        return self

    def __exit__(self, *error: object) -> None:
        return None

    @property
    def poses(self) -> np.ndarray:
        return np.stack([frame.pose for frame in self.frames])


def staged(number: int) -> Stage:
    with short_towers():
        return set_stage(CONFIG, SEED, number)


def pulled(stage: Stage, noise: np.random.Generator, sleep: bool = True) -> tuple[Result, KeptLog]:
    log = KeptLog()
    return pull(CONFIG, stage, noise, lambda _: log, sleep), log


@pytest.mark.parametrize("number", [0, 1])
def test_a_pull_at_the_same_stage_with_the_same_noise_is_the_rollout(number):
    log = KeptLog()
    with short_towers():
        expected = run_selection(CONFIG, SEED, number, lambda *_: log)
    result, again = pulled(staged(number), episode_rng(SEED, number, "noise"))
    assert result == expected
    assert again.results == [result]
    np.testing.assert_array_equal(again.poses, log.poses)
    assert [phase.name for phase in again.phases] == ["pull", "observe"]


def test_other_noise_is_another_pull():
    stage = staged(0)
    one, other = (pulled(stage, np.random.default_rng(seed))[1].poses for seed in (1, 2))
    assert np.abs(one[1:10] - other[1:10]).max() > 1e-6
    np.testing.assert_array_equal(one[0], other[0])


@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_tower_that_may_not_sleep_gets_the_same_label(number):
    stage = staged(number)
    (may_sleep, _), (may_not, _) = (pulled(stage, np.random.default_rng(0), sleep) for sleep in (True, False))
    assert may_sleep.verdict.outcome is may_not.verdict.outcome
    assert may_sleep.verdict.clear_frame == may_not.verdict.clear_frame


@pytest.mark.parametrize("face", [0, 1])
def test_a_standing_tower_can_be_set_for_any_of_its_targets(face):
    """Turned as a whole so that the target's face is at -x: where blocks stand to each other does not change."""
    with short_towers():
        state, _ = standing_tower(SPAWN, CONFIG.physics, 2, np.random.default_rng(0))
    heights, apart = state.pose[:, 2], np.linalg.norm(state.pose[:, None, :3] - state.pose[None, :, :3], axis=-1)
    for target in state.layout.legal_targets():
        stage = Stage.of(state, int(target), face)
        assert (stage.target, stage.face, stage.tries) == (target, face, 1)
        own_x = rotation_matrices(stage.state.pose[target, 3:])[:, 0]
        np.testing.assert_allclose((2 * face - 1) * own_x, [-1, 0, 0], atol=0.02)
        np.testing.assert_allclose(stage.state.pose[:, 2], heights)
        between = stage.state.pose[:, None, :3] - stage.state.pose[None, :, :3]
        np.testing.assert_allclose(np.linalg.norm(between, axis=-1), apart, atol=1e-12)
        assert stage.blocks is state.blocks
