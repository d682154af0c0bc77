import msgspec
import numpy as np
import pyarrow.parquet as pq
import pytest

from jenga_data.dataset.convert import convert
from jenga_data.dataset.drop import drop, matching
from jenga_data.dataset.manifest import load_manifest
from jenga_data.dataset.read import open_dataset
from jenga_data.errors import JengaError

NUMBERS = [*range(6), *range(128, 132)]
"""Two files."""


def bare(manifest) -> dict:
    """All that a manifest says of its content."""
    plain = msgspec.to_builtins(manifest)
    return {k: v for k, v in plain.items() if k not in ("name", "version", "hash", "parents")}


@pytest.mark.parametrize("kind", ["selection", "extraction"])
def test_dropping_is_converting_the_other_logs(made, logs_of, whole, tmp_path, kind):
    old = made("old", NUMBERS, kind)
    edited = drop(old, tmp_path / "out", "1.1.0", episodes=[f"{kind}-0002", f"{kind}-0005"])
    fresh = convert([logs_of("new", [n for n in NUMBERS if n not in (2, 5)], kind)], tmp_path / "new", "old", "1.1.0")
    assert bare(edited.manifest) == bare(fresh)  # the hash of every file among it
    assert edited.manifest.identifier == "old@1.1.0"
    assert [p.hash for p in edited.manifest.parents] == [load_manifest(old).hash]
    assert whole(tmp_path / "out")


def test_files_without_a_dropped_episode_stay_as_they_are(made, tmp_path):
    old = made("old", NUMBERS)
    edited = drop(old, tmp_path / "out", "1.1.0", episodes=["selection-0002"])
    untouched = load_manifest(old).data_files[1].path
    assert (edited.taken, edited.written) == (1, 1)
    assert (tmp_path / "out" / untouched).samefile(old / untouched)


def test_a_file_of_which_nothing_is_left_goes(made, whole, tmp_path):
    edited = drop(made("old", NUMBERS), tmp_path / "out", "1.1.0", conditions=["number >= 128"])
    assert (edited.taken, edited.written) == (1, 0)
    assert whole(tmp_path / "out")


def test_long_files_are_cut_where_they_would_have_been(episode_of, write, whole, tmp_path, monkeypatch):
    """More rows than a row group has."""
    monkeypatch.setattr("jenga_data.dataset.tables.ROWS_A_GROUP", 10)
    for number in range(12):
        write(episode_of("extraction", number), tmp_path / "logs" / ("gone" if number in (1, 7) else "left"))
    convert([tmp_path / "logs"], tmp_path / "old", "old", "1.0.0")
    edited = drop(tmp_path / "old", tmp_path / "out", "1.1.0", episodes=["extraction-0001", "extraction-0007"])
    fresh = convert([tmp_path / "logs" / "left"], tmp_path / "new", "old", "1.1.0")
    assert pq.ParquetFile(tmp_path / "out" / fresh.data_files[0].path).num_row_groups > 2
    assert bare(edited.manifest) == bare(fresh)


def test_broken_episodes_stay_in_the_recipe(made, tmp_path):
    old = made("old", [*range(6), 9], invalid=[9])
    manifest = drop(old, tmp_path / "out", "1.1.0", episodes=["selection-0002"]).manifest
    assert manifest.counts.invalid == 1
    assert [r.numbers for r in manifest.provenance.recipes] == [[(0, 1), (3, 5), (9, 9)]]
    assert manifest.provenance.commits == ["abc"]


@pytest.mark.parametrize(
    ("condition", "met"),
    [
        ("round > 2", lambda t: t["round"] > 2),
        ("round<=2", lambda t: t["round"] <= 2),
        ("outcome == stuck", lambda t: t["outcome"] == "stuck"),
        ("outcome == stuck, collapsed", lambda t: t["outcome"] != "extracted"),
        ("outcome != stuck", lambda t: t["outcome"] != "stuck"),
        ("dragged == true", lambda t: t["dragged"]),
        ("moved >= 0.003", lambda t: t["moved"] >= np.float32(0.003)),
        ("number == 1,3,128", lambda t: np.isin(t["number"], [1, 3, 128])),
        ("cause == ", lambda t: t["cause"] == ""),
    ],
)
def test_conditions_choose_by_a_column(selection, condition, met):
    table = open_dataset(selection).episodes()
    chosen = matching(table, condition)
    assert 0 < chosen.sum() < len(chosen)
    np.testing.assert_array_equal(chosen, met(table))


def test_all_conditions_must_be_met(made, tmp_path):
    edited = drop(made("old", NUMBERS), tmp_path / "out", "1.1.0", conditions=["round == 1", "number < 4"])
    left = open_dataset(tmp_path / "out").episodes()["number"].tolist()
    assert left == [n for n in NUMBERS if not (n % 3 == 0 and n < 4)]
    assert edited.manifest.counts.round == {"1": 1, "2": 3, "3": 4}


@pytest.mark.parametrize(
    ("condition", "says"),
    [
        ("round", "is no condition; allowed: COLUMN OP VALUE"),
        ("__import__('os')", "is no condition"),
        ("rounds > 3", "names no column of episodes; allowed: episode, kind, seed"),
        ("round > three", "compares round with 'three'; allowed: a whole number"),
        ("dragged == 1", "compares dragged with '1'; allowed: true or false"),
        ("moved < far", "compares moved with 'far'; allowed: a number"),
        ("outcome > stuck", "orders outcome, which is no number"),
        ("round > 99", "no episode has round > 99: nothing to drop"),
        ("round >= 1", "0 towers cannot be split"),
    ],
)
def test_conditions_that_choose_nothing_or_everything_are_refused(selection, tmp_path, condition, says):
    with pytest.raises(JengaError) as caught:
        drop(selection, tmp_path / "out", "1.1.0", conditions=[condition])
    assert says in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_unknown_episodes_and_two_ways_at_once_are_refused(selection, tmp_path):
    with pytest.raises(JengaError, match="1 of 2 keys name no episode, first nobody"):
        drop(selection, tmp_path / "out", "1.1.0", episodes=["selection-0001", "nobody"])
    with pytest.raises(JengaError, match="either by --episodes"):
        drop(selection, tmp_path / "out", "1.1.0", episodes=["selection-0001"], conditions=["round > 1"])
    with pytest.raises(JengaError, match="either by --episodes"):
        drop(selection, tmp_path / "out", "1.1.0")
    with pytest.raises(JengaError, match=r"1\.0\.0 is not above 1\.0\.0"):
        drop(selection, tmp_path / "out", "1.0.0", episodes=["selection-0001"])


def test_a_parent_may_be_dropped_from_again(made, whole, tmp_path):
    first = drop(made("old", NUMBERS), tmp_path / "one", "1.1.0", episodes=["selection-0002"]).manifest
    second = drop(tmp_path / "one", tmp_path / "two", "1.2.0", episodes=["selection-0004"]).manifest
    assert [p.hash for p in second.parents] == [first.hash]
    assert whole(tmp_path / "two")
