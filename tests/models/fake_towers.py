"""Small random towers as a dataset, and episodes of them, without a simulator."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from jenga_data.blocks import Blocks, sample_blocks
from jenga_data.episode import Contacts, Episode, EpisodeHeader, GripperTrack
from jenga_data.graph import support_edges
from jenga_data.tower import Layout, TowerState

BLOCKS = 6


class FakeEdges(NamedTuple):
    offset: np.ndarray
    upper: np.ndarray
    lower: np.ndarray
    force: np.ndarray


@dataclass
class FakeDataset:
    columns: dict[str, np.ndarray]
    edge: FakeEdges
    split: dict[str, np.ndarray]
    manifest: Any
    hash: str = "f" * 64
    name: str = field(default="tiny")

    def __len__(self) -> int:
        return len(self.columns["target"])

    def rows(self, split: str) -> np.ndarray:
        return self.split[split]

    def column(self, name: str) -> np.ndarray:
        values = self.columns[name].copy()
        values.flags.writeable = False
        return values

    def edges(self) -> FakeEdges:
        return self.edge


def small_tower(rng: np.random.Generator) -> TowerState:
    """Two levels of three blocks each, placed with small errors in position and yaw."""
    blocks = sample_blocks("measured", rng, BLOCKS)
    layout = Layout.fresh(rng.permutation(BLOCKS))
    pose = np.zeros((BLOCKS, 7))
    for block, place in layout:
        across, turn = (place.slot - 1) * 0.0255, place.level % 2
        yaw = turn * np.pi / 2 + rng.normal(0, 0.01)
        height = blocks.size[layout.grid[: place.level], 2].max(axis=1, initial=0).sum() + blocks.size[block, 2] / 2
        pose[block, :3] = (-across * turn, across * (1 - turn), height)
        pose[block, :2] += rng.normal(0, 5e-4, 2)
        pose[block, 3:] = (np.cos(yaw / 2), 0, 0, np.sin(yaw / 2))
    return TowerState(blocks, layout, pose, np.zeros((BLOCKS, 6)))


def fake_dataset(kind: str, rows: int = 60, seed: int = 0, frames: int = 5) -> FakeDataset:
    """Towers with a learnable label (the target is thicker than the mean of its level) and a learnable motion
    (blocks right above the target follow it by a third)."""
    rng = np.random.default_rng(seed)
    states = [small_tower(rng) for _ in range(rows)]
    target = np.array([rng.choice(state.layout.grid[0]) for state in states])
    pose = np.stack([state.pose for state in states]).astype(np.float32)
    size = np.stack([state.blocks.size for state in states]).astype(np.float32)
    level = np.stack([state.layout.level for state in states]).astype(np.int16)
    each = np.arange(rows)
    edges = [support_edges(p, s) for p, s in zip(pose, size, strict=True)]
    upper, lower = np.concatenate(edges, axis=1).astype(np.int16)
    in_level = level == level[each, target][:, None]
    mean_height = (size[..., 2] * in_level).sum(1) / in_level.sum(1)
    columns = {
        "block_size": size,
        "block_mass": np.stack([state.blocks.mass for state in states]).astype(np.float32),
        "block_pose": pose,
        "level": level,
        "slot": np.stack([state.layout.slot for state in states]).astype(np.int8),
        "target": target.astype(np.int16),
        "episode": np.array([f"episode{row // frames}" for row in each]),
        "frame": (each % frames).astype(np.int32),
        "tower": np.array([f"tower{row // frames}" for row in each]),
    }
    if kind == "selection":
        failure = size[each, target, 2] > mean_height
        outcome = np.where(failure, np.where(each % 3 == 0, "stuck", "collapsed"), "extracted")
        columns |= {"failure": failure, "strict_failure": np.ones(rows, bool), "outcome": outcome}
        columns |= {"dragged": failure & (each % 2 == 0), "moved": np.where(failure, 0.02, 0.0)}
        columns |= {"block_moved": rng.normal(0, 0.01, (rows, 3, BLOCKS, 3)).astype(np.float32)}
    else:
        action = rng.normal((-1e-3, 0, 0), (5e-4, 2e-4, 1e-4), (rows, 3))
        follows = np.zeros((rows, BLOCKS))
        for row, (above, below) in enumerate(edges):
            follows[row, above[below == target[row]]] = 1 / 3
            follows[row, target[row]] = 1
        after = pose.astype(float)
        after[..., :3] += follows[..., None] * action[:, None]
        after[::2, :, 3:] *= -1  # the same rotations
        columns |= {
            "action": action.astype(np.float32),
            "next_pose": after.astype(np.float32),
            "collapsed": np.zeros(rows, bool),
        }
    manifest = SimpleNamespace(name="tiny", version="1.0.0", kind=kind)
    parts = np.split(each, [int(0.6 * rows), int(0.8 * rows)])
    split: dict[str, np.ndarray] = dict(zip(("train", "validation", "test"), parts, strict=True))
    counts = [edge.shape[1] for edge in edges]
    ragged = FakeEdges(np.cumsum([0, *counts]), upper, lower, np.zeros(len(upper), np.float32))
    return FakeDataset(columns, ragged, split, manifest)


def small_episode(frames: int = 6, seed: int = 3) -> Episode:
    """A tower whose target is drawn out evenly; nothing else moves."""
    rng = np.random.default_rng(seed)
    state = small_tower(rng)
    target = int(state.layout.grid[0, 0])
    pose = np.repeat(state.pose[None], frames, axis=0)
    pose[:, target, 0] -= 1e-3 * np.arange(frames)
    time = np.arange(frames) * 32_000_000
    no_contacts = Contacts(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)))
    action = np.tile([-1e-3, 0.0, 0.0], (frames - 1, 1))
    track = GripperTrack(time, np.tile(pose[0, 0], (frames, 1)), np.zeros(frames), *np.zeros((2, frames, 3)))
    blocks = Blocks(state.blocks.size, state.blocks.mass)
    return Episode(
        header=EpisodeHeader("ab" * 8, "extraction", 1, 0, blocks, state.layout, target, 0, 0, {}),
        time_ns=time,
        pose=pose,
        twist=np.zeros((frames, BLOCKS, 6)),
        contacts=[no_contacts] * frames,
        sim_state=np.zeros((frames, 0)),
        action_frame=np.arange(frames - 1),
        action=action,
        action_reached=action,
        gripper=track,
        phases=[],
        result=None,
        turntable=np.zeros(frames),
        robot=None,
    )
