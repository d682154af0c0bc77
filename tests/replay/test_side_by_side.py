"""Figures of several towers show what differs between them: the target's place, an empty slot, how it ended, when."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up_episode import TARGET, nominal_pose
from matplotlib.figure import Figure

from jenga_control.replay import replay
from jenga_data import palette
from jenga_data.blocks import Blocks, sample_blocks
from jenga_data.episode import Episode, Result
from jenga_data.errors import JengaError
from jenga_data.outcome import Outcome, Verdict
from jenga_data.replay import style
from jenga_data.replay.moments import Moment, telling_moments
from jenga_data.replay.side_by_side import film_strip, tower_grid
from jenga_data.tower import EMPTY, Layout, TowerState


def pictures(figure: Figure) -> list[np.ndarray]:
    """What stands in the axes of a figure, from left to right."""
    return [np.asarray(axes.images[0].get_array()) for axes in figure.axes]


def texts(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.texts]


def blue(image: np.ndarray) -> np.ndarray:
    """Rows and columns of the pixels in the target's colour."""
    direction = image / np.maximum(np.linalg.norm(image, axis=-1), 1e-9)[..., None]
    wanted = np.array(palette.TARGET) / np.linalg.norm(palette.TARGET)
    return np.argwhere((np.linalg.norm(direction - wanted, axis=-1) < 0.06) & (image.sum(-1) > 0.3))


def fallen(episode: Episode) -> Episode:
    """The episode with its uppermost block on the table from frame 90 on."""
    pose = episode.pose.copy()
    pose[90:, -1, 2] = 0.0075
    pose[90:, -1, 0] = 0.1
    verdict = Verdict(Outcome.COLLAPSED, dragged=True, moved=0.271, clear_frame=-1)
    return replace(episode, pose=pose, result=Result(verdict))


def ended(episode: Episode, outcome: Outcome, cause: str = "") -> Episode:
    return replace(episode, result=Result(Verdict(outcome, False, 0.0042, -1), cause))


def standing(levels: int, without: int | None = None) -> TowerState:
    """A nominal tower; the block `without` is left out and the others keep their places."""
    full = Layout.fresh(np.arange(3 * levels))
    blocks = sample_blocks("nominal", np.random.default_rng(0), 3 * levels)
    pose = nominal_pose(full, blocks, 0)
    kept = np.array([b for b in range(3 * levels) if b != without])
    grid = np.full_like(full.grid, EMPTY)
    for new, old in enumerate(kept):
        grid[full.grid == old] = new
    part = Blocks(blocks.size[kept], blocks.mass[kept])
    return TowerState(part, Layout(grid), pose[kept], np.zeros((len(kept), 6)))


def test_an_empty_side_slot_lets_the_background_through() -> None:
    """Where the block at the right border of the tower was, the paper shows; far from it nothing changes."""
    whole, hollow = standing(6), standing(6, without=3 * 4)
    before, after = pictures(tower_grid([whole, hollow], ["all", "one out"], height=240))
    appeared = (after > 0.97).all(axis=-1) & ~(before > 0.97).all(axis=-1)
    assert 20 < appeared.sum() < 0.05 * appeared.size


def test_a_middle_slot_that_is_empty_is_a_dark_hole() -> None:
    """Its block's own faces are lit; what is seen through the hole lies in the shade."""
    for middle in (3 * 4 + 1, 3 * 3 + 1):  # one of each direction, so that both visible sides of the tower are tried
        before, after = pictures(tower_grid([standing(6), standing(6, without=middle)], ["all", "one out"], height=240))
        changed = np.abs(after - before).max(axis=-1) > 0.1
        assert changed.sum() > 30
        assert after[changed].mean() < 0.9 * before[changed].mean()


def test_towers_of_a_grid_share_one_scale_and_carry_their_titles() -> None:
    """A tower of six levels is a third as high as one of eighteen, and as much of its top shows as before."""
    figure = tower_grid([standing(18), standing(6)], ["high", "low"], height=300)
    heights = [np.ptp(np.argwhere(image[..., 0] - image[..., 2] > 0.12)[:, 0]) for image in pictures(figure)]
    assert 0.35 < heights[1] / heights[0] < 0.55
    assert texts(figure) == ["high", "low"]


def test_towers_of_a_grid_stand_in_rows() -> None:
    figure = tower_grid([standing(3)] * 3, ["a", "b", "c"], columns=2, height=80)
    left, right, below = (axes.get_position() for axes in figure.axes)
    assert left.y0 == right.y0
    assert left.x1 <= right.x0
    assert below.x0 == left.x0
    assert below.y1 < left.y0


def test_the_target_moves_towards_minus_x_from_picture_to_picture(episode: Episode) -> None:
    figure = film_strip(episode, [Moment(f, "") for f in (0, 45, 70)], height=200)
    columns = [blue(image)[:, 1].mean() for image in pictures(figure)]
    assert columns[0] > columns[1] > columns[2]


def test_a_strip_names_each_moment_its_time_the_outcome_and_the_largest_displacement(episode: Episode) -> None:
    figure = film_strip(episode, height=100)
    assert episode.result is not None
    title, what, *captions = texts(figure)
    moved = 1e3 * episode.result.verdict.moved
    assert title == f"{episode.result.verdict.outcome}; largest displacement of another block: {moved:.1f} mm"
    assert what == f"block {TARGET}: level 9, slot 0 (side), tower of round 1, extraction episode 3"
    assert captions[0] == "start\n0.00 s"
    assert len(captions) == len(figure.axes) == 6


def test_a_strip_refuses_a_frame_that_is_not_there(episode: Episode) -> None:
    with pytest.raises(JengaError, match=r"frame 120 is not in the episode; it has frames 0 to 119"):
        film_strip(episode, [Moment(120, "")])


def test_an_extraction_is_shown_until_two_seconds_after_it_was_clear(episode: Episode) -> None:
    clear = 50
    verdict = Verdict(Outcome.EXTRACTED, False, 0.004, clear)
    moments = telling_moments(replace(episode, result=Result(verdict)))
    frames = {moment.name: moment.frame for moment in moments}
    assert [m.name for m in moments] == ["start", "grasped", "pull", "clear", "1 s later", "2 s later"]
    assert frames["grasped"] < frames["pull"] < frames["clear"] == clear
    assert episode.time_ns[frames["2 s later"]] - episode.time_ns[clear] == pytest.approx(2e9, abs=33e6)


def test_a_collapse_is_shown_around_the_fall(episode: Episode) -> None:
    moments = telling_moments(fallen(episode))
    assert [m.name for m in moments] == ["start", "grasped", "before the fall", "falls", "falls", "end"]
    before, at = moments[2].frame, moments[3].frame
    assert at == 90
    assert 80 < before < 90
    assert moments[-1].frame == len(episode.pose) - 1


def test_a_fall_right_after_the_pull_begins_has_its_moments_in_order(episode: Episode) -> None:
    """Fifteen frames from the servo's first pull to the fall, hardly more than what is shown before a fall."""
    early = fallen(episode)
    part = {
        name: getattr(early, name)[75:] for name in ("time_ns", "pose", "twist", "contacts", "sim_state", "turntable")
    }
    phases = [replace(early.phases[0], frame=0, name="pull"), replace(early.phases[0], frame=15, name="observe")]
    moments = telling_moments(replace(early, **part, phases=phases))
    assert [m.name for m in moments] == ["start", "pull", "before the fall", "falls", "falls", "end"]


def test_a_stuck_block_is_shown_until_the_end(episode: Episode) -> None:
    stuck = ended(episode, Outcome.STUCK)
    phases = [*stuck.phases[:-1], replace(stuck.phases[-1], name="observe")]
    moments = telling_moments(replace(stuck, phases=phases))
    assert [m.name for m in moments] == ["start", "grasped", "pull", "pull ends", "observe", "end"]
    assert moments[3].frame == 70
    assert moments[-1].frame == 119


@pytest.mark.parametrize("frames", [1, 2, 4])
def test_a_log_that_ends_early_shows_every_frame_it_has(episode: Episode, frames: int) -> None:
    fields = {
        name: getattr(episode, name)[:frames]
        for name in ("time_ns", "pose", "twist", "contacts", "sim_state", "turntable")
    }
    cut = replace(episode, **fields, phases=[], result=None)
    assert [m.frame for m in telling_moments(cut)] == list(range(frames))
    assert texts(film_strip(cut, height=60))[0].startswith("unknown: the log ends before its outcome; largest")


def test_broken_physics_are_shown_as_far_as_there_are_numbers(episode: Episode) -> None:
    """Also with a block a thousand kilometres away, which must not widen the view or fill the memory."""
    pose = episode.pose.copy()
    pose[60:, 5, :3], pose[80:, 5, :3] = 1e6, np.nan
    verdict = Verdict(Outcome.INVALID, False, float("nan"), -1)
    broken = replace(episode, pose=pose, result=Result(verdict))
    assert max(m.frame for m in telling_moments(broken)) == 79
    figure = film_strip(broken, height=60)
    assert texts(figure)[0] == "invalid; largest displacement of another block: unknown"
    assert all(len(blue(image)) for image in pictures(figure))


def test_a_strip_is_written_without_rerun(episode: Episode, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "jenga_data.replay.rerun_adapter", None)
    monkeypatch.setattr("jenga_control.replay.read_episode", lambda path: episode)
    strip = tmp_path / "strip.png"
    assert replay([tmp_path / "e.mcap"], strip=strip) == [strip]
    assert strip.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("name", "models", "line"),
    [
        (
            "missing/strip.png",
            (),
            r"^cannot write .*strip\.png: No such file or directory; choose another path$",
        ),
        ("strip.jpg", (), r"^--strip writes a PNG; .*strip\.jpg does not end in \.png$"),
        ("strip.png", ("model",), r"^--strip shows no model; leave --model out, or add --save, --png or --film$"),
    ],
)
def test_a_strip_that_cannot_be_is_refused_in_one_line(
    episode: Episode, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, models: tuple[str, ...], line: str
) -> None:
    monkeypatch.setattr("jenga_control.replay.read_episode", lambda path: episode)
    with pytest.raises(JengaError, match=line):
        replay([tmp_path / "e.mcap"], [Path(m) for m in models], strip=tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_the_same_strip_gives_the_same_bytes(episode: Episode, tmp_path: Path) -> None:
    with style.applied():
        for name in ("a.png", "b.png"):
            style.save(film_strip(episode, height=80), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
