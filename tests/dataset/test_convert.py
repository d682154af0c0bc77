import logging
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jenga_data.dataset import staging
from jenga_data.dataset.convert import convert
from jenga_data.dataset.manifest import load_manifest
from jenga_data.dataset.read import open_dataset
from jenga_data.dataset.shards import EPISODES_A_SHARD
from jenga_data.dataset.sources import read_sources
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.outcome import Outcome


def content(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture
def two_folders(selection_logs, tmp_path) -> list[Path]:
    """The same logs under other names, spread over two folders."""
    for i, path in enumerate(sorted(selection_logs.iterdir())):
        folder = tmp_path / ("one" if i % 2 else "two")
        folder.mkdir(exist_ok=True)
        shutil.copy(path, folder / f"{99 - i}.mcap")
    return [tmp_path / "one", tmp_path / "two"]


def test_converting_twice_gives_the_same_bytes(extraction_logs, dynamics, tmp_path):
    convert([extraction_logs], tmp_path / "again", "test-dynamics", "1.0.0")
    assert content(tmp_path / "again") == content(dynamics)


def test_the_order_of_the_logs_does_not_matter(two_folders, selection, tmp_path):
    convert(two_folders, tmp_path / "a", "test-selection", "1.0.0")
    convert(two_folders[::-1], tmp_path / "b", "test-selection", "1.0.0")
    assert content(tmp_path / "a") == content(tmp_path / "b") == content(selection)


def test_collections_are_told_apart_whatever_folder_they_lie_in(two_seeds, tmp_path):
    manifest = convert(two_seeds, tmp_path / "a", "a", "1.0.0")
    convert(two_seeds[::-1], tmp_path / "b", "a", "1.0.0")
    assert content(tmp_path / "a") == content(tmp_path / "b")
    recipes = {r.seed: r.numbers for r in manifest.provenance.recipes}
    assert recipes == {7: [(0, 0), (2, 2), (4, 4), (6, 6)], 8: [(1, 1), (3, 3), (5, 5), (7, 7)]}
    assert len(manifest.data_files) == 2


def test_copies_count_once_and_it_says_so(selection_logs, two_folders, selection, tmp_path, caplog):
    with caplog.at_level(logging.WARNING):
        convert([selection_logs, *two_folders], tmp_path / "out", "test-selection", "1.0.0")
    assert "24 of 48 logs are copies" in caplog.text
    assert content(tmp_path / "out") == content(selection)


def test_predictions_beside_the_episodes_are_no_logs(selection_logs, selection, tmp_path):
    shutil.copytree(selection_logs, tmp_path / "logs")
    (tmp_path / "logs" / "selection-0000.one_step-abc.prediction.mcap").write_bytes(b"nothing")
    convert([tmp_path / "logs"], tmp_path / "out", "test-selection", "1.0.0")
    assert content(tmp_path / "out") == content(selection)


def test_neither_host_nor_time_nor_path_gets_in(dataset_folder, selection_logs, extraction_logs):
    for name, data in content(dataset_folder).items():
        for secret in (b"secret-host", b"noon", str(selection_logs).encode(), str(extraction_logs).encode()):
            assert secret not in data, name


def test_new_logs_leave_the_files_of_old_ones_as_they_are(selection_logs, selection, episode_of, write, tmp_path):
    more = tmp_path / "more"
    for number in (EPISODES_A_SHARD, EPISODES_A_SHARD + 5):
        write(episode_of("selection", number), more)
    convert([selection_logs, more], tmp_path / "out", "test-selection", "1.1.0")
    before, after = load_manifest(selection), load_manifest(tmp_path / "out")
    assert set(before.data_files) < set(after.data_files)
    assert len(after.data_files) == 2


def test_episodes_with_broken_physics_are_counted_and_in_no_file(dynamics):
    dataset = open_dataset(dynamics)
    assert dataset.manifest.counts.invalid == 1
    assert dataset.manifest.counts.outcome == {"collapsed": 3, "extracted": 4, "stuck": 4}
    assert "extraction-0011" not in {*dataset.column("episode"), *dataset.episodes()["episode"]}
    assert dataset.manifest.provenance.recipes[0].numbers == [(0, 11)]


def test_provenance_tells_how_to_make_it_again(selection):
    provenance = load_manifest(selection).provenance
    recipe = provenance.recipes[0]
    assert (recipe.seed, recipe.numbers) == (7, [(0, 23)])
    assert provenance.configs[recipe.config] == {"rounds": [1, 15], "physics": {"friction": 0.35}}
    assert provenance.commits == ["abc"]
    assert provenance.versions == {"mujoco_version": ["4.0.0"]}


def test_an_output_that_exists_is_refused(selection_logs, tmp_path):
    (tmp_path / "out").mkdir()
    with pytest.raises(JengaError, match="out exists"):
        convert([selection_logs], tmp_path / "out", "a", "1.0.0")


@pytest.mark.parametrize(("name", "version"), [("A", "1.0.0"), ("a@b", "1.0.0"), ("../a", "1.0.0"), ("a", "1.0")])
def test_bad_names_and_versions_are_refused(selection_logs, tmp_path, name, version):
    with pytest.raises(JengaError, match=r"bad (dataset name|version)"):
        convert([selection_logs], tmp_path / "out", name, version)


def refusal(logs: list[Path], out: Path) -> str:
    """The message that converting gives; nothing may be left beside `out`."""
    before = set(out.parent.iterdir())
    with pytest.raises(JengaError) as caught:
        convert(logs, out, "a", "1.0.0")
    assert set(out.parent.iterdir()) == before
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_no_logs_are_refused(tmp_path):
    assert "no such folder" in refusal([tmp_path / "none"], tmp_path / "out")
    (tmp_path / "empty").mkdir()
    assert "no log (*.mcap)" in refusal([tmp_path / "empty"], tmp_path / "out")


def test_kinds_and_sizes_are_not_mixed(selection_logs, extraction_logs, tmp_path):
    message = refusal([selection_logs, extraction_logs], tmp_path / "out")
    assert "extraction of 6 blocks" in message
    assert "selection of 6 blocks" in message


def test_an_unfinished_log_is_refused_with_the_way_out(selection_logs, episode_of, write, tmp_path):
    write(replace(episode_of("selection", 99), result=None), tmp_path / "logs")
    message = refusal([selection_logs, tmp_path / "logs"], tmp_path / "out")
    assert "selection-0099.mcap.partial never finished" in message
    assert "jenga log recover" in message


def test_a_log_without_outcome_is_refused_with_the_way_out(episode_of, write, tmp_path):
    path = write(replace(episode_of("selection", 99), result=None), tmp_path / "logs")
    whole = write(episode_of("selection", 99), tmp_path / "whole").read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    path.with_name(path.name + ".partial").unlink()
    assert "jenga log recover" in refusal([tmp_path / "logs"], tmp_path / "out")


def test_a_damaged_log_is_refused_with_the_way_out(episode_of, write, tmp_path):
    path = [write(episode_of("selection", number), tmp_path / "logs") for number in range(4)][-1]
    data = bytearray(path.read_bytes())
    at = data.find(b"zstd", len(data) // 4) + 40
    data[at] ^= 1
    path.write_bytes(data)
    with pytest.raises(CheckFailed, match=r"jenga log (recover|doctor)"):
        convert([tmp_path / "logs"], tmp_path / "out", "a", "1.0.0")
    assert [p.name for p in tmp_path.iterdir()] == ["logs"]


def test_two_different_logs_of_one_episode_are_refused(selection_logs, episode_of, write, tmp_path):
    write(episode_of("selection", 3, Outcome.COLLAPSED), tmp_path / "logs")
    message = refusal([selection_logs, tmp_path / "logs"], tmp_path / "out")
    assert "two logs of episode selection-0003 differ" in message


def test_a_dataset_without_rows_is_refused(episode_of, write, tmp_path):
    for number in range(3):
        none = np.zeros((0, 3))
        episode = episode_of("extraction", number)
        empty = replace(episode, action_frame=np.zeros(0, np.int64), action=none, action_reached=none)
        write(empty, tmp_path / "logs")
    assert "0 rows" in refusal([tmp_path / "logs"], tmp_path / "out")


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")])
def test_an_interruption_leaves_nothing_behind(selection_logs, tmp_path, monkeypatch, error):
    def interrupted(*_: object) -> None:
        raise error

    monkeypatch.setattr("jenga_data.dataset.write.file_entry", interrupted)
    with pytest.raises((KeyboardInterrupt, JengaError)) as caught:
        convert([selection_logs], tmp_path / "out", "a", "1.0.0")
    assert list(tmp_path.iterdir()) == []
    if isinstance(error, OSError):
        assert "cannot write" in str(caught.value)
        assert "No space left" in str(caught.value)


def test_a_folder_that_appears_meanwhile_is_not_overwritten(tmp_path):
    with pytest.raises(JengaError, match="exists"), staging.new_folder(tmp_path / "out"):
        (tmp_path / "out").mkdir()
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("kind", ["selection", "extraction"])
def test_the_number_of_workers_changes_nothing(logs_of, tmp_path, kind):
    """Four files, more logs than one worker looks at at a time, in two orders."""
    folders = [logs_of(f"part{start}", range(start, start + 3), kind) for start in (0, 128, 256, 384)]
    convert(folders, tmp_path / "one", "a", "1.0.0", workers=1)
    convert(folders[::-1], tmp_path / "three", "a", "1.0.0", workers=3)
    assert len(list((tmp_path / "one" / "data").iterdir())) == 4
    assert content(tmp_path / "one") == content(tmp_path / "three")


def test_headers_are_the_same_whoever_reads_them(logs_of, tmp_path, monkeypatch):
    logs = [logs_of("some", range(7)), logs_of("copies", range(3, 9))]
    alone = read_sources(logs)
    monkeypatch.setattr("jenga_data.dataset.sources._LOGS_A_TASK", 2)
    assert read_sources(logs, workers=2) == alone
    assert len(alone.logs) == 9


@pytest.mark.parametrize("workers", [1, 2])
def test_a_damaged_log_is_named_by_any_worker(logs_of, tmp_path, workers):
    folders = [logs_of("whole", range(3)), logs_of("damaged", range(128, 131))]
    path = folders[1] / "selection-0129.mcap"
    data = bytearray(path.read_bytes())
    at = data.find(b"zstd", len(data) // 4) + 40
    data[at] ^= 1
    path.write_bytes(data)
    with pytest.raises(CheckFailed, match=r"selection-0129\.mcap.*jenga log (recover|doctor)"):
        convert(folders, tmp_path / "out", "a", "1.0.0", workers=workers)
    assert not (tmp_path / "out").exists()
    assert not list(tmp_path.glob(".*.partial"))


def test_no_workers_are_refused(selection_logs, tmp_path):
    with pytest.raises(JengaError, match="workers is 0; allowed: 1 or more"):
        convert([selection_logs], tmp_path / "out", "a", "1.0.0", workers=0)


MEGABYTES_AN_EPISODE = 4
PEAK = """
import re, sys
from pathlib import Path
from jenga_data.dataset.convert import convert

convert([Path(sys.argv[1])], Path(sys.argv[2]), "a", "1.0.0")
print(re.search(r"VmHWM: +([0-9]+) kB", Path("/proc/self/status").read_text().replace("\t", " "))[1])
"""
# Not getrusage: its peak is that of the process which started this one, if that was larger.


def peak_megabytes(logs: Path, out: Path) -> float:
    """Most memory that a process which converts these logs has held."""
    run = subprocess.run([sys.executable, "-c", PEAK, logs, out], capture_output=True, text=True, check=True)
    return int(run.stdout) / 1024


@pytest.mark.skipif(sys.platform != "linux", reason="reads the peak of a process from /proc")
def test_memory_does_not_grow_with_the_number_of_logs(episode_of, write, tmp_path):
    """Of 300 logs whose episodes would fill 1.2 GB, against 10 of them."""
    for number in range(300):
        episode = episode_of("selection", number)
        state = np.full((len(episode.pose), MEGABYTES_AN_EPISODE * 2**20 // 8 // len(episode.pose)), float(number))
        write(replace(episode, sim_state=state), tmp_path / "logs" / ("few" if number < 10 else "many"))
    few = peak_megabytes(tmp_path / "logs" / "few", tmp_path / "few")
    many = peak_megabytes(tmp_path / "logs", tmp_path / "many")
    assert many - few < 20 * MEGABYTES_AN_EPISODE
    assert many < 1024
