from itertools import product

import numpy as np
import pytest
from nominal_tower import layout_of, nominal_state
from scipy.spatial.transform import Rotation

from jenga_data.geometry import (
    clear_of_others,
    footprint_overlap,
    half_height,
    in_table_frame,
    rotation_matrices,
    vertical_gap,
)

Scene = tuple[np.ndarray, np.ndarray]
"""Poses and sizes."""


def tumbling(seed: int, boxes: int = 8, spread: float = 0.05) -> Scene:
    """Boxes in any orientation, some of them over each other."""
    rng = np.random.default_rng(seed)
    x, y, z, w = Rotation.random(boxes, rng).as_quat().T
    pose = np.column_stack([rng.normal(0, spread, (boxes, 3)), w, x, y, z])
    return pose, rng.uniform(0.01, 0.08, (boxes, 3))


def lying(xy: list[tuple[float, float]], yaw_deg: float = 0.0) -> np.ndarray:
    pose = np.zeros((len(xy), 7))
    pose[:, :2] = xy
    pose[:, 3], pose[:, 6] = np.cos(np.deg2rad(yaw_deg) / 2), np.sin(np.deg2rad(yaw_deg) / 2)
    return pose


def corners(pose: np.ndarray, size: np.ndarray) -> np.ndarray:
    """The eight corners of each box in the world (block, 8, 3), by scipy."""
    signs = np.array(list(product([-0.5, 0.5], repeat=3)))
    rotation = Rotation.from_quat(pose[:, [4, 5, 6, 3]])
    return np.stack([r.apply(signs * s) + p for r, s, p in zip(rotation, size, pose[:, :3], strict=True)])


def turned(pose: np.ndarray, angle: float, shift: np.ndarray) -> np.ndarray:
    rotation = Rotation.from_euler("z", angle)
    x, y, z, w = (rotation * Rotation.from_quat(pose[:, [4, 5, 6, 3]])).as_quat().T
    return np.column_stack([rotation.apply(pose[:, :3]) + shift, w, x, y, z])


# --- rotations and heights -----------------------------------------------------------------------------------------


def test_rotation_matrices_are_orthonormal_and_those_of_scipy():
    quat = tumbling(0, 100)[0][:, 3:]
    ours = rotation_matrices(quat)
    np.testing.assert_allclose(ours @ np.swapaxes(ours, -1, -2), np.broadcast_to(np.eye(3), (100, 3, 3)), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(ours), 1.0, atol=1e-14)
    np.testing.assert_allclose(ours, Rotation.from_quat(quat[:, [1, 2, 3, 0]]).as_matrix(), atol=1e-14)


def test_half_height_reaches_to_the_highest_and_the_lowest_corner():
    pose, size = tumbling(1)
    z = corners(pose, size)[..., 2]
    np.testing.assert_allclose(pose[:, 2] + half_height(pose, size), z.max(axis=1), atol=1e-15)
    np.testing.assert_allclose(pose[:, 2] - half_height(pose, size), z.min(axis=1), atol=1e-15)


def test_vertical_gap_is_from_the_top_of_the_lower_to_the_bottom_of_the_upper():
    pose, size = tumbling(2)
    z = corners(pose, size)[..., 2]
    expected = z.min(axis=1)[:, None] - z.max(axis=1)[None, :]
    np.testing.assert_allclose(vertical_gap(pose, size), expected, atol=1e-15)


# --- footprints ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("yaw", [0.0, 90.0, 180.0])
def test_overlap_of_boxes_along_the_axes_is_that_of_their_rectangles(yaw):
    rng = np.random.default_rng(3)
    pose, size = lying(rng.uniform(-0.06, 0.06, (30, 2)).tolist(), yaw), rng.uniform(0.01, 0.08, (30, 3))
    half = size[:, [1, 0]] / 2 if yaw == 90 else size[:, :2] / 2
    low, high = pose[:, :2] - half, pose[:, :2] + half
    expected = (np.minimum(high[:, None], high) - np.maximum(low[:, None], low)).min(-1)
    np.testing.assert_allclose(footprint_overlap(pose, size), expected, atol=1e-12)


def test_crossed_blocks_overlap_by_a_width():
    pose = np.concatenate([lying([(0, 0)]), lying([(0.01, 0.02)], 90)])
    overlap = footprint_overlap(pose, np.tile([0.075, 0.025, 0.015], (2, 1)))
    np.testing.assert_allclose(overlap, [[0.025, 0.025], [0.025, 0.025]], atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_overlap_is_the_least_over_all_directions(seed):
    """Shadows on 3,600 directions come close to the least, which lies across an edge."""
    pose, size = tumbling(seed)
    angle = np.linspace(0, np.pi, 3600, endpoint=False)
    shadow = corners(pose, size)[..., :2] @ np.stack([np.cos(angle), np.sin(angle)])  # (block, corner, direction)
    low, high = shadow.min(axis=1), shadow.max(axis=1)
    searched = (np.minimum(high[:, None], high) - np.maximum(low[:, None], low)).min(-1)
    overlap = footprint_overlap(pose, size)
    together = searched > 0
    assert 8 < together.sum() < 64
    np.testing.assert_array_equal(overlap > 0, together)
    assert (overlap[together] <= searched[together] + 1e-12).all()
    np.testing.assert_allclose(overlap[together], searched[together], atol=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_overlap_is_symmetric_and_does_not_depend_on_where_and_how_the_scene_lies(seed):
    pose, size = tumbling(seed)
    overlap = footprint_overlap(pose, size)
    np.testing.assert_array_equal(overlap, overlap.T)
    moved = turned(pose, 0.3 + seed, np.array([0.2, -0.7, 0.5]))
    np.testing.assert_allclose(footprint_overlap(moved, size), overlap, atol=1e-12)


def test_overlap_does_not_depend_on_the_numbering():
    pose, size = tumbling(5)
    order = np.random.default_rng(5).permutation(len(pose))
    expected = footprint_overlap(pose, size)[np.ix_(order, order)]
    np.testing.assert_allclose(footprint_overlap(pose[order], size[order]), expected, atol=1e-15)


def test_overlap_of_a_tumbling_block_does_not_jump():
    """Also where two of its edges cast shadows of equal length, and where an edge stands upright."""
    angles = np.linspace(0, np.pi, 2001)
    pose = np.repeat(lying([(0, 0), (0.03, 0.02)])[None], len(angles), axis=0)
    x, y, z, w = (Rotation.from_euler("z", 0.4) * Rotation.from_rotvec(angles[:, None] * [0.36, 0.8, 0.48])).as_quat().T
    pose[:, 0, 3:] = np.stack([w, x, y, z], axis=1)
    size = np.array([[0.075, 0.025, 0.015], [0.075, 0.025, 0.015]])
    overlap = footprint_overlap(pose, size)[:, 0, 1]
    assert overlap.max() > 0.01
    # A corner lies at most 0.041 m from the centre, so no shadow changes faster than that a radian.
    assert np.abs(np.diff(overlap)).max() < 2 * 0.041 * np.pi / 2000


# --- a target clear of the tower -----------------------------------------------------------------------------------


def test_a_block_is_clear_when_nothing_lies_above_or_below_any_part_of_it():
    state = nominal_state(layout_of("xxx", "xxx", "xxx"))
    size, target = state.blocks.size, 4
    for out, clear in [(0.0, False), (0.070, False), (0.0749, False), (0.0751, True), (0.2, True)]:
        pose = state.pose.copy()
        pose[target, 1] -= out  # a block of level 1 lies along y, 75 mm long like the tower is wide
        assert clear_of_others(pose, size, target) == clear


@pytest.mark.parametrize("target", [0, 3, -1])
def test_a_block_is_clear_exactly_where_no_footprint_overlaps_its_own(target):
    rng = np.random.default_rng(0)
    pose = np.concatenate([rng.normal(0, 0.08, (200, 12, 3)), rng.normal(size=(200, 12, 4))], axis=-1)
    pose[..., 3:] /= np.linalg.norm(pose[..., 3:], axis=-1, keepdims=True)
    size = np.tile([0.075, 0.025, 0.015], (12, 1))
    overlap = np.delete(footprint_overlap(pose, size)[:, target], target, axis=-1)
    clear = clear_of_others(pose, size, target)
    np.testing.assert_array_equal(clear, (overlap <= 0).all(-1))
    assert 0 < clear.sum() < len(clear)


def test_only_the_target_need_be_clear():
    size = np.tile([0.075, 0.025, 0.015], (3, 1))
    pose = lying([(0, 0), (0, 0.01), (0.5, 0)])
    assert clear_of_others(pose, size, 2)
    assert not clear_of_others(pose, size, 0)


# --- batches -------------------------------------------------------------------------------------------------------


def test_batch_axes_are_loops():
    scenes = [tumbling(seed, 6) for seed in range(6)]
    size = scenes[0][1]
    pose = np.stack([p for p, _ in scenes]).reshape(2, 3, 6, 7)
    many = np.stack([s for _, s in scenes]).reshape(2, 3, 6, 3)
    for function in (footprint_overlap, vertical_gap, half_height):
        with_one_size, with_their_own = function(pose, size), function(pose, many)
        for i, j in np.ndindex(2, 3):
            np.testing.assert_allclose(with_one_size[i, j], function(pose[i, j], size), atol=1e-15)
            np.testing.assert_allclose(with_their_own[i, j], function(pose[i, j], many[i, j]), atol=1e-15)
    for i, j in np.ndindex(2, 3):
        np.testing.assert_array_equal(clear_of_others(pose, size, 2)[i, j], clear_of_others(pose[i, j], size, 2))
        np.testing.assert_array_equal(rotation_matrices(pose[..., 3:])[i, j], rotation_matrices(pose[i, j, :, 3:]))


def test_what_turns_with_the_turntable_stands_still_in_its_frame():
    pose, _ = tumbling(4)
    angle = np.array([0.0, 0.3, np.pi / 2, -2.0, 7.5])
    seen = in_table_frame(np.stack([turned(pose, a, np.zeros(3)) for a in angle]), angle)
    np.testing.assert_allclose(seen[..., :3], np.broadcast_to(pose[:, :3], (5, 8, 3)), atol=1e-15)
    axes = rotation_matrices(seen[..., 3:])
    np.testing.assert_allclose(axes, np.broadcast_to(rotation_matrices(pose[:, 3:]), axes.shape), atol=1e-14)


def test_where_the_turntable_never_turned_its_frame_is_the_world():
    pose = np.stack([tumbling(seed)[0] for seed in range(3)])
    seen = in_table_frame(pose, np.zeros(3))
    np.testing.assert_array_equal(seen[..., :3], pose[..., :3])
    np.testing.assert_allclose(rotation_matrices(seen[..., 3:]), rotation_matrices(pose[..., 3:]), atol=1e-15)


def test_the_frame_of_the_turntable_turns_against_it():
    """After a quarter turn of the table, what stayed behind at +x in the world is at -y of the table."""
    stays = np.array([[[1.0, 0, 0, 1, 0, 0, 0]]])
    seen = in_table_frame(stays, np.array([np.pi / 2]))[0, 0]
    np.testing.assert_allclose(seen[:3], [0, -1, 0], atol=1e-15)
    np.testing.assert_allclose(rotation_matrices(seen[3:])[:, 0], [0, -1, 0], atol=1e-15)
