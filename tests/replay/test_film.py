"""An animated picture shows the whole episode at its own pace, and a prediction only where it differs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up_episode import make_prediction
from PIL import Image

from jenga_data.episode import Episode, Prediction
from jenga_data.palette import TARGET, model_colour
from jenga_data.replay.film import SLOWED, film_frames, write_film
from jenga_data.replay.measures import seconds


def pictures(path: Path) -> list[np.ndarray]:
    with Image.open(path) as film:
        found = []
        for number in range(frames_in(film)):
            film.seek(number)
            found.append(np.asarray(film.convert("RGB"), float) / 255)
        return found


def frames_in(film: Image.Image) -> int:
    return int(getattr(film, "n_frames", 1))


def near(picture: np.ndarray, colour: tuple[float, float, float]) -> int:
    """Pixels of that hue, in whatever light."""
    share = picture / np.maximum(picture.sum(-1, keepdims=True), 1e-9)
    return int((np.abs(share - np.array(colour) / sum(colour)).max(-1) < 0.04).sum())


def test_it_lasts_as_long_as_the_episode_and_rests_on_its_end(episode: Episode, tmp_path: Path) -> None:
    path = write_film(tmp_path / "x.gif", episode, height=120)
    shown, _ = film_frames(episode)
    assert shown[0] == 0
    assert shown[-1] == len(episode.time_ns) - 1
    with Image.open(path) as film:
        assert frames_in(film) == len(shown)
        assert film.info["loop"] == 0
        lasted = 0
        for number in range(frames_in(film)):
            film.seek(number)
            lasted += film.info["duration"]
    acting = seconds(episode)[episode.action_frame[-1] + 1] - seconds(episode)[episode.action_frame[0]]
    slowed = float(seconds(episode)[-1] + (SLOWED - 1) * acting)
    assert lasted / 1e3 == pytest.approx(slowed + 2.0, abs=0.02 * len(shown))


def test_every_frame_of_a_pull_is_shown(episode: Episode) -> None:
    shown, lasts = film_frames(episode)
    assert set(episode.action_frame) <= set(shown)
    step = float(np.diff(seconds(episode))[0])
    of_pull = [last for frame, last in zip(shown, lasts, strict=True) if frame in episode.action_frame]
    np.testing.assert_allclose(of_pull, SLOWED * step)


def test_the_target_moves_through_it(episode: Episode, tmp_path: Path) -> None:
    shown = pictures(write_film(tmp_path / "x.webp", episode, height=160))
    assert near(shown[0], TARGET) > 0
    assert np.abs(shown[0] - shown[-1]).max() > 0.3


def test_a_ghost_is_there_where_the_model_is_wrong_and_only_then(episode: Episode, tmp_path: Path) -> None:
    frame = np.array(film_frames(episode)[0][1:3])
    right = make_prediction(episode, "gns", "open_loop", frame, 0.0, 0)
    aside = right.pose.copy()
    aside[:, :, 1] += 0.03
    colour = model_colour(0)

    def ghostly(name: str, predictions: list[Prediction]) -> list[int]:
        return [near(p, colour) for p in pictures(write_film(tmp_path / name, episode, predictions, height=160))[:4]]

    none, true, wrong = (
        ghostly("a.webp", []),
        ghostly("b.webp", [right]),
        ghostly("c.webp", [replace(right, pose=aside)]),
    )
    assert true[0] - none[0] == wrong[0] - none[0] == 0  # it says nothing of the first frame
    assert max(true[1] - none[1], true[2] - none[2]) < 30  # edges, as wide as a ghost's faces are nearer than the truth
    assert min(wrong[1] - none[1], wrong[2] - none[2]) > 100
    assert abs(wrong[3] - none[3]) <= 3


def test_physics_that_broke_ends_the_film_before_it(episode: Episode, tmp_path: Path) -> None:
    pose = episode.pose.copy()
    pose[50:] = np.nan
    broken = replace(episode, pose=pose)
    shown, _ = film_frames(broken)
    assert shown[-1] == 49
    assert len(pictures(write_film(tmp_path / "x.gif", broken, height=80))) == len(shown)
