from dataclasses import replace

import numpy as np
import pytest

from jenga_data.dataset.rows import Ragged, edge_forces, rows_of, step_means
from jenga_data.dataset.schema import COLUMNS, POSE_STEP
from jenga_data.episode import TABLE, Contacts, Episode
from jenga_data.errors import JengaError
from jenga_data.graph import support_edges
from jenga_data.tower import Layout


def fixed(episode: Episode) -> dict[str, np.ndarray]:
    """The columns of fixed shape."""
    return {name: column for name, column in rows_of(episode).items() if isinstance(column, np.ndarray)}


@pytest.mark.parametrize(("kind", "dataset"), [("selection", "selection"), ("extraction", "dynamics")])
def test_rows_have_the_columns_of_the_schema(episode_of, kind, dataset):
    assert rows_of(episode_of(kind)).keys() == {c.name for c in COLUMNS[dataset]}


def test_a_selection_row_is_the_state_before_the_pull(episode_of):
    episode = episode_of("selection", 1)
    rows = fixed(episode)
    assert rows["frame"].tolist() == [0]
    np.testing.assert_allclose(rows["block_pose"][0], episode.pose[0], rtol=0, atol=POSE_STEP / 2)
    assert rows["outcome"].tolist() == ["stuck"]
    assert rows["failure"].tolist() == [True]


def test_a_dynamics_row_ends_where_the_next_begins(episode_of):
    rows = fixed(episode_of("extraction"))
    np.testing.assert_array_equal(rows["next_pose"][:-1], rows["block_pose"][1:])
    np.testing.assert_array_equal(rows["next_twist"][:-1], rows["block_twist"][1:])


def test_target_clear_starts_at_the_clear_frame(episode_of):
    assert fixed(episode_of("extraction", 0))["target_clear"].tolist() == [False, False, False, True]
    assert fixed(episode_of("extraction", 1))["target_clear"].tolist() == [False] * 4


def test_collapsed_is_about_the_next_frame_and_not_the_target(episode_of):
    episode = episode_of("extraction")
    pose = episode.pose.copy()
    pose[:, 1, 2] -= 0.1
    pose[3:, 5, 2] -= 0.008
    assert fixed(replace(episode, pose=pose))["collapsed"].tolist() == [False, False, True, True]


def test_edges_are_those_of_the_state_graph(episode_of):
    episode = episode_of("extraction")
    rows = rows_of(episode)
    upper, lower = rows["edge_upper"], rows["edge_lower"]
    assert isinstance(upper, Ragged)
    assert isinstance(lower, Ragged)
    for row, frame in enumerate(episode.action_frame):
        part = slice(upper.offset[row], upper.offset[row + 1])
        edges = support_edges(episode.pose[frame], episode.header.blocks.size)
        np.testing.assert_array_equal([upper.values[part], lower.values[part]], edges)


def test_edge_force_is_what_lifts_the_upper_block():
    contacts = Contacts(np.array([2, 0, 2, 1]), np.array([0, 2, 0, TABLE]), np.diag([0, 0, 1.0, 0])[:, :3] + 1.0)
    # Block 0 lifts block 2 with 1 + 2 N, and block 2 "lifts" block 0 with 1 N: 3 - 1 N in all.
    none = Contacts(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)))
    offset, upper, lower = np.array([0, 2, 2, 4]), np.array([2, 2, 2, 2]), np.array([0, 1, 0, 1])
    np.testing.assert_allclose(edge_forces([contacts, contacts, none], offset, upper, lower, 3), [2.0, 0.0, 0.0, 0.0])


def test_step_means_take_what_comes_after_the_start():
    values = np.arange(1.0, 6.0)[:, None] * [1, 10, 100]
    means = step_means(np.array([0, 1, 2, 3, 9]), values, np.array([0, 2, 4]), np.array([2, 4, 6]))
    np.testing.assert_allclose(means[:, 0], [2.5, 4.0, 0.0])


def test_step_means_do_not_depend_on_what_was_before():
    """An excerpt of an episode must give the rows of the whole, to the bit."""
    values = np.array([1e9, 0.1, 0.2])[:, None] * [1, 1, 1]
    time, start, end = np.arange(3), np.array([0]), np.array([2])
    whole, excerpt = step_means(time, values, start, end), step_means(time[1:], values[1:], start, end)
    assert whole.tolist() == excerpt.tolist()


_NO_FRAMES = {
    "time_ns": np.zeros(0, np.int64),
    "pose": np.zeros((0, 6, 7)),
    "twist": np.zeros((0, 6, 6)),
    "sim_state": np.zeros((0, 1)),
    "turntable": np.zeros(0),
    "contacts": [],
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"result": None}, "has no outcome"),
        ({"action_frame": np.array([1, 2, 3, 4])}, "between two of its 5 frames"),
        ({"action_frame": np.array([1, 1, 2, 3])}, "in order"),
        ({"pose": np.zeros((5, 4, 7)), "twist": np.zeros((5, 4, 6))}, "6 blocks"),
        (_NO_FRAMES, "has no frames"),
    ],
)
def test_episodes_that_contradict_themselves_are_refused(episode_of, change, message):
    with pytest.raises(JengaError, match=f"extraction-0000 .*{message}.*jenga log doctor"):
        rows_of(replace(episode_of("extraction"), **change))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "chess"}, "'chess'; allowed: selection, extraction"),
        ({"target": 6}, "has target 6"),
        ({"layout": Layout.fresh(np.arange(3))}, "3 of them in the layout"),
    ],
)
def test_headers_that_make_no_sense_are_refused(episode_of, change, message):
    episode = episode_of("extraction")
    with pytest.raises(JengaError, match=message):
        rows_of(replace(episode, header=replace(episode.header, **change)))
