"""The paper's figures from logs: what they show is chosen by a rule, and is there to be seen."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up_episode import TARGET, make_episode
from matplotlib.figure import Figure

from jenga_control.prediction.paper_figure import errors, prediction_figure, until_decided
from jenga_control.summary.figures import NO_EXTRACTION, NO_ROBOT, report_figures
from jenga_control.summary.paper_tables import extraction_table, selection_table, tables_figure
from jenga_control.summary.results import Results
from jenga_data.episode import Episode, Frame, Phase, Prediction
from jenga_data.errors import JengaError
from jenga_data.figures.choose import first_of, logged, one_a_round
from jenga_data.figures.pushes import pushes_figure
from jenga_data.log.writer import EpisodeWriter
from jenga_data.outcome import Outcome
from jenga_data.palette import TARGET as BLUE
from jenga_data.replay import style


def write(episode: Episode, path: Path) -> None:
    with EpisodeWriter(path, episode.header, "") as writer:
        for i, time_ns in enumerate(episode.time_ns.tolist()):
            nothing = np.zeros(0)
            writer.frame(Frame(i, time_ns, episode.pose[i], episode.twist[i], episode.contacts[i], nothing))
        assert episode.result is not None
        writer.finish(episode.result)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three short pulls without a robot, their keys in the order c, a, b."""
    folder = tmp_path_factory.mktemp("pulls")
    for key in "cab":
        episode = make_episode(frames=8, pull=(2, 6), robot=False)
        header = replace(episode.header, key=key * 20, number=ord(key))
        write(replace(episode, header=header), folder / f"{key * 20}.mcap")
    (folder / f"{'d' * 20}.mcap.partial").write_bytes(b"under way")
    (folder / f"{'a' * 20}.one_step-123.prediction.mcap").write_bytes(b"no log")
    return folder


def pictures(figure: Figure) -> list[np.ndarray]:
    found = [image for axes in all_axes(figure) for image in axes.get_images()]
    return [np.asarray(image.get_array()) for image in found]


def all_axes(figure: Figure) -> list:
    return [*figure.axes, *(axes for part in figure.subfigs for axes in part.axes if axes not in figure.axes)]


def blue(image: np.ndarray) -> int:
    """Pixels in the target's hue."""
    return int((image[..., 2] - image[..., 0] > 0.25 * BLUE[2]).sum())


def test_logs_come_by_key_without_those_under_way_and_predictions(logs: Path, tmp_path: Path) -> None:
    found = logged([logs])
    assert [log.header.key[0] for log in found] == ["a", "b", "c"]
    assert [log.header.key[0] for log in one_a_round(found)] == ["a"]
    first = first_of(found, cause="")
    assert first is found[0]
    assert first_of(found, outcome=Outcome.INVALID) is None
    with pytest.raises(JengaError, match=r"no log in .*; `jenga collect` makes some"):
        logged([tmp_path])


def test_what_cannot_be_drawn_is_named_with_its_reason(logs: Path, tmp_path: Path) -> None:
    report = report_figures(tmp_path, selection=logs)
    by_name = {figure["name"]: figure for figure in report["figures"]}
    assert by_name["rounds"]["shows"] == ("a" * 20,)
    assert "no tower of round 2, 3" in by_name["rounds"]["rule"]
    for name in ("key-frames", "pushes", "prediction", "touch"):
        assert (by_name[name]["path"], by_name[name]["missing"]) == ("", NO_EXTRACTION)
    assert {Path(p).name for p in report["written"]} == {"figures.json", "figures.md", "rounds.png", "tables.png"}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["figures.json", "figures.md", "rounds.png", "tables.png"]
    without = report_figures(tmp_path / "robot", extraction=logs)
    missing = {figure["name"]: figure["missing"] for figure in without["figures"]}
    assert missing["pushes"] == missing["key-frames"] == NO_ROBOT


def pushed(episode: Episode) -> Episode:
    """The made-up pull mirrored: a stick pushes towards +x."""
    pose = episode.pose.copy()
    pose[:, TARGET, 0] = -pose[:, TARGET, 0]
    phases = [Phase(frame, int(episode.time_ns[frame]), name) for frame, name in ((20, "push"), (60, "turn_back"))]
    return replace(episode, pose=pose, phases=phases)


def test_a_push_is_shown_before_after_and_at_the_end_with_how_far_it_moved(episode: Episode) -> None:
    with style.applied():
        figure = pushes_figure({"": pushed(episode)})
        assert figure is not None
        figure.draw_without_rendering()
    shown = pictures(figure)
    assert len(shown) == 3
    assert min(blue(image) for image in shown[:2]) > 200
    words = [text.get_text() for axes in all_axes(figure) for text in axes.texts]
    pose = pushed(episode).pose[:, TARGET, :3]
    moved = 1e3 * np.linalg.norm(pose[60] - pose[0])
    assert any(text.startswith(f"after the push\ntarget {moved:.0f} mm, others") for text in words)
    assert pushes_figure({"": episode}) is None  # nobody pushes


def test_a_prediction_is_judged_where_the_pull_is_decided(episode: Episode, predictions: list[Prediction]) -> None:
    assert episode.result is not None
    clear = episode.result.verdict.clear_frame
    kept = until_decided(episode, predictions[1])
    assert kept.frame[-1] == min(clear, predictions[1].frame[-1])
    found = errors(episode, kept)
    assert found["steps"] == len(kept.frame)
    at = int(kept.frame[-1])
    truth = np.linalg.norm(kept.pose[-1, TARGET, :3] - episode.pose[at, TARGET, :3])
    assert found["target_mm"] == pytest.approx(1e3 * truth)
    start = int(kept.frame[0]) - 1
    way = np.linalg.norm(episode.pose[at, TARGET, :3] - episode.pose[start, TARGET, :3])
    assert found["target_if_nothing_moved_mm"] == pytest.approx(1e3 * way)


def test_truth_and_prediction_stand_side_by_side_with_a_scale(episode: Episode, predictions: list[Prediction]) -> None:
    with style.applied():
        figure = prediction_figure([(episode, predictions[1])])
        figure.draw_without_rendering()
    before, truth, prediction = pictures(figure)[:3]
    assert min(blue(before), blue(truth)) > 200
    assert blue(prediction) < 50  # its colours are those of errors
    assert any(axes.get_ylabel() == "error [mm]" for axes in all_axes(figure))


def test_the_tables_name_what_was_not_measured() -> None:
    with style.applied():
        figure = tables_figure([selection_table(Results(())), extraction_table(Results(()))])
    words = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert words.count("ours: not measured") == 4
    assert "0.74 [0.69, 0.78] (n = 400)" in words
