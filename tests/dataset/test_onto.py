import msgspec
import pytest

from jenga_data.dataset.convert import convert
from jenga_data.dataset.manifest import MANIFEST, canonical_bytes, load_manifest, sealed
from jenga_data.dataset.onto import convert_onto
from jenga_data.errors import JengaError
from jenga_data.outcome import Outcome


@pytest.mark.parametrize(("kind", "workers"), [("selection", 2), ("extraction", 1)])
def test_new_logs_leave_every_old_file_as_it_is(made, logs_of, rows_in, whole, tmp_path, kind, workers):
    """The file of the numbers from 0 on is not full, and more of these numbers come."""
    old = made("old", [*range(4), 20], kind, invalid=[20])
    more = logs_of("more", [4, 5, 21, 128, 129], kind, invalid=[21])
    edited = convert_onto(old, [more], tmp_path / "out", "old", "1.1.0", workers=workers)
    fresh = convert([old.with_name("old-logs"), more], tmp_path / "all", "all", "1.0.0")
    for file in load_manifest(old).data_files:
        assert (tmp_path / "out" / file.path).samefile(old / file.path)
    assert (edited.taken, edited.written) == (1, 2)
    assert rows_in(tmp_path / "out").equals(rows_in(tmp_path / "all"))
    manifest = edited.manifest
    assert manifest.counts == fresh.counts
    assert manifest.splits == fresh.splits
    assert manifest.provenance == fresh.provenance
    assert [p.hash for p in manifest.parents] == [load_manifest(old).hash]
    assert whole(tmp_path / "out")


def test_logs_that_it_holds_are_skipped(made, logs_of, tmp_path):
    old = made("old", [*range(4), 20], invalid=[20])
    again = logs_of("again", [2, 3, 20, 130], invalid=[20])
    edited = convert_onto(old, [again], tmp_path / "out", "old", "1.1.0")
    assert (edited.copies, edited.manifest.counts.episodes, edited.manifest.counts.invalid) == (3, 5, 1)


def test_more_broken_episodes_alone_are_new_too(made, logs_of, whole, tmp_path):
    edited = convert_onto(made("old", range(4)), [logs_of("more", [9], invalid=[9])], tmp_path / "out", "old", "1.1.0")
    assert (edited.manifest.counts.episodes, edited.manifest.counts.invalid) == (4, 1)
    assert whole(tmp_path / "out")


@pytest.mark.parametrize(("licence", "expected"), [(None, "CC-BY-4.0"), ("CC0-1.0", "CC0-1.0")])
def test_the_licence_is_that_of_the_dataset_or_the_one_named(made, logs_of, tmp_path, licence, expected):
    old, more = made("old", range(4)), logs_of("more", [4])
    edited = convert_onto(old, [more], tmp_path / "out", "old", "1.1.0", licence=licence)
    assert edited.manifest.licence == expected


def refusal(onto, logs, out) -> str:
    with pytest.raises(JengaError) as caught:
        convert_onto(onto, [logs], out, "old", "1.1.0")
    assert not out.exists()
    return str(caught.value)


def test_nothing_new_is_refused(made, logs_of, tmp_path):
    old = made("old", [*range(4), 9], invalid=[9])
    assert "holds all 5 logs already: nothing to add" in refusal(old, old.with_name("old-logs"), tmp_path / "out")


def test_a_log_that_contradicts_the_dataset_is_refused(made, logs_of, episode_of, write, tmp_path):
    old = made("old", [*range(4), 9], invalid=[9])
    other = tmp_path / "other"
    write(episode_of("selection", 3, Outcome.COLLAPSED), other)
    assert "is episode selection-0003, which old@1.0.0 has of another log" in refusal(old, other, tmp_path / "out")
    whole_now = logs_of("whole", [9])
    assert "old@1.0.0 has of one with broken physics" in refusal(old, whole_now, tmp_path / "out")
    broken_now = logs_of("broken", [2], invalid=[2])
    assert "is episode selection-0002, which old@1.0.0 has of another log" in refusal(old, broken_now, tmp_path / "out")


def test_logs_of_another_kind_are_refused(made, logs_of, tmp_path):
    message = refusal(made("old", range(4)), logs_of("more", range(3), "extraction"), tmp_path / "out")
    assert "the logs make dynamics of 6 blocks, old@1.0.0 is selection of 6 blocks" in message


def test_a_dataset_of_other_thresholds_is_refused(made, logs_of, tmp_path):
    old = made("old", range(4))
    manifest = load_manifest(old)
    labels = [msgspec.structs.replace(la, thresholds=dict.fromkeys(la.thresholds, 0.5)) for la in manifest.labels]
    (old / MANIFEST).write_bytes(canonical_bytes(sealed(msgspec.structs.replace(manifest, labels=labels))))
    assert "{'drop': 0.5} in old@1.0.0 and {'drop': 0.0075} in this jenga" in refusal(
        old, logs_of("more", [5]), tmp_path / "out"
    )
