"""Datasets in memory and untrained checkpoints, for what sits on top of both."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from jenga_data.dataset.read import Edges
from jenga_data.graph import support_edges
from jenga_data.graph_spec import graph_spec
from jenga_data.tower import Layout
from jenga_models.checkpoint import save
from jenga_models.features import attribute_width
from jenga_models.normalisation import Normalisation
from jenga_models.registry import build

BLOCKS = 9
SIZE = np.array([0.075, 0.025, 0.015])


class MadeUpDataset:
    """What `jenga_data.dataset.read.Dataset` offers, and a note of every row asked for by split."""

    hash = "5" * 64

    def __init__(self, kind, columns, splits):
        self.manifest = SimpleNamespace(name="made-up", version="1.0.0", kind=kind, blocks=BLOCKS)
        self.columns, self.splits, self.asked = columns, splits, []
        self.folder: Any = "made-up"
        self.episodes: Any = None

    def __len__(self):
        return len(self.columns["target"])

    def rows(self, split):
        self.asked.append(split)
        return np.flatnonzero(np.isin(self.splits, split.split("+")))

    def column(self, name):
        return self.columns[name]

    def edges(self):
        size = self.columns["block_size"][0].astype(float)
        edges = [support_edges(pose.astype(float), size) for pose in self.columns["block_pose"]]
        offset = np.cumsum([0, *(e.shape[1] for e in edges)])
        upper, lower = np.concatenate(edges, axis=1)
        return Edges(offset, upper, lower, np.zeros(len(upper), np.float32))


def nominal_pose():
    layout = Layout.fresh(np.arange(BLOCKS))
    pose = np.zeros((BLOCKS, 7))
    pose[:, 2] = (layout.level + 0.5) * SIZE[2]
    even, across = layout.orientation == 0, (layout.slot - 1) * SIZE[1]
    pose[even, 1], pose[~even, 0] = across[even], -across[~even]
    pose[even, 3] = 1.0
    pose[~even, 3] = pose[~even, 6] = np.sqrt(0.5)
    return pose


def _state(target, tower):
    rows, layout = len(target), Layout.fresh(np.arange(BLOCKS))
    return {
        "block_size": np.tile(SIZE, (rows, BLOCKS, 1)).astype(np.float32),
        "block_mass": np.full((rows, BLOCKS), 0.019, np.float32),
        "block_pose": np.tile(nominal_pose(), (rows, 1, 1)).astype(np.float32),
        "level": np.tile(layout.level, (rows, 1)).astype(np.int16),
        "slot": np.tile(layout.slot, (rows, 1)).astype(np.int8),
        "target": target.astype(np.int16),
        "tower": np.array([f"tower {t}" for t in tower], dtype=object),
        "episode": np.array([f"episode {row}" for row in range(rows)], dtype=object),
    }


def selection_dataset(towers=30, seed=0):
    """Three pulls a tower; side blocks fail mostly, centre blocks hardly ever."""
    rng = np.random.default_rng(seed)
    tower = np.repeat(np.arange(towers), 3)
    target = np.tile([0, 1, 2], towers)
    failure = rng.random(len(target)) < np.where(target == 1, 0.1, 0.8)
    columns = {
        **_state(target, tower),
        "round": rng.integers(1, 4, len(target)).astype(np.int16),
        "failure": failure,
        "strict_failure": failure | (rng.random(len(target)) < 0.1),
        "outcome": np.where(failure, "stuck", "extracted").astype(object),
    }
    return MadeUpDataset("selection", columns, np.array(["train", "validation", "test"])[tower % 3])


def dynamics_dataset(towers=6, steps=52, seed=0):
    """One pull a tower: block 4 follows the action, all others creep. The last steps are clear of the tower."""
    rng = np.random.default_rng(seed)
    tower, frame = np.repeat(np.arange(towers), steps), np.tile(np.arange(steps), towers)
    target = np.full(len(tower), 4)
    state = _state(target, tower)
    action = rng.normal([-0.001, 0, 0], 2e-4, (len(tower), 3)).astype(np.float32)
    pose = state["block_pose"].reshape(towers, steps, BLOCKS, 7)
    moved = rng.normal(0, 1e-5, (towers, steps, BLOCKS, 3))
    moved[:, :, 4] = action.reshape(towers, steps, 3)
    after = pose.copy()
    after[..., :3] += np.cumsum(moved, axis=1)
    pose[:, 1:] = after[:, :-1]
    columns = {
        **state,
        "episode": np.array([f"episode {t}" for t in tower], dtype=object),
        "frame": frame.astype(np.int32),
        "action": action,
        "next_pose": after.reshape(-1, BLOCKS, 7),
        "target_clear": frame >= steps - 10,
        "collapsed": np.zeros(len(tower), bool),
    }
    return MadeUpDataset("dynamics", columns, np.array(["train", "test"])[tower % 2])


def untrained(folder, config, dataset):
    """A checkpoint with fresh weights."""
    spec = graph_spec(config.graph)
    edges = attribute_width(spec) if config.edge_attributes else 0
    folder.mkdir()
    save(
        folder,
        build(config, spec, 1 + edges),
        config,
        spec,
        Normalisation.none(spec.node_width, edges),
        dataset,
        {},
    )
    return folder
