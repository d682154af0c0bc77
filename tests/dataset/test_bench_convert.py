"""`jenga bench convert` on synthetic logs, and the quick way to a log's rows beside the whole one."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from jenga_data.dataset.rows import Ragged, rows_of
from jenga_data.dataset.schema import MOVED_STEP
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.log.excerpt import Excerpt, read_for_rows
from jenga_data.log.index import fingerprint
from jenga_data.log.reader import read_episode
from jenga_data.log.records import open_log


def assert_rows_of_the_whole(path: Path, part: Excerpt) -> None:
    whole = read_episode(path)
    assert part.frames == len(whole.pose)
    quick, slow = rows_of(part.episode, part.number), rows_of(whole)
    assert quick.keys() == slow.keys()
    for name, values in slow.items():
        other = quick[name]
        if isinstance(values, Ragged):
            assert isinstance(other, Ragged)
            assert np.array_equal(values.offset, other.offset)
            values, other = values.values, other.values
        assert np.array_equal(values, np.asarray(other)), name


def excerpt(path: Path, *, selection: bool) -> Excerpt:
    with open_log(path) as stream:
        intact = fingerprint(stream).intact
    found = read_for_rows(path, selection, intact).excerpt
    assert found is not None
    return found


@pytest.mark.parametrize("kind", ["selection", "extraction"])
def test_what_is_read_for_rows_gives_the_rows_of_the_whole_episode(kind, request):
    for path in sorted(request.getfixturevalue(f"{kind}_logs").glob("*.mcap"))[:4]:
        assert_rows_of_the_whole(path, excerpt(path, selection=kind == "selection"))


@pytest.fixture
def one_action(episode_of, write, tmp_path, monkeypatch) -> Path:
    """A log of many chunks whose only action is at frame 2 of 5."""
    monkeypatch.setattr("jenga_data.log.output.CHUNK_BYTES", 500)
    episode, at = episode_of("extraction", 1), slice(2, 3)
    kept = {name: getattr(episode, name)[at] for name in ("action_frame", "action", "action_reached")}
    return write(replace(episode, **kept), tmp_path)


def test_only_what_is_around_the_actions_is_read(one_action):
    part = excerpt(one_action, selection=False)
    assert part.number.tolist() == [0, 2, 3]
    assert part.episode.action_frame.tolist() == [1]
    assert 4 <= len(part.episode.gripper.time_ns) < len(read_episode(one_action).gripper.time_ns)
    assert_rows_of_the_whole(one_action, part)


def test_a_log_whose_times_do_not_lead_to_its_frames_is_read_whole(one_action, monkeypatch):
    monkeypatch.setattr("jenga_data.log.excerpt._MARGIN_NS", 0)
    part = excerpt(one_action, selection=False)
    assert part.number.tolist() == [0, 1, 2, 3, 4]
    assert_rows_of_the_whole(one_action, part)


def test_a_log_without_actions_is_not_read_whole(episode_of, write, tmp_path, monkeypatch):
    """As where the push failed: it makes no rows, however long it is."""
    monkeypatch.setattr("jenga_data.log.excerpt._whole", None)
    episode = episode_of("extraction", 1)
    none = {name: getattr(episode, name)[:0] for name in ("action_frame", "action", "action_reached")}
    part = excerpt(write(replace(episode, **none), tmp_path), selection=False)
    assert part.frames == len(episode.pose)
    assert not len(np.asarray(rows_of(part.episode, part.number)["frame"]))


def test_a_flipped_bit_in_what_no_row_needs_is_noticed(one_action: Path, tmp_path: Path):
    data = one_action.read_bytes()
    with one_action.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    path, unread = tmp_path / "bad.mcap", 0
    for chunk in summary.chunk_indexes:
        bad = bytearray(data)
        bad[chunk.chunk_start_offset + chunk.chunk_length - 5] ^= 1
        path.write_bytes(bad)
        with suppress(CheckFailed):  # of a chunk that is read: it has a checksum of its own
            unread += read_for_rows(path, selection=False, intact=True).excerpt is not None
        with pytest.raises(CheckFailed, match="is damaged at"):
            excerpt(path, selection=False)
    assert unread > 1


@pytest.mark.parametrize("kind", ["selection", "extraction"])
def test_both_sides_read_as_many_rows(kind, request):
    from jenga_models.bench.convert import bench_convert

    report = bench_convert([request.getfixturevalue(f"{kind}_logs")], rounds=1)
    invalid = 4 if kind == "extraction" else 0  # theirs takes the episode whose physics broke for good
    assert report["objects"] == report["rows"] + invalid
    for speed in (report[name] for name in ("convert", "one_worker", "workers")):
        assert speed["value"] > 0
        assert speed["ratio"] == pytest.approx(speed["value"] / speed["reference"])


@pytest.mark.parametrize("kind", ["selection", "extraction"])
def test_both_sides_make_the_same_rows(kind, request):
    from jenga_models.bench.convert import data_objects

    path = sorted(request.getfixturevalue(f"{kind}_logs").glob("*.mcap"))[0]
    rows, objects = rows_of(read_episode(path)), data_objects(path)
    names = {"pose": "block_pose", "twist": "block_twist", "reached": "action_reached"}
    own = {"x", "edge_index", "edge_attr"}
    for row, theirs in enumerate(objects):
        for name in theirs.keys():  # noqa: SIM118  (a Data object is no dict)
            if name not in own:
                ours = np.asarray(rows[names.get(name, name)])[row]
                if isinstance(ours, str | np.str_):
                    assert theirs[name] == ours
                else:
                    near = MOVED_STEP if name == "block_moved" else 1e-6
                    np.testing.assert_allclose(np.asarray(theirs[name]), ours, rtol=1e-5, atol=near, err_msg=name)
        assert theirs.edge_index is not None
        for name, values in {"edge_upper": theirs.edge_index[0], "edge_force": theirs.edge_attr}.items():
            ragged = rows[name]
            assert isinstance(ragged, Ragged)
            part = slice(*ragged.offset[row : row + 2])
            np.testing.assert_allclose(np.asarray(values), ragged.values[part], rtol=1e-5, atol=1e-4)
    assert rows.keys() - {names.get(name, name) for name in objects[0].keys()} == {  # noqa: SIM118
        *("block_size", "block_mass", "block_wedge", "level", "slot"),  # in x
        *("edge_upper", "edge_lower", "edge_force"),
    }


def test_rounds_are_at_least_one(selection_logs: Path):
    from jenga_models.bench.convert import bench_convert

    with pytest.raises(JengaError, match="rounds is 0; allowed: 1 and more"):
        bench_convert([selection_logs], rounds=0)
