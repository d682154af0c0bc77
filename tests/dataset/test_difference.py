import numpy as np
import pytest

from jenga_data.dataset.difference import as_stored, column_difference, largest, rows_difference
from jenga_data.dataset.rows import Ragged, rows_of

INF, NAN = float("inf"), float("nan")


@pytest.fixture
def rows(episode_of):
    return as_stored(rows_of(episode_of("extraction", 0)), "dynamics", 6)


def test_equal_rows_have_no_difference(rows, episode_of):
    assert rows_difference(rows, as_stored(rows_of(episode_of("extraction", 0)), "dynamics", 6)) == {}


@pytest.mark.parametrize(
    ("name", "at", "key"),
    [
        ("block_pose", (2, 3, 1), "block_pose.position"),
        ("next_pose", (0, 0, 6), "next_pose.quaternion"),
        ("block_twist", (1, 5, 2), "block_twist.linear"),
        ("next_twist", (1, 5, 3), "next_twist.angular"),
        ("action", (3, 0), "action"),
        ("left_force", (0, 2), "left_force"),
    ],
)
def test_the_largest_difference_of_one_number_is_found_in_either_direction(rows, name, at, key):
    changed = np.array(rows[name])
    changed[at] += 0.25
    for one, other in ((rows, rows | {name: changed}), (rows | {name: changed}, rows)):
        assert rows_difference(one, other) == {key: pytest.approx(0.25, rel=1e-5)}


def test_edges_of_one_side_only_are_counted_and_forces_compared_on_the_rest(rows):
    lower, force = rows["edge_lower"], rows["edge_force"]
    other = np.array(lower.values)
    other[0] = 5 - other[0]
    pulled = np.array(force.values)
    pulled[-1] += 2
    found = rows_difference(
        rows, rows | {"edge_lower": Ragged(lower.offset, other), "edge_force": Ragged(force.offset, pulled)}
    )
    assert found == {"edges": 2.0, "edge_force": pytest.approx(2.0, rel=1e-5)}


def test_rows_that_are_missing_are_counted_and_the_rest_compared(rows):
    kept = np.arange(len(rows["frame"])) < 3
    shorter = {name: column[kept] for name, column in rows.items()}
    assert rows_difference(rows, shorter) == {"rows": 1.0}
    assert rows_difference(shorter, rows) == {"rows": 1.0}


@pytest.mark.parametrize(
    ("one", "other", "difference"),
    [
        ([1, 2], [1, 4], 2),
        ([NAN, 1], [NAN, 1], 0),
        ([NAN, 1], [0, 1], INF),
        ([INF], [INF], 0),
        ([INF], [-INF], INF),
        ([], [], 0),
        ([True, False], [True, True], 0.5),
        (["a", "b", "c", "d"], ["a", "x", "c", "d"], 0.25),
    ],
)
def test_differences_of_columns(one, other, difference):
    assert column_difference(np.array(one), np.array(other)) == difference


def test_the_largest_of_many(rows):
    assert largest([{"a": 1.0}, {}, {"a": 3.0, "b": 2.0}]) == {"a": 3.0, "b": 2.0}
