"""Towers put together by hand, and spawned ones of few levels."""

from functools import partial
from unittest.mock import patch

import numpy as np

from jenga_data.blocks import NOMINAL_SIZE, sample_blocks
from jenga_data.collect import spawn
from jenga_data.tower import Layout


def short_towers(levels: int):
    """While this holds, a tower is spawned with so many levels; a context manager."""
    return patch.object(spawn, "sample_blocks", partial(sample_blocks, count=3 * levels))


def layout_of(*levels: str) -> Layout:
    """A layout drawn from the bottom: "xxx" is a full level, "x.x" has its sides only. Blocks are numbered in order."""
    taken = np.array([[c == "x" for c in level] for level in levels])
    grid = np.full(taken.shape, -1, np.int64)
    grid[taken] = np.arange(taken.sum())
    return Layout(grid)


def stacked_poses(layout: Layout, air: float) -> np.ndarray:
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
