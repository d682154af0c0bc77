"""A pull that heeds the fingers: what it does when they feel a rough step, and that it leaves a smooth one alone."""

from collections import deque
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from closed_loops import TARGET, tower

from jenga_control.extraction.closed_loop import StraightPull
from jenga_control.extraction.touch import SAMPLES, CarefulTouch, TouchConfig
from jenga_data.episode import GripperSample
from jenga_data.errors import JengaError

SMOOTH, ROUGH = np.zeros(SAMPLES), np.tile([0.0, 10.0], SAMPLES)[:SAMPLES]


class Felt:
    """A careful straight pull whose fingers feel what they are told."""

    def __init__(self, config: TouchConfig | None = None, speed: float = 0.25) -> None:
        self.felt: deque[GripperSample] = deque(maxlen=64)
        self.pull = CarefulTouch(StraightPull(speed), config or TouchConfig())
        view: Any = SimpleNamespace(recording=SimpleNamespace(felt=self.felt))
        self.pull._view = view

    def step(self, force: np.ndarray) -> np.ndarray:
        for along in force:
            time = 4_000_000 * len(self.felt)
            vector = np.array([along, 15.0, 0.0])
            self.felt.append(GripperSample(time, np.zeros(7), 0.025, vector, -vector))
        return self.pull.act(tower(), TARGET)


def test_a_smooth_step_is_left_alone():
    felt = Felt()
    for _ in range(3):
        np.testing.assert_array_equal(felt.step(SMOOTH), [-0.008, 0.0, 0.0])


def test_a_rough_step_slows_down_and_a_smooth_one_sets_free_again():
    felt = Felt()
    np.testing.assert_allclose(felt.step(ROUGH), [-0.004, 0.0, 0.0])
    np.testing.assert_array_equal(felt.pull.wanted, [-0.008, 0.0, 0.0])
    np.testing.assert_allclose(felt.step(SMOOTH), [-0.008, 0.0, 0.0])


def test_a_pull_is_not_slowed_to_a_stop():
    np.testing.assert_allclose(Felt(speed=0.04).step(ROUGH), [-0.001, 0.0, 0.0])
    np.testing.assert_allclose(Felt(speed=0.02).step(ROUGH), [-0.00064, 0.0, 0.0])


def test_what_is_rough_for_a_slow_pull_is_not_for_a_fast_one():
    """10 N to and fro are 3,536 N/s; 5 N half of it."""
    half = ROUGH / 2
    np.testing.assert_allclose(Felt(speed=0.125).step(half), [-0.002, 0.0, 0.0])
    np.testing.assert_array_equal(Felt(speed=0.25).step(half), [-0.008, 0.0, 0.0])


def test_it_wiggles_when_it_stays_rough_and_gives_up_in_the_end():
    felt = Felt(TouchConfig(patience=5))
    sides = [felt.step(ROUGH)[1] for _ in range(4)]
    np.testing.assert_allclose(sides, [0.0, -0.0003, 0.0003, -0.0003])
    np.testing.assert_array_equal(felt.step(ROUGH), np.zeros(3))


def test_before_anything_was_felt_it_pulls():
    pull = CarefulTouch(StraightPull(0.25), TouchConfig())
    np.testing.assert_array_equal(pull.act(tower(), TARGET), [-0.008, 0.0, 0.0])


@pytest.mark.parametrize("change", [{"rough": 0.0}, {"slow": 1.5}, {"patience": -1}, {"wiggle": -1e-3}])
def test_settings_that_cannot_be_are_refused(change):
    with pytest.raises(JengaError, match="allowed"):
        TouchConfig(**change)
