"""Solids of a robot: their faces, how they look from every side, and their bounds."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from made_up_episode import random_quaternions

from jenga_data.episode import Link, RobotModel, Solid
from jenga_data.replay.picture import render_tower
from jenga_data.replay.raster import NOTHING, Camera, rasterise
from jenga_data.replay.solids import Faces, robot_faces, solid_bounds, solid_quads

R, LENGTH = 0.02, 0.05
BALL = 4 / 3 * np.pi * R**3
SHAPES = [
    ("box", (0.1, 0.02, 0.03), 0.1 * 0.02 * 0.03),
    ("sphere", (R, 0.0, 0.0), BALL),
    ("cylinder", (R, LENGTH, 0.0), np.pi * R**2 * LENGTH),
    ("capsule", (R, LENGTH, 0.0), np.pi * R**2 * LENGTH + BALL),
]


@pytest.mark.parametrize(("shape", "size", "volume"), SHAPES)
def test_faces_enclose_the_solid_and_point_outwards(shape: str, size: tuple[float, float, float], volume: float):
    """The divergence theorem: the sum of centre . normal . area / 3 is the volume, less if a face shows its back."""
    corner, patch = solid_quads(shape, size)
    faces = Faces(corner, np.zeros((len(patch), 3)), patch)
    triangles = np.concatenate([corner[:, [0, 1, 2]], corner[:, [0, 2, 3]]])
    signed = np.linalg.det(triangles) / 6
    assert (signed > -1e-15).all()
    assert 0.95 * volume < signed.sum() <= volume * (1 + 1e-9)
    assert (np.einsum("fi,fi->f", faces.normals(), corner.mean(axis=1)) > 0).all()


def test_an_unknown_shape_is_a_bug() -> None:
    with pytest.raises(ValueError, match="no solid has the shape 'cone'"):
        solid_quads("cone", (1.0, 1.0, 0.0))


@pytest.mark.parametrize("elevation", [-1.5, -0.4, 0.0, 0.7, 1.5])
def test_a_ball_is_round_from_every_side(elevation: float) -> None:
    corner, _ = solid_quads("sphere", (R, 0.0, 0.0))
    around = np.array(list(product([-R, R], repeat=3)))
    camera = Camera.fitting(around, 0.3, elevation, distance=np.inf, aspect=1.0)
    face, _ = rasterise(corner, camera, 200, 200)
    low, high = camera.window[:2]
    area = (face != NOTHING).mean() * (high - low) ** 2
    assert 0.94 * np.pi * R**2 < area < np.pi * R**2


@pytest.mark.parametrize(("shape", "size"), [(shape, size) for shape, size, _ in SHAPES])
def test_bounding_boxes_hold_their_solids_and_touch_them(shape: str, size: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(0)
    own, links = (np.concatenate([rng.normal(size=(n, 3)), random_quaternions(rng, n)], axis=1) for n in (1, 7))
    x, y, z, qw, qx, qy, qz = own[0].tolist()
    model = RobotModel((), (Link("a", (Solid(shape, size, (x, y, z, qw, qx, qy, qz), (1.0, 1.0, 1.0, 1.0)),)),))
    low, high = solid_bounds(model, links[:, None])
    for k, pose in enumerate(links):
        corners = robot_faces(model, pose[None]).corners()
        assert (corners > low[k] - 1e-12).all()
        assert (corners < high[k] + 1e-12).all()
        np.testing.assert_allclose(corners.max(axis=0) - corners.min(axis=0), (high - low)[k, 0], rtol=0.06)


def test_round_sides_have_no_drawn_edges(tmp_path: Path) -> None:
    """Dark lines stand between patches: from the light's side a ball has none, and a box three about its corner."""

    def darkest(shape: str, size: tuple[float, float, float]) -> float:
        corner, patch = solid_quads(shape, size)
        faces = Faces(corner + np.array([0, 0, 0.1]), np.ones((len(patch), 3)), patch)
        nothing = np.zeros((0, 7)), np.zeros((0, 3))
        camera = Camera.fitting(faces.corners(), np.radians(231.0), np.radians(55.0), aspect=1.0)
        image = render_tower(tmp_path / "t.png", *nothing, others=[faces], camera=camera, height=100)
        return float(image[40:60, 40:60].min())

    assert darkest("sphere", (R, 0.0, 0.0)) > 0.55
    assert darkest("box", (R, R, R)) < 0.55
