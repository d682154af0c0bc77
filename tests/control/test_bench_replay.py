"""The bench of replay: a real log of the length that was asked for, and figures with their limits."""

import pytest

from jenga_control.bench_replay import bench_replay, untrained, write_episode
from jenga_data.errors import JengaError
from jenga_data.log.reader import read_episode
from jenga_models.overlay import predict_one_step


def test_its_episode_has_touch_at_250_hz_and_an_action_a_frame(tmp_path):
    frames = write_episode(tmp_path / "a.mcap", 0.64)
    episode = read_episode(tmp_path / "a.mcap")
    assert len(episode.time_ns) == frames == 20
    assert len(episode.gripper.time_ns) == 160
    assert len(episode.action) == 19
    prediction = predict_one_step(untrained(), episode)
    assert prediction.frame.tolist() == list(range(1, 20))


def test_it_says_how_long_each_way_takes_beside_its_limit():
    report = bench_replay(seconds=0.32, repeats=1)
    assert report["frames"] == 10
    assert (report["write"]["reference"], report["write"]["limit"]) == (2.0, 1.0)
    assert (report["with_model"]["reference"], report["with_model"]["unit"]) == (10.0, "s")
    assert 0 < report["write"]["value"] < report["read_and_write"]["value"] + 1.0
    assert "60" not in report["text"].splitlines()[0]


@pytest.mark.parametrize("options", [{"seconds": 0.0}, {"seconds": 1e4}, {"repeats": 0}])
def test_absurd_lengths_are_refused(options):
    with pytest.raises(JengaError, match="allowed: 0 to 600, and 1 or more"):
        bench_replay(**options)
