"""What replay plots, against laws that hold for any episode."""

import numpy as np
import pytest
from made_up_episode import TARGET, make_episode, make_prediction, random_quaternions

from jenga_data import palette
from jenga_data.episode import LEFT_FINGER, RIGHT_FINGER, TABLE, Episode
from jenga_data.errors import JengaError
from jenga_data.geometry import rotation_matrices
from jenga_data.replay import hand
from jenga_data.replay.contact_points import contact_points, graph_nodes
from jenga_data.replay.measures import (
    frames_without,
    largest_displacement_of_others,
    metres_per_newton,
    model_labels,
    moment,
    phase_name,
    position_error,
    round_scale,
    standing_still_error,
)


def test_the_truth_has_no_error_and_a_shift_is_its_length(episode: Episode) -> None:
    exact = make_prediction(episode, "m", "one_step", np.arange(5, 9), 0.0, 0)
    assert position_error(episode, exact).max() == 0
    exact.pose[..., :3] += [0.003, 0.0, -0.004]
    np.testing.assert_allclose(position_error(episode, exact), 0.005)


def test_standing_still_is_wrong_by_what_moved_since_the_prediction_began(episode: Episode) -> None:
    frames = np.arange(30, 40)
    one, many = (make_prediction(episode, "m", kind, frames, 0.0, 0) for kind in ("one_step", "open_loop"))
    step = 0.125 / 50  # the pull of the made-up episode
    np.testing.assert_allclose(standing_still_error(episode, one)[:, TARGET], step, rtol=0.01)
    np.testing.assert_allclose(standing_still_error(episode, many)[:, TARGET], step * np.arange(1, 11), rtol=0.01)


def test_the_target_does_not_count_among_the_others(episode: Episode) -> None:
    assert episode.result is not None
    assert largest_displacement_of_others(episode).max() == pytest.approx(episode.result.verdict.moved)


def test_the_phase_of_a_frame_is_the_last_one_begun(episode: Episode) -> None:
    assert [phase_name(episode, f) for f in (0, 11, 12, 69, 70)] == ["approach", "approach", "grasp", "pull", "hold"]


def test_a_drawing_of_a_prediction_goes_away_wherever_there_is_none(episode: Episode) -> None:
    prediction = make_prediction(episode, "m", "one_step", np.array([3, 4, 5, 9, 118, 119]), 0.0, 0)
    assert frames_without(episode, prediction).tolist() == [0, 6, 10]


def test_models_of_one_name_are_told_apart_by_their_checkpoint(episode: Episode) -> None:
    kinds = ("one_step", "open_loop", "one_step")
    same = [make_prediction(episode, "m", kind, np.arange(3), 0.0, 0) for kind in kinds]
    object.__setattr__(same[2], "checkpoint", "sha256:0123456789abcdef")
    labels = model_labels(same)
    assert labels[1] == "m open loop"
    assert labels[2] == "m one step 89abcdef"
    assert len(set(labels)) == 3


@pytest.mark.parametrize(
    ("value", "scale"), [(0.7, 1.0), (1.0, 1.0), (1.1, 2.0), (2.1, 5.0), (0.0051, 0.01), (0.2, 0.2), (730.0, 1000.0)]
)
def test_a_scale_ends_at_a_round_number(value: float, scale: float) -> None:
    assert round_scale(value) == pytest.approx(scale)


def test_arrows_fit_the_picture() -> None:
    force = np.random.default_rng(0).exponential(2.0, (1000, 3))
    length = np.linalg.norm(force, axis=1) * metres_per_newton(force)
    assert np.percentile(length, 95) <= 0.03
    assert np.percentile(length, 95) > 0.005


def test_blocks_touch_between_their_levels_and_fingers_at_the_sides_of_the_target(episode: Episode) -> None:
    contacts = contact_points(episode)
    early = contacts.frame == 0
    upper, point = contacts.first[early], contacts.point[early]
    height = episode.header.blocks.size[0, 2]
    np.testing.assert_allclose(point[:, 2], episode.pose[0, upper, 2] - height / 2, atol=1e-9)
    assert (np.abs(point[contacts.second[early] == TABLE, 2]) < 1e-9).all()
    for finger, side in ((LEFT_FINGER, 1), (RIGHT_FINGER, -1)):
        held = (contacts.second == finger) & (contacts.frame == 50)
        offset = contacts.point[held][0] - episode.pose[50, TARGET, :3]
        assert offset[1] == pytest.approx(side * 0.0125, abs=1e-3)
        assert offset[0] == pytest.approx(-0.0285, abs=5e-3)


def test_contacts_of_a_robot_without_a_track_are_left_out() -> None:
    with_robot, without = make_episode(frames=30), make_episode(frames=30, robot=False)
    mixed = type(without)(**{**vars(without), "contacts": with_robot.contacts})
    assert set(contact_points(mixed).second[contact_points(mixed).second < 0]) == {TABLE}


def test_each_body_has_its_own_node(episode: Episode) -> None:
    contacts = contact_points(episode)
    nodes = graph_nodes(episode, contacts)
    assert nodes.name[-3:] == ["table", "left", "right"]
    assert [nodes.name[nodes.row[b]] for b in (0, 53, TABLE, LEFT_FINGER, RIGHT_FINGER)] == [
        "0", "53", "table", "left", "right",
    ]  # fmt: skip
    assert len({tuple(p) for p in nodes.position.tolist()}) == len(nodes.name)


def test_the_hand_moves_with_its_frame_and_opens_by_its_width() -> None:
    rng = np.random.default_rng(0)
    pose = np.concatenate([rng.normal(size=(4, 3)), random_quaternions(rng, 4)], axis=1)
    width = np.array([0.0, 0.01, 0.02, 0.05])
    boxes = hand.hand_poses(pose, width)
    to_hand = np.swapaxes(rotation_matrices(pose[:, 3:]), -1, -2)
    local = np.einsum("nij,nbj->nbi", to_hand, boxes[..., :3] - pose[:, None, :3])
    left, right = (local[:, row, 1] for row in (hand.LEFT_PAD, hand.RIGHT_PAD))
    thickness = hand.SIZE[hand.LEFT_PAD, 1]
    np.testing.assert_allclose(left - right - thickness, width, atol=1e-12)
    assert (local[:, hand.PALM, 0] < 0).all()


def test_colour_scales_run_from_light_to_dark_and_say_when_they_do_not_know() -> None:
    error = palette.error_colours(np.linspace(0, 1, 9), 1.0).sum(axis=-1)
    assert (np.diff(error) < 0).all()
    np.testing.assert_allclose(palette.error_colours(np.array([5.0]), 1.0), palette.error_colours(np.array([1.0]), 1.0))
    chance = palette.probability_colours(np.array([0.0, 1.0, np.nan]))
    np.testing.assert_allclose(chance, [palette.SKY_BLUE, palette.FAILURE, palette.UNKNOWN])


def test_signal_colours_differ_in_brightness_from_wood_for_every_eye() -> None:
    """Relative luminance, which no colour blindness takes away."""

    def luminance(colour: np.ndarray) -> np.ndarray:
        return (np.asarray(colour) ** 2.2) @ [0.2126, 0.7152, 0.0722]

    tones = luminance(palette.wood(np.arange(18).repeat(3)))
    assert tones.min() > 2 * luminance(np.array(palette.TARGET))
    np.testing.assert_array_equal(palette.wood(np.arange(6)), palette.wood(np.arange(6)))


def test_a_moment_is_a_time_or_that_of_a_frame(episode: Episode) -> None:
    since = (episode.time_ns - episode.time_ns[0]) * 1e-9
    assert moment(episode, None, None) == 0
    assert moment(episode, 1.5, None) == 1.5
    for frame in (0, 7, len(since) - 1):
        assert moment(episode, None, frame) == pytest.approx(since[frame])


@pytest.mark.parametrize(
    ("time", "frame", "says"),
    [
        (1.0, 2, "--time and --frame exclude each other"),
        (None, -1, "--frame is -1; episode .* has frames 0 to "),
        (None, 10_000, "--frame is 10000; episode .* has frames 0 to "),
        (-0.1, None, "--time is -0.1; episode .* goes from 0 to "),
        (float("nan"), None, "--time is nan"),
        (1e9, None, "--time is 1000000000.0"),
    ],
)
def test_a_moment_that_an_episode_does_not_have_is_refused(episode: Episode, time, frame, says) -> None:
    with pytest.raises(JengaError, match=says):
        moment(episode, time, frame)
