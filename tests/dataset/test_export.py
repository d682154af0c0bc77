"""Exports, opened by the tools they are for."""

import json
import warnings
from pathlib import Path
from types import ModuleType
from typing import Any

import msgspec
import numpy as np
import pyarrow.parquet as pq
import pytest

from jenga_data.dataset.export.card import CARD, size_category
from jenga_data.dataset.export.croissant import CONFORMS_TO, CROISSANT
from jenga_data.dataset.export.lerobot import TASK
from jenga_data.dataset.export.run import FORMATS, export
from jenga_data.dataset.manifest import SPLITS, load_manifest
from jenga_data.dataset.read import Dataset, open_dataset
from jenga_data.errors import JengaError


def quietly_imported(name: str) -> ModuleType:
    """A library that is not ours, whose own warnings are not our errors."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pytest.importorskip(name, reason=f"{name} is not installed: pip install 'jenga[test]'")


@pytest.fixture
def offline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of the hub, and no cache but here."""
    for name in ("HF_HUB_OFFLINE", "HF_DATASETS_OFFLINE", "HF_HUB_DISABLE_TELEMETRY"):
        monkeypatch.setenv(name, "1")
    monkeypatch.setenv("HF_HOME", str(tmp_path / "hf"))


def contents(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize("form", ["croissant", "hf", "lerobot"])
def test_the_same_dataset_gives_the_same_bytes(dynamics, tmp_path, form):
    done = export(dynamics, tmp_path / "one", form)
    export(dynamics, tmp_path / "other", form)
    assert contents(tmp_path / "one") == contents(tmp_path / "other")
    assert done.files == sorted(contents(tmp_path / "one"))
    assert done.bytes == sum(map(len, contents(tmp_path / "one").values()))


def test_what_cannot_be_exported_is_refused_and_leaves_nothing(selection, tmp_path):
    with pytest.raises(JengaError, match=r"no format 'csv'; allowed: croissant, hf, lerobot"):
        export(selection, tmp_path / "out", "csv")
    with pytest.raises(JengaError, match="is a selection dataset, which has no actions for lerobot"):
        export(selection, tmp_path / "out", "lerobot")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "out").mkdir()
    with pytest.raises(JengaError, match="exists"):
        export(selection, tmp_path / "out", "hf")
    assert tuple(FORMATS) == ("croissant", "hf", "lerobot")


def loaded_croissant(folder: Path) -> Any:
    mlcroissant = quietly_imported("mlcroissant")
    return mlcroissant.Dataset(jsonld=folder / CROISSANT)


@pytest.mark.filterwarnings("ignore")  # of mlcroissant's own, on what pandas and rdflib will drop
def test_croissant_validates_and_loads(dataset_folder, tmp_path):
    export(dataset_folder, tmp_path / "out", "croissant")
    croissant = loaded_croissant(tmp_path / "out")
    assert not croissant.metadata.ctx.issues.errors
    # A dataset has no date: the same logs make the same bytes on any day.
    assert all("datePublished" in warning for warning in croissant.metadata.ctx.issues.warnings)
    dataset = open_dataset(dataset_folder)
    said = json.loads((tmp_path / "out" / CROISSANT).read_text())
    assert said["conformsTo"] == CONFORMS_TO
    assert said["version"] == "1.0.0"
    assert "2505.09377" in said["citeAs"]
    for split in SPLITS:
        rows = dataset.rows(split)
        records = list(croissant.records(split))
        assert len(records) == len(rows)
        episodes = dataset.column("episode")[rows].tolist()
        assert [r[f"{split}/episode"].decode() for r in records] == episodes
        pose = np.array([r[f"{split}/block_pose"] for r in records], np.float32)
        np.testing.assert_array_equal(pose, dataset.column("block_pose")[rows])
    assert len(list(croissant.records("episodes"))) == dataset.manifest.counts.episodes


@pytest.mark.filterwarnings("ignore")
def test_croissant_of_a_file_with_one_other_byte_is_refused(selection, tmp_path):
    export(selection, tmp_path / "out", "croissant")
    path = tmp_path / "out" / "data" / "test.parquet"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    croissant = loaded_croissant(tmp_path / "out")
    assert len(list(croissant.records("validation"))) > 0
    with pytest.raises(Exception, match=r"Download\(data/test.parquet\)") as caught:
        list(croissant.records("test"))
    assert "hash" in str(caught.value.__cause__).lower()


def test_croissant_names_the_licence_by_its_address(selection, tmp_path):
    export(selection, tmp_path / "out", "croissant")
    assert load_manifest(selection).licence == "CC-BY-4.0"
    about = msgspec.json.decode((tmp_path / "out" / CROISSANT).read_bytes())
    assert about["license"] == "https://creativecommons.org/licenses/by/4.0/"


def test_every_field_of_croissant_says_its_unit(dynamics, tmp_path):
    export(dynamics, tmp_path / "out", "croissant")
    said = json.loads((tmp_path / "out" / CROISSANT).read_text())
    fields = {f["@id"]: f for f in said["recordSet"][0]["field"]}
    for feature in load_manifest(dynamics).features:
        field = fields[f"train/{feature.name}"]
        assert feature.description in field["description"]
        assert not feature.unit or f"[{feature.unit}]" in field["description"]
    assert (fields["train/block_pose"]["arrayShape"], fields["train/edge_force"]["arrayShape"]) == ("6,7", "-1")


@pytest.mark.filterwarnings("ignore")
def test_hugging_face_datasets_open_the_folder_with_its_splits(dataset_folder, tmp_path, offline):
    datasets = quietly_imported("datasets")
    export(dataset_folder, tmp_path / "out", "hf")
    found = datasets.load_dataset(str(tmp_path / "out"), cache_dir=str(tmp_path / "cache"))
    dataset = open_dataset(dataset_folder)
    assert set(found) == set(SPLITS)
    for split in SPLITS:
        rows = dataset.rows(split)
        assert found[split].num_rows == len(rows)
        pose = found[split].with_format("numpy")["block_pose"]
        np.testing.assert_array_equal(np.stack(list(pose)), dataset.column("block_pose")[rows])
    episodes = datasets.load_dataset(str(tmp_path / "out"), "episodes", cache_dir=str(tmp_path / "cache"))
    assert episodes["episodes"].num_rows == dataset.manifest.counts.episodes


def test_the_card_has_nothing_left_to_fill_in(dataset_folder, tmp_path):
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    export(dataset_folder, tmp_path / "out", "hf")
    manifest = load_manifest(dataset_folder)
    _, front, body = (tmp_path / "out" / CARD).read_text().split("---\n", 2)
    about = yaml.safe_load(front)
    assert about["license"] == manifest.licence.lower()
    assert about["size_categories"] == ["n<1K"]
    assert [d["split"] for d in about["configs"][0]["data_files"]] == list(SPLITS)
    for lacking in ("TODO", "[More Information Needed]", "None", "{", "[]"):
        assert lacking not in body
    for feature in manifest.features:
        assert f"| {feature.name} | {feature.dtype} |" in body
    for label in manifest.labels:
        assert all(f"{key} = {value:g}" in body for key, value in label.thresholds.items())
    for text in (manifest.hash, manifest.licence, manifest.splits.rule, *manifest.citation):
        assert text in body


def test_sizes_are_the_hub_s():
    assert [size_category(n) for n in (999, 1000, 99_999, 10**6, 10**9)] == [
        *("n<1K", "1K<n<10K", "10K<n<100K", "1M<n<10M", "n>10M"),
    ]


@pytest.fixture
def lerobot(dynamics: Path, tmp_path: Path) -> tuple[Dataset, Path]:
    export(dynamics, tmp_path / "out", "lerobot")
    return open_dataset(dynamics), tmp_path / "out"


def lerobot_column(folder: Path, name: str) -> np.ndarray:
    return np.array(pq.read_table(folder / "data")[name].to_pylist())


def test_lerobot_frames_are_the_rows_sorted_by_split(lerobot):
    dataset, folder = lerobot
    rows = np.concatenate([dataset.rows(s) for s in SPLITS])
    np.testing.assert_array_equal(lerobot_column(folder, "action"), dataset.column("action")[rows])
    pose = lerobot_column(folder, "observation.state")[:, : 7 * 6].reshape(-1, 6, 7)
    np.testing.assert_array_equal(pose, dataset.column("block_pose")[rows])
    assert lerobot_column(folder, "index").tolist() == list(range(len(dataset)))
    frame = lerobot_column(folder, "frame_index")
    np.testing.assert_array_equal(frame, dataset.column("frame")[rows])
    np.testing.assert_allclose(lerobot_column(folder, "timestamp"), frame * 0.032, atol=1e-6)
    last = lerobot_column(folder, "next.done")
    assert last.sum() == len(np.unique(dataset.column("episode")))


def test_lerobot_forces_are_those_of_the_past(lerobot):
    """What a fingertip feels over the step to come would tell a policy the future."""
    dataset, folder = lerobot
    rows = np.concatenate([dataset.rows(s) for s in SPLITS])
    force = lerobot_column(folder, "observation.state")[:, -6:]
    first = lerobot_column(folder, "frame_index") == 0
    assert (force[first] == 0).all()
    later = np.flatnonzero(~first)
    np.testing.assert_array_equal(force[later, :3], dataset.column("left_force")[rows][later - 1])
    np.testing.assert_array_equal(force[later, 3:], dataset.column("right_force")[rows][later - 1])


def test_lerobot_metadata_agree_with_its_frames(lerobot):
    dataset, folder = lerobot
    info = json.loads((folder / "meta" / "info.json").read_text())
    episodes = pq.read_table(folder / "meta" / "episodes").to_pylist()
    assert (info["codebase_version"], info["fps"]) == ("v3.0", 31.25)
    assert (info["total_episodes"], info["total_frames"]) == (len(episodes), len(dataset))
    index = lerobot_column(folder, "episode_index")
    for episode in episodes:
        inside = slice(episode["dataset_from_index"], episode["dataset_to_index"])
        assert set(index[inside].tolist()) == {episode["episode_index"]}
        assert episode["length"] == inside.stop - inside.start
        assert episode["jenga/tower"] in dataset.manifest.splits.towers(episode["jenga/split"])
    assert info["splits"]["train"] == f"0:{sum(e['jenga/split'] == 'train' for e in episodes)}"
    for name, feature in info["features"].items():
        width = lerobot_column(folder, name).reshape(len(dataset), -1).shape[1]
        assert feature["shape"] == [width]
        assert feature["names"] is None or len(feature["names"]) == width
    training = lerobot_column(folder, "action")[: episodes[int(info["splits"]["train"][2:]) - 1]["dataset_to_index"]]
    stats = json.loads((folder / "meta" / "stats.json").read_text())
    np.testing.assert_allclose(stats["action"]["std"], training.std(axis=0), rtol=1e-6)


def test_lerobot_tasks_are_a_pandas_table(lerobot):
    pandas = quietly_imported("pandas")
    tasks = pandas.read_parquet(lerobot[1] / "meta" / "tasks.parquet")
    assert tasks.loc[TASK].task_index == 0


def test_lerobot_of_episodes_with_other_steps_is_refused(dynamics, forge, tmp_path):
    def twice_as_long(values: np.ndarray) -> np.ndarray:
        values[0] *= 2
        return values

    other = forge(dynamics, "episodes.parquet", control_step_ns=twice_as_long)
    with pytest.raises(JengaError, match=r"control steps of \[32000000, 64000000\] ns"):
        export(other, tmp_path / "out", "lerobot")


@pytest.mark.filterwarnings("ignore")
def test_lerobot_s_own_reader_opens_it(lerobot, offline):
    reader = pytest.importorskip(
        "lerobot.datasets.lerobot_dataset",
        reason="lerobot, which wants an older torch, is not installed",
        exc_type=ImportError,
    )
    dataset, folder = lerobot
    found = reader.LeRobotDataset("jenga/test", root=folder, delta_timestamps={"action": [0.0, 0.032]})
    assert len(found) == len(dataset)
    assert found.meta.fps == 31.25
    np.testing.assert_array_equal(found[0]["action"][0].numpy(), dataset.column("action")[dataset.rows("train")[0]])
    assert found[0]["task"] == TASK


def test_the_manifest_itself_is_not_changed(selection, tmp_path):
    before = msgspec.json.encode(load_manifest(selection))
    export(selection, tmp_path / "out", "hf")
    assert msgspec.json.encode(load_manifest(selection)) == before
