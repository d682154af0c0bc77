import msgspec
import pytest

from jenga_data.dataset.convert import convert
from jenga_data.dataset.diff import diff
from jenga_data.dataset.drop import drop
from jenga_data.dataset.manifest import load_manifest
from jenga_data.dataset.merge import merge
from jenga_data.errors import JengaError
from jenga_data.outcome import Outcome


def test_a_dataset_equals_itself_and_what_its_logs_make_again(dynamics, extraction_logs, tmp_path):
    convert([extraction_logs], tmp_path / "again", "test-dynamics", "1.0.0")
    found = diff(dynamics, tmp_path / "again")
    assert found.equal
    assert (found.same, found.fields, found.differ, found.moved, found.only) == (11, {}, {}, {}, ([], []))
    assert found.text() == "test-dynamics@1.0.0 and test-dynamics@1.0.0 are equal: 11 episodes in 2 files"


def test_another_name_alone_makes_a_difference_in_the_manifest(made, tmp_path):
    a = made("a", range(4))
    convert([tmp_path / "a-logs"], tmp_path / "b", "b", "1.0.0", description="mine")
    found = diff(a, tmp_path / "b")
    assert not found.equal
    assert found.fields.keys() == {"name", "description"}
    assert found.fields["name"] == ("a", "b")
    assert found.files[1:] == ([], [])
    assert len(found.files[0]) == 2


def test_episodes_and_files_of_one_alone_are_named(made, tmp_path):
    a, b = made("a", [0, 1, 2, 128, 129]), made("b", [1, 2, 3, 128, 129])
    found = diff(a, b)
    assert found.only == (["selection-0000"], ["selection-0003"])
    assert found.same == 4
    assert [path[:19] for path in found.files[0]] == ["data/s0000007-n0000"]
    assert [len(paths) for paths in found.files] == [1, 2, 2]
    assert found.fields["provenance.recipes"][1][0]["numbers"] == [(1, 3), (128, 129)]


def test_towers_that_changed_sides_are_named(made, tmp_path):
    a = made("a", range(3))
    b = made("b", range(128, 136))
    edited = merge([a, b], tmp_path / "out", "all", "1.0.0")
    assert diff(a, tmp_path / "out").moved == edited.moved
    assert edited.moved


def test_columns_in_which_episodes_differ_are_named(dynamics, forge):
    def nudged(values):
        values[-1, 0] += 1e-6
        return values

    found = diff(dynamics, forge(dynamics, action=nudged))
    last = "extraction-0010"
    assert found.differ == {last: ["action"]}
    assert found.same == 10
    assert f"  {last}: action" in found.text()


def test_edges_that_differ_are_told_from_rows_that_lie_elsewhere(dynamics, forge, tmp_path):
    """The rest of a file of which an episode was dropped is the same, whichever file it lies in."""
    drop(dynamics, tmp_path / "less", "1.1.0", episodes=["extraction-0001"])
    found = diff(dynamics, tmp_path / "less")
    assert (found.only, found.same, found.differ) == ((["extraction-0001"], []), 10, {})

    def first_edge(values):
        values[0] = 0.25
        return values

    assert diff(tmp_path / "less", forge(dynamics, edge_force=first_edge)).differ == {"extraction-0000": ["edge_force"]}


def test_another_log_of_an_episode_shows_in_the_columns_of_both_tables(made, episode_of, write, tmp_path):
    a = made("a", range(4))
    write(episode_of("selection", 2, Outcome.EXTRACTED), tmp_path / "b-logs")
    b = made("b", [0, 1, 3])
    (columns,) = diff(a, b).differ.values()
    assert {"log_sha256", "outcome", "failure", "clear_frame"} <= set(columns)
    assert not {"tower", "block_pose", "kind"} & set(columns)


def test_the_report_is_plain_json(made):
    a, b = made("a", [0, 1, 2]), made("b", [1, 2, 3])
    found = msgspec.json.decode(msgspec.json.encode(diff(a, b).as_dict()))
    assert found["equal"] is False
    assert found["datasets"] == ["a@1.0.0", "b@1.0.0"]
    assert found["hashes"] == [load_manifest(folder).hash for folder in (a, b)]
    assert found["episodes"] == {"removed": ["selection-0000"], "added": ["selection-0003"], "same": 2, "differ": {}}
    assert [recipes[0]["numbers"] for recipes in found["manifest"]["provenance.recipes"]] == [[[0, 2]], [[1, 3]]]
    assert "counts.episodes" not in found["manifest"]


def test_long_sections_of_a_text_are_cut(made):
    text = diff(made("a", range(20)), made("b", range(20, 24))).text()
    assert "episodes only in a@1.0.0: 20\n  selection-0000\n" in text
    assert "  selection-0009\n  and 10 more; --json lists them\n" in text
    assert "selection-0010" not in text


def test_a_dataset_that_is_not_there_is_refused(selection, tmp_path):
    with pytest.raises(JengaError, match="no folder or dataset"):
        diff(selection, tmp_path / "none")
