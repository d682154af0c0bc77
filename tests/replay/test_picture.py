"""Pictures show what must be seen: the target where it is, what hides it, ghosts, a name and a time a moment."""

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from made_up_episode import TARGET, nominal_pose
from matplotlib.figure import Figure

from jenga_data import palette
from jenga_data.blocks import sample_blocks
from jenga_data.episode import Episode, Prediction
from jenga_data.errors import JengaError
from jenga_data.replay.curves import episode_curves
from jenga_data.replay.picture import gripper_boxes, render_tower, tower_camera
from jenga_data.replay.solids import Boxes
from jenga_data.tower import Layout


def like(image: np.ndarray, colour: tuple[float, float, float], tolerance: float = 0.06) -> np.ndarray:
    """Pixels of that hue, however bright: the colour's direction, among pixels that are not nearly black."""
    size = np.linalg.norm(image, axis=-1)
    direction = image / np.maximum(size, 1e-9)[..., None]
    wanted = np.array(colour) / np.linalg.norm(colour)
    return (np.linalg.norm(direction - wanted, axis=-1) < tolerance) & (size > 0.2)


def draw(episode: Episode, frame: int, path: Path, **more) -> np.ndarray:
    return render_tower(
        path, episode.pose[frame], episode.header.blocks.size, target=TARGET, height=300, **more
    )  # fmt: skip


def test_the_target_moves_left_as_it_is_pulled(episode: Episode, tmp_path: Path) -> None:
    camera = tower_camera([Boxes(p, episode.header.blocks.size, np.zeros((54, 3))) for p in episode.pose[[0, -1]]])
    columns = []
    for frame in (0, 45, 119):
        image = draw(episode, frame, tmp_path / "t.png", camera=camera)
        blue = like(image, palette.TARGET)
        assert blue.sum() > 200
        columns.append(np.argwhere(blue)[:, 1].mean() / image.shape[1])
    assert columns[0] > columns[1] > columns[2]
    assert columns[2] < 0.35


def test_a_target_inside_the_tower_is_seen_from_its_own_side_only(tmp_path: Path) -> None:
    layout = Layout.fresh()
    blocks = sample_blocks("nominal", np.random.default_rng(0))
    pose = nominal_pose(layout, blocks, quarter_turn=0)
    centre = 31  # slot 1 of level 10, along x: only its two ends show
    for azimuth, visible in ((np.pi, True), (0.0, True), (np.pi / 2, False), (-np.pi / 2, False)):
        camera = tower_camera([Boxes(pose, blocks.size, np.zeros((54, 3)))], azimuth=azimuth, elevation=0.1)
        image = render_tower(tmp_path / "t.png", pose, blocks.size, target=centre, camera=camera, height=300)
        assert like(image, palette.TARGET).any() == visible


def test_the_gripper_hides_part_of_the_target(episode: Episode, tmp_path: Path) -> None:
    hand = gripper_boxes(episode, 60)
    camera = tower_camera([Boxes(episode.pose[60], episode.header.blocks.size, np.zeros((54, 3))), *hand])
    free = like(draw(episode, 60, tmp_path / "t.png", camera=camera), palette.TARGET).sum()
    held = like(draw(episode, 60, tmp_path / "t.png", camera=camera, others=hand), palette.TARGET).sum()
    assert 0.2 * free < held < 0.95 * free


def test_a_ghost_shows_where_it_departs_from_the_truth_and_not_where_it_agrees(
    episode: Episode, tmp_path: Path
) -> None:
    size = episode.header.blocks.size
    camera = tower_camera([Boxes(episode.pose[119], size, np.zeros((54, 3)))])

    def changed(shift: float) -> float:
        pose = episode.pose[119].copy()
        pose[TARGET, 1] -= shift
        ghost = Boxes(pose[[TARGET]], size[[TARGET]], np.array([palette.PURPLE]))
        plain, drawn = (draw(episode, 119, tmp_path / "t.png", camera=camera, ghosts=g) for g in ([], [ghost]))
        return float((np.abs(drawn - plain).max(axis=-1) > 0.1).mean())

    assert changed(0.05) > 3 * changed(0.0)
    assert changed(0.05) > 0.005


def test_a_picture_in_a_file_is_the_picture_returned(episode: Episode, tmp_path: Path) -> None:
    image = draw(episode, 0, tmp_path / "t.png")
    stored = matplotlib.image.imread(tmp_path / "t.png")[..., :3]
    np.testing.assert_allclose(stored, image, atol=1 / 255)


def test_drawing_into_axes_shows_the_picture(episode: Episode) -> None:
    axes = Figure().add_subplot()
    image = render_tower(axes, episode.pose[0], episode.header.blocks.size, height=100)
    assert axes.images[0].get_array() is not None
    assert image.shape[0] == 100


@pytest.mark.parametrize("x", [0.0, -0.22])
def test_a_block_in_the_air_casts_a_shadow_on_what_is_below(tmp_path: Path, x: float) -> None:
    """On the turntable in the middle, on the paper beside it: darker than without the block, but no other colour."""
    size = np.array([[0.075, 0.025, 0.015]])
    flying = np.array([[x, 0.0, 0.08, 1.0, 0.0, 0.0, 0.0]])
    camera = tower_camera([Boxes(flying + np.array([0, 0, -0.08, 0, 0, 0, 0]), size, np.zeros((1, 3)))])
    away = flying + np.array([0, 9.0, 0, 0, 0, 0, 0])
    under, empty = (render_tower(tmp_path / "t.png", p, size, camera=camera, height=240) for p in (flying, away))
    grey = under.max(axis=-1) - under.min(axis=-1) < 0.06
    assert ((under < 0.9 * empty).all(axis=-1) & grey).sum() > 200


def test_a_block_shades_the_one_below_it(tmp_path: Path) -> None:
    size = np.array([[0.075, 0.075, 0.015], [0.03, 0.03, 0.015]])
    pose = np.array([[0.0, 0.0, 0.0075, 1, 0, 0, 0], [0.0, 0.0, 0.06, 1, 0, 0, 0]])
    camera = tower_camera([Boxes(pose, size, np.zeros((2, 3)))], elevation=0.6)
    colours = np.array([[0.9, 0.7, 0.5], [0.6, 0.6, 0.6]])  # of the two, only the lower one is brown
    both = render_tower(tmp_path / "t.png", pose, size, colours=colours, camera=camera, height=240)
    alone = render_tower(tmp_path / "t.png", pose[:1], size[:1], colours=colours[:1], camera=camera, height=240)
    wooden = (both[..., 0] - both[..., 2]) > 0.08
    assert ((both < 0.85 * alone).all(axis=-1) & wooden).sum() > 50


def test_neighbours_of_one_colour_are_told_apart_by_a_drawn_edge(tmp_path: Path) -> None:
    size = np.full((2, 3), 0.05)
    pose = np.array([[0.0, -0.025, 0.025, 1, 0, 0, 0], [0.0, 0.025, 0.025, 1, 0, 0, 0]])
    camera = tower_camera([Boxes(pose, size, np.zeros((2, 3)))], azimuth=np.pi, elevation=0.1)
    grey = np.full((2, 3), 0.8)
    image = render_tower(tmp_path / "t.png", pose, size, colours=grey, camera=camera, height=240)
    u, v, _ = camera.project(np.array([-0.025, 0.0, 0.025]))
    columns, rows = camera.pixel_grid(image.shape[1], image.shape[0])
    middle_row, middle = int(np.argmin(np.abs(rows - v))), int(np.argmin(np.abs(columns - u)))
    row = image[middle_row, middle - 15 : middle + 15, 0]
    assert row.min() < 0.8 * np.median(row)


@pytest.mark.parametrize("with_model", [True, False])
def test_curves_have_a_labelled_panel_for_all_that_there_is(
    episode: Episode,
    predictions: list[Prediction],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    with_model: bool,
) -> None:
    figures: list[Figure] = []
    monkeypatch.setattr("jenga_data.replay.style.save", lambda figure, path: figures.append(figure))
    episode_curves(episode, predictions if with_model else [], tmp_path / "curves.png")
    panels = {axes.get_ylabel().replace("\n", " "): axes for axes in figures[0].axes}
    wanted = ["action [mm]", "fingertip force [N]", "others moved [mm]"]
    assert list(panels) == wanted + with_model * ["error of the others [mm]", "error of the target [mm]"]
    assert figures[0].axes[-1].get_xlabel() == "time [s]"
    assert [text.get_text() for text in figures[0].axes[0].texts] == ["approach", "grasp", "pull", "hold"]
    farthest = next(line for line in panels["others moved [mm]"].lines if line.get_label() == "farthest")
    assert episode.result is not None
    assert np.max(farthest.get_ydata()) == pytest.approx(1e3 * episode.result.verdict.moved)


def test_a_log_that_ends_early_has_its_curves_too(episode: Episode, tmp_path: Path) -> None:
    cut = type(episode)(**{**vars(episode), "phases": [], "result": None})
    episode_curves(cut, [], tmp_path / "curves.png")
    assert (tmp_path / "curves.png").stat().st_size > 10_000


def test_the_same_curves_give_the_same_bytes(episode: Episode, tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        episode_curves(episode, [], tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_picture_that_cannot_be_written_is_one_clear_line(episode: Episode, tmp_path: Path) -> None:
    with pytest.raises(JengaError, match=r"cannot write .*No such file"):
        draw(episode, 0, tmp_path / "missing" / "t.png")
    with pytest.raises(JengaError, match=r"cannot write .*No such file"):
        episode_curves(episode, [], tmp_path / "missing" / "c.png")
