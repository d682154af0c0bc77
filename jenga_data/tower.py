"""The truth about state: which block stands where in the game, and where it is in the world."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from jenga_data.blocks import BLOCK_COUNT, NOMINAL_SIZE, Blocks

EMPTY = -1
SLOTS = 3
CENTRE = 1
_YAW_135 = np.array([np.cos(3 * np.pi / 8), 0.0, 0.0, np.sin(3 * np.pi / 8)])


@dataclass(frozen=True)
class Place:
    """Where a block lies: `level` counts from the bottom, `slot` 0, 1, 2 goes across the level."""

    level: int
    slot: int


@dataclass(frozen=True, eq=False)
class Layout:
    """Which block lies at which level and slot; -1 where there is none.

    Blocks of even levels lie along x and their slots go along +y; blocks of odd levels lie along y and their
    slots go along -x (the frame of the level is turned by +90 degrees). Both hold before the tower is turned.
    """

    grid: Int[np.ndarray, "level 3"]
    moves: int = 0
    """Moves made since the fresh tower. A block may move twice, so this cannot be read off the grid."""

    def __post_init__(self) -> None:
        ids = self.grid[self.grid != EMPTY]
        if len(np.unique(ids)) != len(ids):
            raise ValueError("a block lies at two places")
        if self.grid.ndim != 2 or self.grid.shape[1] != SLOTS:
            raise ValueError(f"a layout has {SLOTS} slots a level, got an array of shape {self.grid.shape}")

    @classmethod
    def fresh(cls, order: Int[np.ndarray, " block"] | None = None) -> "Layout":
        """The tower of round 1: complete levels, filled in the given order of blocks from the bottom."""
        ids = np.arange(BLOCK_COUNT) if order is None else np.asarray(order)
        if len(ids) % SLOTS:
            raise ValueError(f"{len(ids)} blocks do not fill levels of {SLOTS}")
        return cls(ids.reshape(-1, SLOTS).astype(np.int64))

    @classmethod
    def from_places(cls, level: Int[np.ndarray, " block"], slot: Int[np.ndarray, " block"], moves: int = 0) -> "Layout":
        """The inverse of `level` and `slot`: block i lies at (level[i], slot[i])."""
        grid = np.full((int(level.max()) + 1, SLOTS), EMPTY, np.int64)
        if len(set(zip(level.tolist(), slot.tolist(), strict=True))) != len(level):
            raise ValueError("two blocks lie at one place")
        grid[level, slot] = np.arange(len(level))
        return cls(grid, moves)

    @property
    def round(self) -> int:
        """The round of the game: 1 for a fresh tower, one more after every move."""
        return self.moves + 1

    def _index(self, axis: int) -> Int[np.ndarray, " block"]:
        where = np.argwhere(self.grid != EMPTY)
        out = np.empty(len(where), np.int64)
        out[self.grid[where[:, 0], where[:, 1]]] = where[:, axis]
        return out

    @property
    def level(self) -> Int[np.ndarray, " block"]:
        """Level of each block, counted from 0 at the bottom."""
        return self._index(0)

    @property
    def slot(self) -> Int[np.ndarray, " block"]:
        """Slot of each block across its level: 0 and 2 at the sides, 1 in the centre."""
        return self._index(1)

    @property
    def orientation(self) -> Int[np.ndarray, " block"]:
        """0 for a block that lies along x, 1 along y (before the tower is turned)."""
        return self.level % 2

    def place(self, block: int) -> Place:
        level, slot = np.argwhere(self.grid == block)[0]
        return Place(int(level), int(slot))

    def highest_completed(self) -> int:
        """Number of the highest level that has all three blocks, -1 if none has."""
        complete = np.flatnonzero((self.grid != EMPTY).all(axis=1))
        return int(complete[-1]) if len(complete) else -1

    def is_legal(self, block: int) -> bool:
        """The one predicate for spawning, collection and ranking.

        A target lies below the highest completed level (the rules), and what remains in its level includes
        the centre block or is both side blocks (the paper, section II-B).
        """
        place = self.place(block)
        if place.level >= self.highest_completed():
            return False
        rest = {s for s in range(SLOTS) if self.grid[place.level, s] != EMPTY} - {place.slot}
        return CENTRE in rest or rest == {0, 2}

    def legal_targets(self) -> list[int]:
        """All legal targets, in the order of their numbers."""
        return [b for b in sorted(self.grid[self.grid != EMPTY].tolist()) if self.is_legal(b)]

    def next_places(self) -> list[Place]:
        """Where a block may be put: the free slots of an incomplete top level, else any slot of a new one."""
        top = self.grid[-1]
        free = [s for s in range(SLOTS) if top[s] == EMPTY]
        if free:
            return [Place(len(self.grid) - 1, s) for s in free]
        return [Place(len(self.grid), s) for s in range(SLOTS)]

    def moved(self, block: int, to: Place) -> "Layout":
        """The layout after `block` was taken out and put at `to`.

        Raises:
            ValueError: `block` is no legal target or `to` is no place to put it.
        """
        if not self.is_legal(block):
            raise ValueError(f"block {block} is no legal target; legal: {self.legal_targets()}")
        if to not in self.next_places():
            raise ValueError(f"{to} is taken or floats; free: {self.next_places()}")
        grid = self.grid.copy()
        grid[grid == block] = EMPTY
        if to.level == len(grid):
            grid = np.vstack([grid, np.full((1, SLOTS), EMPTY, np.int64)])
        grid[to.level, to.slot] = block
        return Layout(grid, self.moves + 1)

    def __iter__(self) -> Iterator[tuple[int, Place]]:
        for level, slot in np.argwhere(self.grid != EMPTY):
            yield int(self.grid[level, slot]), Place(int(level), int(slot))


def nominal_poses(layout: Layout, air: float = 0.0) -> Float[np.ndarray, "block 7"]:
    """Where nominal blocks stand on an exact grid, `air` [m] between neighbours in a level."""
    _, width, height = NOMINAL_SIZE
    across = (layout.slot - CENTRE) * (width + air)
    odd = layout.level % 2 == 1
    pose = np.zeros((len(across), 7))
    pose[:, 0] = np.where(odd, -across, 0.0)
    pose[:, 1] = np.where(odd, 0.0, across)
    pose[:, 2] = (layout.level + 0.5) * height
    pose[:, 3] = np.where(odd, np.sqrt(0.5), 1.0)
    pose[:, 6] = np.where(odd, np.sqrt(0.5), 0.0)
    return pose


@dataclass(frozen=True, eq=False)
class TowerState:
    """Everything that is known of a tower at one moment, in the world frame.

    `pose` is x y z [m] and a unit quaternion w x y z of each block (its x along its length, z along its
    height); `twist` is the linear velocity of its centre [m/s] and its angular velocity [rad/s].
    """

    blocks: Blocks
    layout: Layout
    pose: Float[np.ndarray, "block 7"]
    twist: Float[np.ndarray, "block 6"]

    def __post_init__(self) -> None:
        if not len(self.blocks) == len(self.pose) == len(self.twist):
            raise ValueError(f"{len(self.blocks)} blocks, {len(self.pose)} poses, {len(self.twist)} twists")

    def turned(self, quarter_turns: int) -> "TowerState":
        """The tower turned rigidly about the world's z by a multiple of 90 degrees; no sine rounds a position."""
        turned = turn_poses(self.pose, quarter_turns % 4 * np.pi / 2)
        return replace(
            self,
            pose=np.concatenate([turn_vectors(self.pose[:, :3], quarter_turns), turned[:, 3:]], axis=1),
            twist=np.concatenate(
                [turn_vectors(self.twist[:, :3], quarter_turns), turn_vectors(self.twist[:, 3:], quarter_turns)],
                axis=1,
            ),
        )


def turn_vectors(vectors: Float[np.ndarray, "*batch 3"], quarter_turns: int) -> Float[np.ndarray, "*batch 3"]:
    """Rotate vectors about z by exact quarter turns: no rounding of sines, so four turns are the identity."""
    c, s = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarter_turns % 4]
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.stack([c * x - s * y, s * x + c * y, z], axis=-1)


def turn_poses(
    pose: Float[np.ndarray, "*batch 7"], angle: float | Float[np.ndarray, "*#batch"]
) -> Float[np.ndarray, "*batch 7"]:
    """Rotate poses about the world's z axis by `angle` [rad], one for all or one each.

    Of an orientation's two quaternions the one nearest to a yaw of 135 degrees is taken: blocks of a tower point at
    0, 90, 180 or 270 degrees, so a tower has the same numbers however often it was turned, and noise flips no sign.
    """
    c, s = np.cos(angle), np.sin(angle)
    w, v = np.cos(angle / 2), np.sin(angle / 2)
    x, y, z, qw, qx, qy, qz = np.moveaxis(pose, -1, 0)
    quat = np.stack([w * qw - v * qz, w * qx - v * qy, w * qy + v * qx, w * qz + v * qw], axis=-1)
    nearest = np.where(quat @ _YAW_135 < 0, -1.0, 1.0)
    return np.concatenate([np.stack([c * x - s * y, s * x + c * y, z], -1), quat * nearest[..., None]], axis=-1)


def quarter_turns_for(layout: Layout, target: int, face: int) -> int:
    """Quarter turns of the table that bring `target` along x with its `face` (0: own -x end, 1: own +x end) to -x.

    A block of an odd level is turned by +90 degrees when the tower is built, so -90 degrees bring it back.
    """
    return (-(layout.place(target).level % 2) + 2 * face) % 4
