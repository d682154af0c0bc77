"""Synthetic logs of a tower of two levels: no simulator, a few milliseconds an episode."""

import shutil
from collections.abc import Callable, Collection, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jenga_data.blocks import sample_blocks
from jenga_data.dataset.convert import convert
from jenga_data.dataset.manifest import MANIFEST, canonical_bytes, load_manifest, sealed
from jenga_data.dataset.rows import Ragged
from jenga_data.dataset.schema import COLUMNS, EPISODE_COLUMNS, EPISODES, arrow_schema
from jenga_data.dataset.staging import file_entry
from jenga_data.dataset.tables import numpy_column, open_parquet, record_batch, table_writer
from jenga_data.dataset.verify import verify
from jenga_data.episode import (
    CONTROL_STEP_NS,
    LEFT_FINGER,
    TABLE,
    Action,
    Contacts,
    Episode,
    EpisodeHeader,
    Frame,
    GripperSample,
    GripperTrack,
    Result,
)
from jenga_data.log.writer import EpisodeWriter
from jenga_data.outcome import Outcome, Verdict
from jenga_data.tower import Layout

BLOCKS = 6
FRAMES = 5
SAMPLES = 4
"""Gripper samples a step."""

OUTCOMES = (Outcome.EXTRACTED, Outcome.STUCK, Outcome.COLLAPSED)


def make_episode(kind: str = "selection", number: int = 0, outcome: Outcome | None = None, tower: int = -1) -> Episode:
    """Block 1 slides out in -x while the others tremble; each episode has its own blocks, or those of `tower`."""
    rng = np.random.default_rng([number, 1])
    blocks = sample_blocks("measured", np.random.default_rng([tower if tower >= 0 else number, 2]), BLOCKS)
    layout = Layout(np.arange(BLOCKS).reshape(-1, 3), moves=number % 3)
    angle = np.pi / 2 * (layout.level % 2)
    start = np.zeros((BLOCKS, 7))
    start[:, 0] = -np.sin(angle) * (layout.slot - 1) * 0.025
    start[:, 1] = np.cos(angle) * (layout.slot - 1) * 0.025
    start[:, 2] = (layout.level + 0.5) * 0.0148
    start[:, 3], start[:, 6] = np.cos(angle / 2), np.sin(angle / 2)
    pose = np.repeat(start[None], FRAMES, axis=0)
    pose[..., :3] += rng.normal(0, 1e-5, (FRAMES, BLOCKS, 3))
    pose[:, 1, 0] -= 0.03 * np.arange(FRAMES)
    actions = FRAMES - 1 if kind == "extraction" else 0
    time_ns = np.arange(FRAMES, dtype=np.int64) * CONTROL_STEP_NS
    samples = np.arange(FRAMES * SAMPLES if actions else 0, dtype=np.int64) * (CONTROL_STEP_NS // SAMPLES)
    contacts = [
        Contacts(np.array([3, 1, 0, 1]), np.array([1, 4, TABLE, LEFT_FINGER]), rng.normal(size=(4, 3)))
        for _ in range(FRAMES)
    ]
    found = outcome or OUTCOMES[number % 3]
    moved = float("nan") if found is Outcome.INVALID else 0.001 * (1 + number)
    verdict = Verdict(found, dragged=number % 4 == 0, moved=moved, clear_frame=3 if found is Outcome.EXTRACTED else -1)
    return Episode(
        header=EpisodeHeader(
            key=f"{kind}-{number:04d}",
            kind=kind,
            seed=7,
            number=number,
            blocks=blocks,
            layout=layout,
            target=1,
            turn=2,
            face=1,
            config={"rounds": [1, 15], "physics": {"friction": 0.35}},
            provenance={"mujoco_version": "4.0.0", "git_commit": "abc", "machine": "secret-host", "time": "noon"},
        ),
        time_ns=time_ns,
        pose=pose,
        twist=rng.normal(0, 0.1, (FRAMES, BLOCKS, 6)),
        contacts=contacts,
        sim_state=np.zeros((FRAMES, 0)),
        action_frame=np.arange(actions, dtype=np.int64),
        action=rng.normal(0, 0.01, (actions, 3)),
        action_reached=rng.normal(0, 0.01, (actions, 3)),
        gripper=GripperTrack(
            time_ns=samples,
            pose=np.tile([0.0, 0, 0, 1, 0, 0, 0], (len(samples), 1)),
            width=np.full(len(samples), 0.025),
            left_force=rng.normal(size=(len(samples), 3)),
            right_force=rng.normal(size=(len(samples), 3)),
        ),
        phases=[],
        result=Result(verdict, "slipped" if found is Outcome.STUCK else ""),
        turntable=np.zeros(FRAMES),
        robot=None,
    )


def write_log(episode: Episode, folder: Path) -> Path:
    """The episode as an MCAP file; one without a result stays `.partial`."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{episode.header.key}.mcap"
    track = episode.gripper
    with EpisodeWriter(path, episode.header, "") as log:
        for i, time_ns in enumerate(episode.time_ns.tolist()):
            log.frame(Frame(i, time_ns, episode.pose[i], episode.twist[i], episode.contacts[i], episode.sim_state[i]))
        for i, frame in enumerate(episode.action_frame.tolist()):
            log.action(Action(frame, int(episode.time_ns[frame]), episode.action[i], episode.action_reached[i]))
        for i, time_ns in enumerate(track.time_ns.tolist()):
            width = float(track.width[i])
            log.gripper(GripperSample(time_ns, track.pose[i], width, track.left_force[i], track.right_force[i]))
        if episode.result is not None:
            log.finish(episode.result)
    return path


def all_rows(folder: Path) -> pa.Table:
    """Every row of a dataset, by episode and frame, in whatever files they lie."""
    tables = [pq.read_table(path) for path in sorted((folder / "data").iterdir())]
    return pa.concat_tables(tables).sort_by([("episode", "ascending"), ("frame", "ascending")])


def passes(folder: Path) -> bool:
    """Whether a dataset keeps what it promises; what fails is shown."""
    failed = {name: check.detail for name, check in verify(folder).checks.items() if not check.ok}
    assert failed == {}
    return True


@pytest.fixture(scope="session")
def rows_in() -> Callable[[Path], pa.Table]:
    return all_rows


@pytest.fixture(scope="session")
def whole() -> Callable[[Path], bool]:
    return passes


@pytest.fixture(scope="session")
def stored_logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs that were written once and are asked for by many tests."""
    return tmp_path_factory.mktemp("stored_logs")


@pytest.fixture
def logs_of(tmp_path: Path, stored_logs: Path) -> Callable[..., Path]:
    """A folder NAME-logs with the logs of some numbers; those in `invalid` have broken physics."""

    def make(name: str, numbers: Iterable[int], kind: str = "selection", invalid: Collection[int] = ()) -> Path:
        folder = tmp_path / f"{name}-logs"
        folder.mkdir(exist_ok=True)
        for number in numbers:
            broken = number in invalid
            store = stored_logs / str(broken)
            log = store / f"{kind}-{number:04d}.mcap"
            if not log.exists():
                write_log(make_episode(kind, number, Outcome.INVALID if broken else None), store)
            shutil.copy(log, folder)
        return folder

    return make


@pytest.fixture
def made(tmp_path: Path, logs_of: Callable[..., Path]) -> Callable[..., Path]:
    """A dataset NAME@1.0.0 of the logs that `logs_of` puts into NAME-logs, and of those that are there already."""

    def make(
        name: str, numbers: Iterable[int], kind: str = "selection", invalid: Collection[int] = (), **options: Any
    ) -> Path:
        convert([logs_of(name, numbers, kind, invalid)], tmp_path / name, name, "1.0.0", **options)
        return tmp_path / name

    return make


@pytest.fixture(scope="session")
def episode_of() -> Callable[..., Episode]:
    return make_episode


@pytest.fixture(scope="session")
def write() -> Callable[[Episode, Path], Path]:
    return write_log


@pytest.fixture(scope="session")
def selection_logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """24 selection episodes of as many towers."""
    folder = tmp_path_factory.mktemp("selection_logs")
    for number in range(24):
        write_log(make_episode("selection", number), folder)
    return folder


@pytest.fixture(scope="session")
def extraction_logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """12 extraction episodes of 6 towers, one of them with broken physics."""
    folder = tmp_path_factory.mktemp("extraction_logs")
    for number in range(12):
        episode = make_episode("extraction", number, Outcome.INVALID if number == 11 else None, tower=number % 6)
        write_log(episode, folder)
    return folder


@pytest.fixture(scope="session")
def selection(tmp_path_factory: pytest.TempPathFactory, selection_logs: Path) -> Path:
    """A selection dataset. Read only: copy it to change it."""
    out = tmp_path_factory.mktemp("selection") / "dataset"
    convert([selection_logs], out, "test-selection", "1.0.0")
    return out


@pytest.fixture(scope="session")
def dynamics(tmp_path_factory: pytest.TempPathFactory, extraction_logs: Path) -> Path:
    """A dynamics dataset. Read only: copy it to change it."""
    out = tmp_path_factory.mktemp("dynamics") / "dataset"
    convert([extraction_logs], out, "test-dynamics", "1.0.0")
    return out


@pytest.fixture(scope="session")
def two_seeds(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Logs of two collections, mixed in two folders."""
    folders = [tmp_path_factory.mktemp("left"), tmp_path_factory.mktemp("right")]
    for number in range(8):
        episode = make_episode("selection", number)
        header = replace(episode.header, seed=7 + number % 2)
        write_log(replace(episode, header=header), folders[number // 2 % 2])
    return folders


@pytest.fixture
def forge(tmp_path: Path) -> Callable[..., Path]:
    """Copy a dataset, replace columns of its first data file (or another) by what functions make of them, and seal
    it again, as somebody would who wants to hide it: every hash is right."""

    def forged(folder: Path, path: str = "", **columns: Callable[[np.ndarray], np.ndarray]) -> Path:
        out = tmp_path / "forged"
        shutil.copytree(folder, out)
        manifest = load_manifest(out)
        path = path or manifest.data_files[0].path
        names = EPISODE_COLUMNS if path == EPISODES else COLUMNS[manifest.kind]
        with open_parquet(out / path) as file:
            table = file.read()
        rows = {name: numpy_column(table[name]) for name in table.column_names}
        for name, change in columns.items():
            old = rows[name]
            ragged = isinstance(old, Ragged)
            new = change(np.array(old.values if ragged else old))
            rows[name] = Ragged(old.offset, new) if ragged else new
        schema = arrow_schema(names, manifest.blocks)
        with table_writer(out / path, names, schema) as writer:
            writer.write(record_batch(rows, schema))
        entry = file_entry(out, path, table.num_rows)
        files = [entry if f.path == path else f for f in manifest.files]
        (out / MANIFEST).write_bytes(canonical_bytes(sealed(msgspec.structs.replace(manifest, files=files))))
        return out

    return forged


@pytest.fixture(params=["selection", "dynamics"])
def dataset_folder(request: pytest.FixtureRequest) -> Path:
    """A dataset of each kind."""
    return request.getfixturevalue(request.param)
