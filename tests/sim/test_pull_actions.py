"""T actions of a pull, by a hand that does what it is told on a tower that does not fall."""

from collections.abc import Callable

import numpy as np
import pytest
from puppet import STEPS, Stage
from short_tower import EXTRACTION

from jenga_data.collect.extraction import Hand, Policy, Pull, RandomPull
from jenga_data.errors import UnreachableError

OUT = 0.08
"""Pulled by so much the target is clear of the puppet's tower [m]: a little more than a block is long."""


class TakingHand:
    """Takes the target along, and stops where its reach ends."""

    def __init__(self, stage: Stage, reach: float = 10.0, grip: float = 1.0) -> None:
        self.stage, self.reach, self.grip = stage, reach, grip
        self.position = stage.world.pose[stage.target, :3]
        self.begun: list[np.ndarray] = []

    def begin(self, displacement: np.ndarray) -> None:
        if len(self.begun) * 0.02 > self.reach:
            raise UnreachableError("too far")
        self.begun.append(displacement)
        self.position = self.position + displacement
        self.stage.move(self.stage.target, *(self.grip * displacement))


class Steady:
    """A controller that always wants the same."""

    def __init__(self, *action: float) -> None:
        self.action, self.asked = np.array(action), 0

    def act(self, state, target) -> np.ndarray:
        self.asked += 1
        return self.action


def pull(stage: Stage, hand: TakingHand, policy: Policy, all_actions: bool, step: Callable[[int], None] | None = None):
    run = Pull(policy, all_actions)
    return run.run(stage.recording, hand, step or (lambda _: stage.world.step()), STEPS)


def x_of(stage: Stage) -> np.ndarray:
    return np.array([action.displacement[0] for action in stage.kept.actions])


def test_the_hands_here_are_hands():
    assert isinstance(TakingHand(Stage()), Hand)


@pytest.mark.parametrize("seed", range(6))
def test_a_random_pull_makes_all_its_actions_and_rests_once_the_target_is_clear(seed):
    stage = Stage()
    hand, policy = TakingHand(stage), RandomPull(EXTRACTION, np.random.default_rng(seed))
    cause = pull(stage, hand, policy, all_actions=True)
    x = x_of(stage)
    assert len(x) == 51
    assert [action.frame for action in stage.kept.actions] == list(range(51))
    assert (np.abs(np.diff(x, prepend=0.0)) <= 0.013 + 1e-15).all()
    gone = -np.cumsum(x)
    if gone[-1] < OUT:
        assert cause == "out_of_time"
        assert (x < 0).all()
        return
    assert cause == ""
    clear = stage.recording.clear_frame()
    away = int(np.argmax(gone > gone[clear - 1] + 0.05)) + 1 if gone[-1] > gone[clear - 1] + 0.05 else len(x)
    assert (x[:away] < 0).all()
    assert not x[away + 2 :].any()
    if away + 2 < len(x):
        assert not any(action.displacement.any() for action in stage.kept.actions[away + 2 :])


def test_fast_and_slow_random_pulls_end_differently():
    """Or the test above would look at one kind alone."""
    causes = set()
    for seed in range(6):
        stage = Stage()
        causes.add(pull(stage, TakingHand(stage), RandomPull(EXTRACTION, np.random.default_rng(seed)), True))
    assert causes == {"", "out_of_time"}


def test_a_controller_stops_when_nothing_can_fall_onto_the_target_any_more():
    stage = Stage()
    policy = Steady(-0.01, 0.0, 0.0)
    assert pull(stage, TakingHand(stage), policy, all_actions=False) == ""
    assert len(stage.kept.actions) == policy.asked < 20
    assert 0.05 < stage.recording.distance_clear() < 0.061


def test_a_step_from_one_action_to_the_next_is_what_the_arm_can_make():
    stage = Stage()
    pull(stage, TakingHand(stage), Steady(-0.02, 0.005, -0.005), all_actions=True)
    x = x_of(stage)
    np.testing.assert_allclose(x[:3], [-0.013, -0.02, -0.02])
    np.testing.assert_allclose(stage.kept.actions[0].displacement[1:], [0.001, -0.001])
    still = int(np.flatnonzero(x)[-1]) + 1
    assert 5 < still < 15
    np.testing.assert_allclose(x[still - 2 : still + 1], [-0.02, -0.007, 0.0])


def test_what_the_hand_reached_is_logged_beside_what_was_commanded():
    stage = Stage()
    pull(stage, TakingHand(stage), Steady(-0.003, 0.0005, 0.0), all_actions=True)
    for action in stage.kept.actions:
        np.testing.assert_allclose(action.reached, action.displacement, atol=1e-12)


def test_a_target_that_stays_behind_has_slipped():
    stage = Stage()
    assert pull(stage, TakingHand(stage, grip=0.5), Steady(-0.003, 0.0, 0.0), all_actions=True) == "slipped"


def test_a_pull_that_ends_within_the_tower_is_out_of_time():
    stage = Stage()
    assert pull(stage, TakingHand(stage), Steady(-0.001, 0.0, 0.0), all_actions=True) == "out_of_time"


def test_an_action_that_leads_out_of_reach_is_not_logged():
    stage = Stage()
    assert pull(stage, TakingHand(stage, reach=0.1), Steady(-0.001, 0.0, 0.0), all_actions=True) == "out_of_reach"
    assert len(stage.kept.actions) == 6


def test_a_tower_that_falls_ends_the_pull():
    stage = Stage()

    def falls(i: int) -> None:
        stage.world.step()
        if stage.recording.frame == 4 and i == 0:
            stage.move(int(stage.world.layout.grid[3, 0]), 0, 0, -0.05)

    assert pull(stage, TakingHand(stage), Steady(-0.001, 0.0, 0.0), True, falls) == ""
    assert len(stage.kept.actions) == 5


class Proposing(Steady):
    """Keeps to narrower limits than the arm, and says what it would have liked."""

    wanted = np.array([-0.003, 0.015, 0.0])


def test_what_a_policy_wanted_is_logged_where_it_was_put_on_a_limit():
    stage = Stage()
    pull(stage, TakingHand(stage), Steady(-0.02, 0.005, 0.0), all_actions=False)
    assert all(np.array_equal(np.asarray(action.wanted), [-0.02, 0.005, 0.0]) for action in stage.kept.actions)
    plain = Stage()
    pull(plain, TakingHand(plain), Steady(-0.01, 0.0005, 0.0), all_actions=False)
    assert all(action.wanted is None for action in plain.kept.actions)
    proposed = Stage()
    pull(proposed, TakingHand(proposed), Proposing(-0.003, 0.001, 0.0), all_actions=False)
    assert all(np.array_equal(np.asarray(action.wanted), Proposing.wanted) for action in proposed.kept.actions)
    assert proposed.kept.actions[0].displacement[1] == 0.001


def test_a_policy_that_looks_on_is_shown_the_world_once():
    class Looking(Steady):
        seen: list = []  # noqa: RUF012

        def enter(self, view) -> None:
            self.seen.append((view.recording, view.hand, view.steps))

    stage = Stage()
    hand = TakingHand(stage)
    pull(stage, hand, Looking(-0.01, 0.0, 0.0), all_actions=False)
    assert Looking.seen == [(stage.recording, hand, STEPS)]


def test_a_policy_that_finds_no_way_for_the_arm_ends_the_pull():
    class Lost(Steady):
        def act(self, state, target) -> np.ndarray:
            raise UnreachableError("the arm can make none of the plans")

    stage = Stage()
    assert pull(stage, TakingHand(stage), Lost(0.0), all_actions=False) == "out_of_reach"
    assert stage.kept.actions == []
