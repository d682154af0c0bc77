"""Towers of blocks as on the box, put together by hand: what tests of geometry, graphs and outcomes stand on."""

import numpy as np

from jenga_data.blocks import Blocks, sample_blocks
from jenga_data.tower import Layout, TowerState, nominal_poses


def layout_of(*levels: str) -> Layout:
    """A layout drawn from the bottom: "xxx" is a full level, "x.x" has its sides only. Blocks are numbered in order."""
    taken = np.array([[c == "x" for c in level] for level in levels])
    grid = np.full(taken.shape, -1, np.int64)
    grid[taken] = np.arange(taken.sum())
    return Layout(grid)


def nominal_blocks(count: int) -> Blocks:
    return sample_blocks("nominal", np.random.default_rng(0), count)


def nominal_state(layout: Layout) -> TowerState:
    blocks = nominal_blocks(len(layout.level))
    return TowerState(blocks, layout, nominal_poses(layout), np.zeros((len(blocks), 6)))
