"""Predictions over an episode, in memory and in the file beside its log."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from fake_towers import small_episode

from jenga_data.episode import Action, Episode, Frame, Result
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.log.writer import EpisodeWriter
from jenga_data.outcome import Outcome, Verdict
from jenga_models import overlay as overlay_module
from jenga_models.checkpoint import load
from jenga_models.overlay import overlay, predict_one_step, predict_open_loop
from jenga_models.overlay import predict_selection as predict_targets
from jenga_models.predict import LearnedDynamics, Selector


def logged(episode: Episode, path: Path) -> Path:
    with EpisodeWriter(path, episode.header, "") as writer:
        for index, time_ns in enumerate(episode.time_ns.tolist()):
            contacts, state = episode.contacts[index], episode.sim_state[index]
            writer.frame(Frame(index, time_ns, episode.pose[index], episode.twist[index], contacts, state))
            if index in episode.action_frame:
                writer.action(Action(index, time_ns, episode.action[index], episode.action_reached[index]))
        writer.finish(Result(Verdict(Outcome.STUCK, dragged=False, moved=0.0, clear_frame=-1)))
    return path


def test_one_step_overlay_predicts_each_frame_from_the_true_one_before(simulator_path: Path):
    episode = small_episode()
    prediction = predict_one_step(simulator_path, episode)
    assert prediction.kind == "one_step"
    assert prediction.frame.tolist() == [1, 2, 3, 4, 5]
    assert prediction.checkpoint == load(simulator_path).hash
    dynamics = LearnedDynamics(simulator_path)
    for frame, pose in zip(prediction.frame, prediction.pose, strict=True):
        dynamics.start(episode.tower_state(frame - 1), episode.header.target)
        now = torch.tensor(episode.pose[frame - 1 : frame]).float()
        expected = dynamics.step(now, torch.tensor(episode.action[frame - 1 : frame]).float())[0]
        np.testing.assert_allclose(pose, expected, atol=1e-6)


def test_open_loop_overlay_starts_at_the_frame_asked_for(simulator_path: Path):
    episode = small_episode()
    one_step = predict_one_step(simulator_path, episode)
    rolled = predict_open_loop(simulator_path, episode, start=2)
    assert rolled.kind == "open_loop"
    assert rolled.frame.tolist() == [3, 4, 5]
    np.testing.assert_allclose(rolled.pose[0], one_step.pose[2], atol=1e-6)
    assert not np.allclose(rolled.pose[2], one_step.pose[4], atol=1e-7)
    with pytest.raises(JengaError, match="no action from frame 5 on"):
        predict_open_loop(simulator_path, episode, start=5)


def test_open_loop_overlay_stops_where_actions_stop(simulator_path: Path):
    episode = small_episode()
    chosen = np.array([0, 1, 3, 4])
    gap = replace(episode, action_frame=chosen, action=episode.action[chosen], action_reached=episode.action[chosen])
    assert predict_open_loop(simulator_path, gap).frame.tolist() == [1, 2]
    assert predict_one_step(simulator_path, gap).frame.tolist() == [1, 2, 4, 5]


def test_selection_overlay_knows_the_legal_targets_and_no_others(selector_path: Path):
    episode = small_episode()
    targets = episode.header.layout.legal_targets()
    prediction = predict_targets(selector_path, episode)
    assert np.flatnonzero(np.isfinite(prediction.failure_probability)).tolist() == targets
    assert len(prediction.frame) == len(prediction.pose) == 0
    expected = Selector(selector_path).failure_probability(episode.tower_state(0), targets)
    np.testing.assert_allclose(prediction.failure_probability[targets], expected)


@pytest.mark.parametrize("kind", ["one_step", "open_loop"])
def test_a_second_overlay_reads_what_the_first_wrote(
    simulator_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
):
    log = logged(small_episode(), tmp_path / "episode.mcap")
    before = log.read_bytes()
    first = overlay(simulator_path, log, kind)
    assert log.read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 2
    monkeypatch.setattr(overlay_module, "advance", None)
    second = overlay(simulator_path, log, kind)
    assert (second.kind, second.name, second.checkpoint) == (kind, "simulator", load(simulator_path).hash)
    assert np.array_equal(second.frame, first.frame)
    assert np.array_equal(second.pose, first.pose)


def test_an_open_loop_from_another_frame_is_computed_anew(simulator_path: Path, tmp_path: Path):
    log = logged(small_episode(), tmp_path / "episode.mcap")
    assert overlay(simulator_path, log, "open_loop").frame[0] == 1
    assert overlay(simulator_path, log, "open_loop", start=3).frame[0] == 4


def test_a_selectors_overlay_comes_back_from_its_file(selector_path: Path, tmp_path: Path):
    log = logged(small_episode(), tmp_path / "episode.mcap")
    first, second = overlay(selector_path, log), overlay(selector_path, log)
    np.testing.assert_array_equal(first.failure_probability, second.failure_probability)
    assert np.isfinite(second.failure_probability).any()


def test_the_sidecar_of_another_log_is_noticed(simulator_path: Path, tmp_path: Path):
    log = logged(small_episode(), tmp_path / "episode.mcap")
    overlay(simulator_path, log)
    logged(small_episode(seed=4), log)
    with pytest.raises(CheckFailed, match="is stale"):
        overlay(simulator_path, log)


def test_an_unknown_kind_is_refused(simulator_path: Path, tmp_path: Path):
    with pytest.raises(JengaError, match="unknown kind of prediction 'both'; allowed: one_step, open_loop"):
        overlay(simulator_path, tmp_path / "episode.mcap", "both")
