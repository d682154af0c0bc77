"""The one door between models and data: what a network needs of a dataset's rows, or of a live tower."""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from jenga_data.geometry import rotation_matrices
from jenga_data.graph import support_edges
from jenga_data.tower import TowerState, turn_poses


@runtime_checkable
class EdgeColumns(Protocol):
    """Ragged edges of many towers: those of row r stand at `offset[r]` to `offset[r + 1]`."""

    @property
    def offset(self) -> np.ndarray: ...
    @property
    def upper(self) -> np.ndarray: ...
    @property
    def lower(self) -> np.ndarray: ...


@runtime_checkable
class Rows(Protocol):
    """What training and evaluation ask of a dataset; `jenga_data.dataset.read.Dataset` is one."""

    @property
    def manifest(self) -> Any: ...
    @property
    def hash(self) -> str: ...
    def __len__(self) -> int: ...
    def rows(self, split: Any) -> np.ndarray: ...
    def column(self, name: str) -> np.ndarray: ...
    def edges(self) -> EdgeColumns: ...


@dataclass(frozen=True, eq=False)
class Towers:
    """Many towers of equally many blocks, in arrays: sizes [m], masses [kg], poses in the world, one target each.

    `offset`, `upper` and `lower` are the support edges, row by row.
    """

    block_size: Float[np.ndarray, "row block 3"]
    block_mass: Float[np.ndarray, "row block"]
    block_pose: Float[np.ndarray, "row block 7"]
    level: Int[np.ndarray, "row block"]
    slot: Int[np.ndarray, "row block"]
    target: Int[np.ndarray, " row"]
    offset: Int[np.ndarray, " row+1"]
    upper: Int[np.ndarray, " edge"]
    lower: Int[np.ndarray, " edge"]
    block_twist: Float[np.ndarray, "row block 6"] | None = None
    """Velocities [m/s, rad/s]; None is at rest, or not asked for."""

    def __len__(self) -> int:
        return len(self.target)

    @classmethod
    def of_dataset(cls, dataset: Rows, moving: bool = False) -> "Towers":
        """All rows of a dataset, with the edges that its converter found; with velocities if `moving`."""
        edges = dataset.edges()
        return cls(
            block_size=dataset.column("block_size"),
            block_mass=dataset.column("block_mass"),
            block_pose=dataset.column("block_pose"),
            level=dataset.column("level").astype(np.int64),
            slot=dataset.column("slot").astype(np.int64),
            target=dataset.column("target").astype(np.int64),
            offset=edges.offset.astype(np.int64),
            upper=edges.upper.astype(np.int64),
            lower=edges.lower.astype(np.int64),
            block_twist=dataset.column("block_twist") if moving else None,
        )

    @classmethod
    def of_poses(
        cls,
        size: Float[np.ndarray, "row block 3"],
        mass: Float[np.ndarray, "row block"],
        pose: Float[np.ndarray, "row block 7"],
        level: Int[np.ndarray, "row block"],
        slot: Int[np.ndarray, "row block"],
        target: Int[np.ndarray, " row"],
        twist: Float[np.ndarray, "row block 6"] | None = None,
    ) -> "Towers":
        """Towers in any poses: logged, live or predicted. Edges come from `jenga_data.graph`, as in the converter."""
        edges = [support_edges(p, s) for p, s in zip(pose, size, strict=True)]
        offset = np.cumsum([0, *(e.shape[1] for e in edges)])
        upper, lower = np.concatenate(edges, axis=1) if edges else np.zeros((2, 0), np.int64)
        level, slot = level.astype(np.int64), slot.astype(np.int64)
        return cls(size, mass, pose, level, slot, target.astype(np.int64), offset, upper, lower, twist)

    @classmethod
    def of_state(cls, state: TowerState, targets: Int[np.ndarray, " row"]) -> "Towers":
        """One tower once for each target, turned (by the table) so that the target lies along x, as in the data.

        The tower stays as it is for targets that lie along x already, whichever end points to -x. Turning moves
        no block against another, so all rows have the edges of the tower as it stands.
        """
        along = rotation_matrices(state.pose[targets, 3:])[:, :2, 0]
        across = np.abs(along[:, 1]) > np.abs(along[:, 0])
        upper, lower = support_edges(state.pose, state.blocks.size)
        rows = len(targets)

        def each(values: np.ndarray) -> np.ndarray:
            return np.broadcast_to(values, (rows, *values.shape))

        return cls(
            block_size=each(state.blocks.size),
            block_mass=each(state.blocks.mass),
            block_pose=np.where(across[:, None, None], turn_poses(state.pose, -np.pi / 2), state.pose),
            level=each(state.layout.level),
            slot=each(state.layout.slot),
            target=targets.astype(np.int64),
            offset=np.arange(rows + 1) * len(upper),
            upper=np.tile(upper, rows),
            lower=np.tile(lower, rows),
        )


def dataset_name(dataset: Rows) -> str:
    """NAME@VERSION, as people write it."""
    return f"{dataset.manifest.name}@{dataset.manifest.version}"
