"""From a row back to its log and its moment: found by its bytes wherever it lies, made again where it is gone."""

import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from short_recordings import EXTRACTION, SEED, never, record
from short_towers import short_towers

from jenga_data.collect import rollout, workers
from jenga_data.dataset.logs_at_hand import find_log, log_folders
from jenga_data.dataset.read import open_dataset
from jenga_data.dataset.rows import in_steps
from jenga_data.dataset.schema import EPISODES, POSE_STEP
from jenga_data.dataset.trace import OUT, Trace, trace
from jenga_data.errors import JengaError
from jenga_data.log.files import file_sha256
from jenga_data.log.reader import read_episode

ROW = 20
"""Not of the first episode."""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dynamics dataset of three episodes, its logs beside it. Read only."""
    return record(EXTRACTION, tmp_path_factory.mktemp("recorded"))


@pytest.fixture
def logs(recorded: Path) -> Path:
    return recorded.parent / f"logs-{SEED}"


@pytest.fixture(autouse=True)
def alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """In an empty folder, without logs in known places; towers are short."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("JENGA_LOGS", raising=False)
    with short_towers():
        yield


@pytest.fixture
def no_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "run_one", never)


def test_a_row_is_traced_to_the_moment_that_it_shows(recorded, logs, no_simulation):
    dataset = open_dataset(recorded)
    for row in (0, ROW, len(dataset) - 1):
        found = trace(recorded, row, [logs])
        assert found.ok
        assert found.log.path is not None
        assert file_sha256(found.log.path) == found.moment.entry["log_sha256"]
        episode = read_episode(found.log.path)
        assert episode.header.key == dataset.column("episode")[row] == found.log.path.stem
        pose = in_steps(episode.pose[found.moment.frame], POSE_STEP)
        assert (pose.astype("float32") == dataset.column("block_pose")[row]).all()
        assert found.moment.time_s == pytest.approx((episode.time_ns - episode.time_ns[0])[found.moment.frame] * 1e-9)
        assert found.replay == f"jenga replay {found.log.path} --frame {found.moment.frame}"


def test_what_is_said_names_everything(recorded, logs, no_simulation):
    found = trace(recorded, ROW, [logs])
    entry = found.moment.entry
    wanted = [entry[name] for name in ("episode", "config", "seed", "number", "commit", "log_sha256", "log_bytes")]
    assert all(str(word) in found.text for word in [*wanted, f"frame {found.moment.frame}", found.replay])
    said = msgspec.json.decode(msgspec.json.encode(found.as_dict()))
    assert said["log"] | {"path": ""} == {
        "name": f"{entry['episode']}.mcap",
        "sha256": entry["log_sha256"],
        "bytes": entry["log_bytes"],
        "state": "found",
        "path": "",
        "same_bytes": True,
        "largest_difference": None,
        "notes": [],
    }
    assert (said["row"], said["frame"], said["seed"]) == (ROW, found.moment.frame, SEED)


def test_a_log_is_known_by_its_bytes_and_not_its_name(recorded, logs, no_simulation, tmp_path, monkeypatch):
    elsewhere = tmp_path / "a place" / "deep"
    elsewhere.mkdir(parents=True)
    for number, path in enumerate(logs.glob("*.mcap")):
        shutil.copy(path, elsewhere / f"{number}.mcap")
    monkeypatch.setenv("JENGA_LOGS", str(tmp_path / "a place"))
    found = trace(recorded, ROW)
    assert found.log.state == "found"
    assert shlex.split(found.replay)[2] == str(found.log.path)


@pytest.mark.parametrize("place", ["logs", "datasets_manifest/samples"])
def test_known_places_are_searched(place, tmp_path):
    (tmp_path / place).mkdir(parents=True)
    (tmp_path / place / "x.mcap").write_bytes(b"abc")
    digest = file_sha256(tmp_path / place / "x.mcap")
    assert find_log(log_folders(), "y.mcap", 3, digest).log == tmp_path / place / "x.mcap"
    assert find_log(log_folders(), "x.mcap", 3, "0" * 64).namesakes == [tmp_path / place / "x.mcap"]


def gone(recorded: Path, out: Path = OUT) -> Trace:
    return trace(recorded, ROW, out=out)


def test_a_log_that_is_not_at_hand_is_made_again_byte_for_byte(recorded, logs, tmp_path, monkeypatch):
    found = gone(recorded, out=tmp_path / "made")
    assert found.ok
    assert found.log.state == "made again"
    assert found.log.same_bytes
    assert found.log.differences == {}
    assert found.log.path is not None
    assert found.log.path.is_relative_to(tmp_path / "made")
    assert found.log.path.read_bytes() == (logs / found.moment.log_name).read_bytes()
    monkeypatch.setattr(workers, "run_one", never)
    assert gone(recorded, out=tmp_path / "made").log.path == found.log.path


def older(monkeypatch: pytest.MonkeyPatch) -> None:
    """Logs are written as by another commit."""
    known = rollout.provenance()
    monkeypatch.setattr(rollout, "provenance", lambda: known | {"git_commit": "older"})


def test_another_commit_writes_other_bytes_of_the_same_state(recorded, tmp_path, monkeypatch):
    older(monkeypatch)
    made = gone(recorded, out=tmp_path / "made")
    assert made.ok
    assert not made.log.same_bytes
    assert made.log.differences == {}
    assert "its bytes are others, its state is the same to the last bit" in made.text
    monkeypatch.setattr(workers, "run_one", never)
    found = trace(recorded, ROW, [tmp_path / "made"], tmp_path / "other")
    assert (found.log.state, found.log.path) == ("found a namesake", made.log.path)


def test_a_damaged_namesake_is_passed_over_and_named(recorded, logs, tmp_path):
    name = trace(recorded, ROW, [logs]).moment.log_name
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / name).write_bytes((logs / name).read_bytes()[:-100])
    found = gone(recorded)
    assert found.log.state == "made again"
    assert found.log.path is not None
    assert found.log.path.is_relative_to("runs/traced")
    assert str(tmp_path / "logs" / name) in found.text


def test_what_a_controller_pulled_cannot_be_made_again(recorded, forge, no_simulation):
    found = gone(forge(recorded, EPISODES, checkpoint=lambda v: v.astype("<U9") + "abcdef"))
    assert not found.ok
    assert found.log.path is None
    assert "a controller pulled with the model abcdef: only `jenga eval extraction` makes such a log" in found.text
    assert found.replay == f"jenga replay {found.moment.log_name} --frame {found.moment.frame}"


@pytest.mark.parametrize("row", [-1, 10**6])
def test_a_row_that_is_none_is_told_the_allowed_ones(recorded, row):
    last = len(open_dataset(recorded)) - 1
    with pytest.raises(JengaError, match=f"row is {row}; short@1.0.0 has rows 0 to {last}"):
        trace(recorded, row)


def test_a_folder_that_is_none_is_refused(recorded, tmp_path):
    with pytest.raises(JengaError, match="no such folder"):
        trace(recorded, 0, [tmp_path / "none"])
