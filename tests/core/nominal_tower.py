"""Towers of blocks as on the box, put together by hand: what tests of geometry, graphs and outcomes stand on."""

import numpy as np

from jenga_data.blocks import NOMINAL_SIZE, Blocks, sample_blocks
from jenga_data.tower import Layout, TowerState


def layout_of(*levels: str) -> Layout:
    """A layout drawn from the bottom: "xxx" is a full level, "x.x" has its sides only. Blocks are numbered in order."""
    taken = np.array([[c == "x" for c in level] for level in levels])
    grid = np.full(taken.shape, -1, np.int64)
    grid[taken] = np.arange(taken.sum())
    return Layout(grid)


def stacked_poses(layout: Layout, air: float = 0.0) -> np.ndarray:
    """Centres on an exact grid, `air` [m] between neighbours in a level."""
    _, width, height = NOMINAL_SIZE
    across = (layout.slot - 1) * (width + air)
    odd = layout.level % 2 == 1
    pose = np.zeros((len(across), 7))
    pose[:, 0] = np.where(odd, -across, 0.0)
    pose[:, 1] = np.where(odd, 0.0, across)
    pose[:, 2] = (layout.level + 0.5) * height
    pose[:, 3] = np.where(odd, np.sqrt(0.5), 1.0)
    pose[:, 6] = np.where(odd, np.sqrt(0.5), 0.0)
    return pose


def nominal_blocks(count: int) -> Blocks:
    return sample_blocks("nominal", np.random.default_rng(0), count)


def nominal_state(layout: Layout) -> TowerState:
    blocks = nominal_blocks(len(layout.level))
    return TowerState(blocks, layout, stacked_poses(layout), np.zeros((len(blocks), 6)))
