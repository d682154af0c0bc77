"""What is written is what rerun reads back, fast; and a viewer without a window really draws it."""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from made_up_episode import TARGET, make_episode, make_prediction
from rerun.chunk import Chunk, RrdReader
from rerun.experimental import ViewerClient

from jenga_data import palette
from jenga_data.episode import Episode, Prediction
from jenga_data.errors import JengaError
from jenga_data.replay import rerun_adapter, viewer
from jenga_data.replay.contact_points import contact_points
from jenga_data.replay.recording import window
from jenga_data.replay.rerun_adapter import FRAME, TIME, screenshot, write_rrd
from jenga_data.replay.viewer import headless_viewer

GNS, OPEN_LOOP = "/model/gns_one_step", "/model/gns_open_loop"


class Recording:
    """Rows of each entity of an .rrd file, and its columns."""

    def __init__(self, path: Path) -> None:
        self.reader = RrdReader(path)
        self.chunks: dict[str, list[Chunk]] = {}
        for chunk in self.reader.stream():
            self.chunks.setdefault(str(chunk.entity_path), []).append(chunk)

    def rows(self, path: str) -> int:
        return sum(chunk.num_rows for chunk in self.chunks[path] if not chunk.is_static)

    def column(self, path: str, name: str) -> list:
        tables = [chunk.to_record_batch() for chunk in self.chunks[path] if not chunk.is_static]
        return [v for t in tables if name in t.schema.names for v in t.column(name).to_pylist()]

    def static(self, path: str, name: str) -> list:
        tables = [chunk.to_record_batch() for chunk in self.chunks[path] if chunk.is_static]
        return next(t.column(name).to_pylist()[0] for t in tables if name in t.schema.names)


@pytest.fixture(scope="module")
def recording(episode: Episode, predictions: list[Prediction], tmp_path_factory: pytest.TempPathFactory) -> Recording:
    out = tmp_path_factory.mktemp("replay") / "episode.rrd"
    write_rrd(episode, predictions, out)
    assert [p.name for p in out.parent.iterdir()] == ["episode.rrd"]
    return Recording(out)


def test_every_frame_and_every_sample_is_there(recording: Recording, episode: Episode) -> None:
    frames = len(episode.time_ns)
    assert recording.rows("/world/tower") == frames
    assert recording.rows("/world/contacts") == recording.rows("/graph") == frames
    assert recording.rows("/world/gripper") == recording.rows("/curve/force/left") == len(episode.gripper.time_ns)
    assert recording.rows("/curve/action/commanded") == recording.rows("/curve/action/reached") == len(episode.action)
    assert recording.rows("/curve/moved") == frames
    assert recording.rows("/phase") == len(episode.phases)


def test_time_is_seconds_since_the_first_frame_and_frame_its_number(recording: Recording, episode: Episode) -> None:
    since = [t.total_seconds() for t in recording.column("/world/tower", TIME)]
    np.testing.assert_allclose(since, (episode.time_ns - episode.time_ns[0]) * 1e-9)
    assert recording.column("/world/tower", FRAME) == list(range(len(episode.time_ns)))


def test_poses_are_the_log_s_with_the_quaternion_s_real_part_last(recording: Recording, episode: Episode) -> None:
    where = np.array(recording.column("/world/tower", "InstancePoses3D:translations"))
    turn = np.array(recording.column("/world/tower", "InstancePoses3D:quaternions"))
    np.testing.assert_allclose(where, episode.pose[..., :3], atol=1e-6)
    np.testing.assert_allclose(turn[..., [3, 0, 1, 2]], episode.pose[..., 3:], atol=1e-6)


def test_the_target_alone_has_the_target_s_colour(recording: Recording) -> None:
    colours = np.array(recording.static("/world/tower", "Boxes3D:colors"))
    red, green, blue, alpha = palette.rgba8(palette.TARGET).tolist()
    assert np.flatnonzero(colours == (red << 24 | green << 16 | blue << 8 | alpha)).tolist() == [TARGET]


def test_a_ghost_is_there_while_it_is_predicted_and_goes_away_after(
    recording: Recording, predictions: list[Prediction]
) -> None:
    frames = np.array(recording.column(f"{OPEN_LOOP}/ghost/target", FRAME))
    where = np.array(recording.column(f"{OPEN_LOOP}/ghost/target", "InstancePoses3D:translations"))
    shown = np.isfinite(where).all(axis=(1, 2))
    assert sorted(frames[shown]) == predictions[1].frame.tolist()
    assert sorted(frames[~shown]) == [0, predictions[1].frame[-1] + 1]
    np.testing.assert_allclose(where[shown][:, 0], predictions[1].pose[:, TARGET, :3], atol=1e-6)


def test_error_curves_are_millimetres(recording: Recording, episode: Episode, predictions: list[Prediction]) -> None:
    curve = np.array(recording.column(f"{GNS}/curve", "Scalars:scalars"))
    truth = episode.pose[predictions[0].frame, TARGET, :3]
    error = np.linalg.norm(predictions[0].pose[:, TARGET, :3] - truth, axis=1)
    np.testing.assert_allclose(curve[:, 1], 1000 * error)


def test_arrows_start_where_bodies_touch_and_edges_name_them(recording: Recording, episode: Episode) -> None:
    contacts = contact_points(episode)
    edges = recording.column("/graph", "GraphEdges:edges")
    assert [len(e) for e in edges] == contacts.counts(len(episode.time_ns)).tolist()
    assert {"first": str(TARGET), "second": "left"} in edges[50]
    origins = np.concatenate([np.reshape(o, (-1, 3)) for o in recording.column("/world/contacts", "Arrows3D:origins")])
    low, high = episode.pose[..., :3].min(axis=(0, 1)) - 0.06, episode.pose[..., :3].max(axis=(0, 1)) + 0.06
    assert (origins > low).all()
    assert (origins < high).all()


def test_the_layout_is_in_the_file_and_shows_what_there_is(recording: Recording) -> None:
    (blueprint,) = recording.reader.blueprints()
    tables = [chunk.to_record_batch() for chunk in recording.reader.stream(store=blueprint)]
    name = "ViewBlueprint:display_name"
    titles = {title for t in tables if name in t.schema.names for (title,) in t.column(name).to_pylist()}
    assert {"tower, with ghosts of the models", "contact forces", "contacts", "episode", "phases"} <= titles
    assert {"action [mm]", "fingertip force [N]", "others moved [mm]", "error of gns open loop [mm]"} <= titles


def test_the_words_tell_the_outcome_and_where_it_came_from(recording: Recording, episode: Episode) -> None:
    (words,) = recording.static("/episode", "TextDocument:text")
    assert words.startswith("# extracted")
    for fact in (episode.header.key, "level 9, slot 0 (side)", "git", "0123abc", "sha256:gns"):
        assert fact in words


def test_a_log_without_robot_contacts_and_outcome_is_written_too(tmp_path: Path) -> None:
    episode = make_episode(frames=30, robot=False)
    none = np.zeros(0, np.int64)
    empty = type(episode.contacts[0])(none, none, np.zeros((0, 3)))
    bare = type(episode)(**{**vars(episode), "contacts": [empty] * 30, "phases": [], "result": None})
    write_rrd(bare, [], tmp_path / "bare.rrd")
    recording = Recording(tmp_path / "bare.rrd")
    assert "/world/gripper" not in recording.chunks
    (words,) = recording.static("/episode", "TextDocument:text")
    assert "the log ends before its outcome" in words


def test_two_thousand_frames_take_less_than_five_seconds(tmp_path: Path) -> None:
    """0.8 s on two idle cores; block by block it would take a minute."""
    episode = make_episode(frames=60)
    many = np.resize(np.arange(60), 2000)
    long = type(episode)(
        **{
            **vars(episode),
            "time_ns": np.arange(2000) * 32_000_000,
            "pose": episode.pose[many],
            "twist": episode.twist[many],
            "sim_state": episode.sim_state[many],
            "turntable": episode.turntable[many],
            "contacts": [episode.contacts[k] for k in many],
        }
    )
    prediction = make_prediction(long, "gns", "one_step", np.arange(1, 2000), 1e-4, 0)
    start = time.perf_counter()
    write_rrd(long, [prediction], tmp_path / "long.rrd")
    assert time.perf_counter() - start < 5.0


def test_a_recording_that_cannot_be_written_is_one_clear_line(episode: Episode, tmp_path: Path) -> None:
    with pytest.raises(JengaError, match=r"cannot write .*No such file"):
        write_rrd(episode, [], tmp_path / "missing" / "a.rrd")


def test_rerun_has_one_door() -> None:
    root = Path(rerun_adapter.__file__).parents[2]
    sources = [p for room in ("jenga_data", "jenga_models", "jenga_control") for p in (root / room).rglob("*.py")]
    using = {
        p.relative_to(root).as_posix() for p in sources if re.search(r"^(import|from) rerun\b", p.read_text(), re.M)
    }
    inside = {name for name in using if name.startswith("jenga_data/replay/recording/")}
    assert using - inside == {"jenga_data/replay/rerun_adapter.py"}
    parts = [p for p in sources if "replay.recording" in p.read_text() and p.parent.name != "recording"]
    assert [p.name for p in parts] == ["rerun_adapter.py"]


def test_only_the_adapter_imports_rerun() -> None:
    program = "import sys, jenga_data.replay.picture, jenga_data.replay.curves, jenga_data.replay.viewer\n"
    program += "assert 'rerun' not in sys.modules and 'mujoco' not in sys.modules and 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", program], check=True)


def test_a_screenshot_of_no_file_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(JengaError, match="does not exist; jenga replay"):
        screenshot(tmp_path / "none.rrd", tmp_path / "none.png", 0.0)


def test_without_a_graphics_driver_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stand-in for the viewer prints what the real one does on a bare machine."""
    viewer = tmp_path / "viewer"
    viewer.write_text("#!/bin/sh\necho \"thread 'main' panicked: No graphics adapter was found\"\nexit 101\n")
    viewer.chmod(0o755)
    monkeypatch.setattr("jenga_data.replay.viewer._viewer_command", lambda arguments: [str(viewer)])
    with pytest.raises(JengaError, match=r"no Vulkan driver.*mesa-vulkan-drivers"), headless_viewer(tmp_path, (64, 64)):
        pass


def vulkan_drivers() -> list[Path]:
    named = os.environ.get("VK_DRIVER_FILES") or os.environ.get("VK_ICD_FILENAMES")
    if named:
        return [Path(p) for p in named.split(os.pathsep) if Path(p).exists()]
    return [
        p for folder in ("/usr/share", "/etc", "/usr/local/share") for p in Path(folder).glob("vulkan/icd.d/*.json")
    ]


needs_vulkan = pytest.mark.skipif(
    not vulkan_drivers(), reason="no Vulkan driver (Debian: apt-get install mesa-vulkan-drivers)"
)


@needs_vulkan
def test_a_viewer_opens_at_the_moment_that_was_asked_for(
    episode: Episode, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The window itself is left out, for there is no screen."""
    urls, processes = [], []
    start, opened = viewer._start, viewer.open_steerable_viewer
    monkeypatch.setattr(viewer, "_start", lambda args: processes.append(start(["--headless", *args])) or processes[-1])
    monkeypatch.setattr(window, "open_steerable_viewer", lambda path: urls.append(opened(path)) or urls[-1])
    write_rrd(episode, [], tmp_path / "a.rrd")
    try:
        rerun_adapter.open_at(tmp_path / "a.rrd", 1.28)
        client = ViewerClient.connect(urls[0])
        deadline = time.monotonic() + 20
        while (state := client.get_state().recordings[0]).current_time != 1_280_000_000:
            assert time.monotonic() < deadline, state
            time.sleep(0.1)
        assert state.current_timeline == TIME
    finally:
        for process in processes:
            process.terminate()
            process.wait()


def test_a_viewer_that_does_not_start_is_one_clear_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer, "_viewer_command", lambda _: ["false"])
    with pytest.raises(JengaError, match="rerun's viewer did not start, which needs a screen"):
        viewer.open_steerable_viewer(tmp_path / "a.rrd")


@needs_vulkan
def test_a_viewer_without_a_window_draws_the_tower_with_its_target(
    episode: Episode, predictions: list[Prediction], tmp_path: Path
) -> None:
    write_rrd(episode, predictions, tmp_path / "a.rrd")
    pictures = []
    for at in (0.0, 2.2):
        screenshot(tmp_path / "a.rrd", tmp_path / "a.png", at, window=(1280, 800))
        pictures.append(matplotlib.image.imread(tmp_path / "a.png")[..., :3])
    tower = [picture[60:420, :290] for picture in pictures]  # the first panel
    assert tower[0].shape == (360, 290, 3)
    column = []
    for panel in tower:
        wooden = (panel[..., 0] > 0.3) & (panel[..., 0] - panel[..., 2] > 0.08)
        blue = (panel[..., 2] > 0.3) & (panel[..., 2] - panel[..., 0] > 0.2)
        assert wooden.mean() > 0.02
        assert blue.sum() > 40
        column.append(np.argwhere(blue)[:, 1].mean())
    assert column[1] < column[0] - 10  # the target has been pulled to the left
    curves = pictures[1][560:760]
    assert ((curves[..., 0] > 0.6) & (curves[..., 2] < 0.3)).sum() > 100  # a vermillion curve
