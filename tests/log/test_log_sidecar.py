import dataclasses

import numpy as np
import pytest
from synthetic_log import make_script, write

from jenga_data.episode import Prediction
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.log.files import file_sha256, prediction_path
from jenga_data.log.reader import read_episode, read_header
from jenga_data.log.sidecar import read_prediction, write_prediction

BLOCKS = 6
CHECKPOINT = "c0ffee" * 10


@pytest.fixture
def episode(log):
    return read_episode(log)


@pytest.fixture
def prediction(episode):
    rng = np.random.default_rng(0)
    probability = rng.uniform(size=BLOCKS)
    probability[2] = np.nan
    frame = np.arange(1, len(episode.time_ns))
    return Prediction("gns", CHECKPOINT, "one_step", frame, rng.normal(size=(len(frame), BLOCKS, 7)), probability)


@pytest.fixture
def sidecar(log, episode, prediction):
    path = prediction_path(log, CHECKPOINT, "one_step")
    write_prediction(path, episode, file_sha256(log), prediction)
    return path


def made_for(log, episode, **changes):
    return {
        "episode_key": episode.header.key,
        "episode_sha256": file_sha256(log),
        "checkpoint": CHECKPOINT,
    } | changes


def test_prediction_comes_back_exactly(log, episode, prediction, sidecar):
    read = read_prediction(sidecar, **made_for(log, episode))
    for field in dataclasses.fields(prediction):
        a, b = getattr(prediction, field.name), getattr(read, field.name)
        assert np.array_equal(a, b, equal_nan=True) if field.name == "failure_probability" else np.all(a == b)
    assert read.pose.shape == prediction.pose.shape


def test_a_selectors_prediction_has_no_poses(log, episode, sidecar):
    selector = Prediction("gcn", CHECKPOINT, "one_step", np.zeros(0, np.int64), np.zeros((0, 6, 7)), np.full(6, 0.5))
    write_prediction(sidecar, episode, file_sha256(log), selector)
    read = read_prediction(sidecar, **made_for(log, episode))
    assert read.pose.shape == (0, 6, 7)
    assert read.failure_probability.tolist() == [0.5] * 6


@pytest.mark.parametrize("what", ["episode_key", "episode_sha256", "checkpoint"])
def test_a_stale_prediction_is_refused(log, episode, sidecar, what):
    with pytest.raises(CheckFailed, match=r"is stale: made for [^\n]*; delete it and run jenga replay again$"):
        read_prediction(sidecar, **made_for(log, episode, **{what: "0" * 64}))


def test_prediction_of_an_episode_that_was_written_again_is_refused(log, episode, sidecar):
    write(log, make_script(seed=1))
    with pytest.raises(CheckFailed, match="is stale: made for episode file"):
        read_prediction(sidecar, **made_for(log, read_episode(log)))


def test_episode_and_prediction_are_not_taken_for_each_other(log, episode, sidecar):
    for read in (read_episode, read_header):
        with pytest.raises(JengaError, match="is a model's prediction; give the episode"):
            read(sidecar)
    with pytest.raises(JengaError, match="is no prediction: its MCAP profile is 'jenga'"):
        read_prediction(log, **made_for(log, episode))


def test_a_cut_off_prediction_is_refused(log, episode, sidecar):
    sidecar.write_bytes(sidecar.read_bytes()[:-50])
    with pytest.raises(CheckFailed, match=r"damaged at [^\n]*; delete it and run jenga replay again"):
        read_prediction(sidecar, **made_for(log, episode))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": "../gns"}, r"model name '../gns'; allowed: letters, digits and _ . -"),
        ({"kind": "guess"}, "prediction kind 'guess'; allowed: one_step, open_loop"),
        ({"frame": np.arange(2, 13)}, "prediction for frames 2 to 12; the episode has frames 0 to 11"),
    ],
)
def test_what_does_not_fit_the_episode_is_not_written(log, episode, prediction, changes, message, tmp_path):
    path = tmp_path / "new.prediction.mcap"
    with pytest.raises(JengaError, match=message):
        write_prediction(path, episode, file_sha256(log), dataclasses.replace(prediction, **changes))
    assert not list(tmp_path.glob("new*"))


def test_name_tells_episode_kind_and_checkpoint(log):
    names = {
        prediction_path(episode, checkpoint, kind).name
        for episode in (log, log.with_name("other.mcap"))
        for checkpoint in (CHECKPOINT, "deed" * 16)
        for kind in ("one_step", "open_loop")
    }
    assert len(names) == 8
    assert all(name.endswith(".prediction.mcap") for name in names)
