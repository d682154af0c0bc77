"""The rasteriser against geometry: what is nearer hides what is behind, from every side and for tilted boxes."""

import numpy as np
import pytest
from made_up_episode import random_quaternions
from scipy.spatial.transform import Rotation

from jenga_data.replay.raster import FACE_NORMALS, NOTHING, Camera, box_corners, box_faces, rasterise

IDENTITY = [1.0, 0.0, 0.0, 0.0]


def at(*centres: tuple[float, float, float]) -> np.ndarray:
    return np.array([[*centre, *IDENTITY] for centre in centres])


def box_seen(pose: np.ndarray, size: np.ndarray, camera: Camera, pixels: int = 120) -> np.ndarray:
    """Which box is at each pixel, -1 for none."""
    face, _ = rasterise(box_faces(pose, size), camera, pixels, pixels)
    return np.where(face == NOTHING, -1, face // 6)


@pytest.mark.parametrize("distance", [1.0, np.inf])
@pytest.mark.parametrize("elevation", [-0.4, 0.0, 0.7])
def test_unprojecting_is_the_inverse_of_projecting(distance: float, elevation: float) -> None:
    points = np.random.default_rng(0).uniform(-0.2, 0.2, (50, 3))
    camera = Camera.fitting(points, 2.0, elevation, distance=distance)
    np.testing.assert_allclose(camera.unproject(camera.project(points)), points, atol=1e-12)


def test_a_fitted_window_holds_all_points_and_has_the_aspect_asked_for() -> None:
    points = np.random.default_rng(1).uniform(-0.2, 0.2, (50, 3))
    camera = Camera.fitting(points, 1.0, 0.3, aspect=2.0)
    u, v, _ = camera.project(points).T
    u0, u1, v0, v1 = camera.window
    assert camera.aspect == pytest.approx(2.0)
    assert u.min() > u0
    assert u.max() < u1
    assert v.min() > v0
    assert v.max() < v1


def test_face_normals_point_out_of_the_box() -> None:
    faces = box_faces(at((0, 0, 0)), np.ones((1, 3)))
    np.testing.assert_allclose(faces.mean(axis=1), FACE_NORMALS / 2)
    turn = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 1])
    np.testing.assert_allclose(turn, FACE_NORMALS)


@pytest.mark.parametrize(("azimuth", "shown"), [(0.0, {1}), (np.pi, {0}), (np.pi / 2, {0, 1}), (-np.pi / 2, {0, 1})])
def test_the_box_in_front_hides_the_one_behind(azimuth: float, shown: set[int]) -> None:
    pose, size = at((-0.1, 0, 0), (0.1, 0, 0)), np.full((2, 3), 0.06)
    camera = Camera.fitting(box_corners(pose, size).reshape(-1, 3), azimuth, 0.0)
    assert set(np.unique(box_seen(pose, size, camera))) - {-1} == shown


@pytest.mark.parametrize("distance", [0.8, np.inf])
def test_every_pixel_shows_the_face_that_its_ray_meets_first(distance: float) -> None:
    """Against a slab test along each ray, on a heap of boxes that cut into each other at random angles."""
    rng = np.random.default_rng(2)
    pose = np.concatenate([rng.uniform(-0.05, 0.05, (12, 3)), random_quaternions(rng, 12)], axis=1)
    size = rng.uniform(0.02, 0.09, (12, 3))
    camera = Camera.fitting(box_corners(pose, size).reshape(-1, 3), 0.7, 0.5, distance=distance)
    seen = box_seen(pose, size, camera, pixels=60)
    u, v = np.meshgrid(*camera.pixel_grid(60, 60))
    near, far = (2 / distance, 0.5 / distance) if np.isfinite(distance) else (1.0, -1.0)
    start, end = (camera.unproject(np.stack([u, v, np.full_like(u, n)], axis=-1)) for n in (near, far))
    assert (seen == first_hit(start.reshape(-1, 3), end.reshape(-1, 3), pose, size).reshape(seen.shape)).mean() > 0.995


def first_hit(start: np.ndarray, end: np.ndarray, pose: np.ndarray, size: np.ndarray) -> np.ndarray:
    entry = np.full((len(pose), len(start)), np.inf)
    for i, (p, s) in enumerate(zip(pose, size, strict=True)):
        to_box = Rotation.from_quat(p[3:], scalar_first=True).inv()
        origin, ray = to_box.apply(start - p[:3]), to_box.apply(end - start)
        low, high = np.sort(np.stack([(-s / 2 - origin) / ray, (s / 2 - origin) / ray]), axis=0)
        enter, leave = low.max(axis=1), high.min(axis=1)
        entry[i] = np.where(enter < leave, enter, np.inf)
    return np.where(np.isfinite(entry).any(axis=0), entry.argmin(axis=0), -1)


def test_a_box_without_a_finite_pose_is_left_out() -> None:
    pose, size = at((0, 0, 0), (0.1, 0, 0)), np.full((2, 3), 0.06)
    camera = Camera.fitting(box_corners(pose, size).reshape(-1, 3), np.pi, 0.3)
    pose[0, 0] = np.nan
    assert set(np.unique(box_seen(pose, size, camera))) == {-1, 1}


def test_a_horizontal_plane_is_where_the_camera_says() -> None:
    for distance in (1.0, np.inf):
        camera = Camera.fitting(np.random.default_rng(3).uniform(-0.2, 0.2, (9, 3)), 1.0, 0.4, distance=distance)
        v = np.linspace(-0.2, 0.1, 7)
        points = camera.unproject(np.stack([v, v, camera.nearness_of_height(v, 0.03)], axis=-1))
        np.testing.assert_allclose(points[:, 2], 0.03, atol=1e-12)
