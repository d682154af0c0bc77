"""A LeRobotDataset, version 3.0, of a dynamics dataset: frames of state and action, without pictures.

The layout is that of github.com/huggingface/lerobot, `src/lerobot/datasets` (CODEBASE_VERSION v3.0).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Float, Int, Shaped

from jenga_data.dataset.export.lerobot_frames import FEATURES, Frames, frames_of
from jenga_data.dataset.manifest import SPLITS
from jenga_data.dataset.read import Dataset
from jenga_data.errors import JengaError
from jenga_data.report import to_json

CODEBASE_VERSION = "v3.0"
TASK = "Pull the target block out of the Jenga tower along -x without bringing the tower down."
FILE_BYTES = 100 * 10**6
"""A file of frames ends with the episode that fills it."""
FILES_A_CHUNK = 1000

_DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_EPISODES = "meta/episodes/chunk-000/file-000.parquet"
_MOMENTS = ("min", "max", "mean", "std")


@dataclass(frozen=True)
class _Episode:
    """One episode: its key, tower and split, and its frames in the order of the export."""

    key: str
    tower: str
    split: str
    start: int
    end: int


def export_lerobot(dataset: Dataset, folder: Path) -> None:
    """Write the dataset into an empty folder.

    Episodes are sorted by split, as a split of LeRobot is a range of episodes. The statistics are of the training
    episodes alone. Rows of a dataset do not hold the state after the last action, so that is left out.

    Raises:
        JengaError: the dataset is no dynamics dataset, or its episodes differ in their control step.
        CheckFailed: a file of the dataset is damaged.
    """
    if dataset.manifest.kind != "dynamics":
        raise JengaError(
            f"{dataset.manifest.identifier} is a {dataset.manifest.kind} dataset, which has no actions for lerobot; "
            "allowed: dynamics datasets; export this one as croissant or hf"
        )
    order, episodes = _episodes(dataset)
    frames = frames_of(dataset, order, [e.end - e.start for e in episodes], _step_seconds(dataset))
    files = _write_frames(folder, frames, episodes)
    training = episodes[: sum(e.split == "train" for e in episodes)] or episodes
    info = _info(dataset, frames, episodes)
    (folder / "meta" / "episodes" / "chunk-000").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(to_json(info), encoding="utf-8")
    (folder / "meta" / "stats.json").write_text(to_json(_stats(frames, 0, training[-1].end)), encoding="utf-8")
    _write_tasks(folder / "meta" / "tasks.parquet")
    _write_episodes(folder / _EPISODES, frames, episodes, files)


def _episodes(dataset: Dataset) -> tuple[Int[np.ndarray, " frame"], list[_Episode]]:
    """Which row of the dataset each frame is, and where its episodes begin and end."""
    keys, towers = dataset.column("episode"), dataset.column("tower")
    order, episodes, start = [np.zeros(0, int)], [], 0
    for split in SPLITS:
        rows = dataset.rows(split)
        first = np.flatnonzero(np.r_[len(rows) > 0, keys[rows][1:] != keys[rows][:-1]])
        for part in np.split(rows, first[1:]) if len(rows) else []:
            episodes.append(_Episode(str(keys[part[0]]), str(towers[part[0]]), split, start, start + len(part)))
            order.append(part)
            start += len(part)
    return np.concatenate(order), episodes


def _step_seconds(dataset: Dataset) -> float:
    steps = sorted(set(dataset.episodes()["control_step_ns"].tolist()))
    if len(steps) != 1:
        raise JengaError(f"episodes with control steps of {steps} ns; lerobot has one for all: split the dataset first")
    return steps[0] / 1e9


def _write_frames(folder: Path, frames: Frames, episodes: list[_Episode]) -> list[int]:
    """Write the files of frames. Returns the number of each episode's file."""
    bytes_a_frame = sum(column[:1].nbytes for column in frames.values())
    file_of = [e.start * bytes_a_frame // FILE_BYTES for e in episodes]
    numbers = {found: i for i, found in enumerate(dict.fromkeys(file_of))}
    for found, number in numbers.items():
        inside = [e for e, file in zip(episodes, file_of, strict=True) if file == found]
        part = slice(inside[0].start, inside[-1].end)
        path = folder / _DATA.format(chunk_index=number // FILES_A_CHUNK, file_index=number % FILES_A_CHUNK)
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(pa.table({name: _to_arrow(column[part]) for name, column in frames.items()}), path)
    return [numbers[found] for found in file_of]


def _to_arrow(column: Shaped[np.ndarray, "frame ..."]) -> pa.Array:
    if column.ndim == 1:
        return pa.array(column)
    return pa.FixedSizeListArray.from_arrays(pa.array(column.reshape(-1)), column.shape[1])


def _info(dataset: Dataset, frames: Frames, episodes: list[_Episode]) -> dict[str, Any]:
    first = {s: next((i for i, e in enumerate(episodes) if e.split == s), 0) for s in SPLITS}
    count = {s: sum(e.split == s for e in episodes) for s in SPLITS}
    bodies = {str(config.get("body")) for config in dataset.manifest.provenance.configs.values()}
    return {
        "codebase_version": CODEBASE_VERSION,
        "robot_type": "panda" if bodies == {"robot"} else None,
        "total_episodes": len(episodes),
        "total_frames": len(frames["index"]),
        "total_tasks": 1,
        "chunks_size": FILES_A_CHUNK,
        "data_files_size_in_mb": FILE_BYTES // 10**6,
        "video_files_size_in_mb": 0,
        "fps": 1 / _step_seconds(dataset),
        "splits": {s: f"{first[s]}:{first[s] + count[s]}" for s in SPLITS if count[s]},
        "data_path": _DATA,
        "video_path": None,
        "features": {
            name: {"dtype": str(column.dtype), "shape": list(column.shape[1:]) or [1], "names": FEATURES[name](dataset)}
            for name, column in frames.items()
        },
        "jenga": {
            "dataset": dataset.manifest.identifier,
            "hash": dataset.hash,
            "licence": dataset.manifest.licence,
            "citation": dataset.manifest.citation,
        },
    }


def _moments(values: Float[np.ndarray, "frame width"]) -> dict[str, list[float]]:
    parts = values.min(0), values.max(0), values.mean(0), values.std(0)
    return {name: part.tolist() for name, part in zip(_MOMENTS, parts, strict=True)}


def _stats(frames: Frames, start: int, end: int) -> dict[str, dict[str, list[float] | list[int]]]:
    """What LeRobot normalises with, of the frames from `start` to before `end`."""
    return {
        name: {**_moments(column[start:end].astype(float).reshape(end - start, -1)), "count": [end - start]}
        for name, column in frames.items()
    }


def _write_tasks(path: Path) -> None:
    """A pandas table whose index is the text of the task, written without pandas."""
    index = "__index_level_0__"
    about = {
        "index_columns": [index],
        "column_indexes": [],
        "columns": [
            {"name": n, "field_name": f, "pandas_type": p, "numpy_type": t, "metadata": None}
            for n, f, p, t in (("task_index", "task_index", "int64", "int64"), (None, index, "unicode", "object"))
        ],
        "pandas_version": "2.0.0",
    }
    table = pa.table({"task_index": pa.array([0], pa.int64()), index: pa.array([TASK])})
    pq.write_table(table.replace_schema_metadata({"pandas": msgspec.json.encode(about)}), path)


def _write_episodes(path: Path, frames: Frames, episodes: list[_Episode], files: list[int]) -> None:
    columns: dict[str, list[Any]] = {
        "episode_index": list(range(len(episodes))),
        "tasks": [[TASK] for _ in episodes],
        "length": [e.end - e.start for e in episodes],
        "dataset_from_index": [e.start for e in episodes],
        "dataset_to_index": [e.end for e in episodes],
        "data/chunk_index": [number // FILES_A_CHUNK for number in files],
        "data/file_index": [number % FILES_A_CHUNK for number in files],
        "meta/episodes/chunk_index": [0] * len(episodes),
        "meta/episodes/file_index": [0] * len(episodes),
        "jenga/episode": [e.key for e in episodes],
        "jenga/tower": [e.tower for e in episodes],
        "jenga/split": [e.split for e in episodes],
    }
    each = [_stats(frames, e.start, e.end) for e in episodes]
    for name in frames:
        columns |= {f"stats/{name}/{key}": [found[name][key] for found in each] for key in (*_MOMENTS, "count")}
    pq.write_table(pa.table(columns), path)
