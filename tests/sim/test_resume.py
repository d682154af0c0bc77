"""A logged pull taken up again goes on as it did, and otherwise where it is told less or asked for something else."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from robot_stage import LOOSE
from short_tower import short_towers

from jenga_data.collect.extraction import run_extraction
from jenga_data.collect.resume import KNOWN, Resumed
from jenga_data.episode import Episode
from jenga_data.errors import JengaError
from jenga_data.log.reader import read_episode
from jenga_data.log.writer import EpisodeWriter

CONFIG = replace(LOOSE, body="gripper")


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory) -> Episode:
    path = tmp_path_factory.mktemp("logs") / "pull.mcap"
    with short_towers():
        run_extraction(CONFIG, 0, 1, lambda header, scene: EpisodeWriter(path, header, scene))
    return read_episode(Path(path))


@pytest.fixture(scope="module")
def resumed(episode: Episode) -> Resumed:
    return Resumed(episode)


@pytest.mark.parametrize("number", [0, 4])
def test_the_logged_actions_give_the_logged_poses_to_the_last_bit(resumed: Resumed, episode: Episode, number: int):
    resumed.restart(number)
    poses = resumed.play(episode.action[number : number + 3])
    np.testing.assert_array_equal(poses, episode.pose[episode.action_frame[number : number + 3] + 1])


def test_what_was_played_leaves_no_trace(resumed: Resumed, episode: Episode):
    resumed.restart(2)
    resumed.play(np.full((2, 3), -1e-3))
    resumed.restart(4)
    poses = resumed.play(episode.action[4:5])
    np.testing.assert_array_equal(poses[0], episode.pose[episode.action_frame[4] + 1])


def test_other_actions_give_other_poses(resumed: Resumed, episode: Episode):
    target, start = episode.header.target, episode.pose[episode.action_frame[4]]
    ways = []
    for speed in (0.002, 0.004):
        resumed.restart(4)
        way = resumed.play(np.array([[-speed, 0.0, 0.0]]))[0, target, :3] - start[target, :3]
        ways.append(-way[0])
    assert ways[0] < ways[1] - 0.001


def test_who_is_told_less_errs_more(resumed: Resumed, episode: Episode):
    """Without velocities the target must be speeded up anew; with all but the rounding nearly nothing is missing."""
    after, target = episode.pose[episode.action_frame[4] + 1], episode.header.target
    errors = {}
    for known in KNOWN:
        resumed.restart(4, known)
        errors[known] = np.linalg.norm(resumed.play(episode.action[4:5])[0, target, :3] - after[target, :3])
    assert errors["all"] == 0.0
    assert 0.0 < errors["velocities and set point"] < 2e-4
    assert errors["poses"] > 2 * errors["velocities and set point"]


def test_an_episode_without_actions_or_of_another_kind_is_refused(episode: Episode):
    nothing = replace(
        episode, action_frame=episode.action_frame[:0], action=episode.action[:0], action_reached=episode.action[:0]
    )
    with pytest.raises(JengaError, match="no extraction with actions"):
        Resumed(nothing)
    with pytest.raises(JengaError, match="logged by another simulator"):
        Resumed(replace(episode, sim_state=episode.sim_state[:, :-1]))
