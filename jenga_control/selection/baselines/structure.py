"""One tower and the block to pull from it: what every hand-made feature is computed from."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from jenga_models.columns import Rows


@dataclass(frozen=True, eq=False)
class Structure:
    """A row of a selection dataset in double precision; features of one kind of information read only its fields."""

    size: Float[np.ndarray, "block 3"]
    """[m]"""
    mass: Float[np.ndarray, " block"]
    """[kg]"""
    pose: Float[np.ndarray, "block 7"]
    """In the world, the tower turned so that the target lies along x."""
    level: Int[np.ndarray, " block"]
    slot: Int[np.ndarray, " block"]
    supports: Bool[np.ndarray, "upper lower"]
    """True where a block lies right above another."""
    target: int

    def __len__(self) -> int:
        return len(self.mass)


def structures(dataset: Rows, rows: Int[np.ndarray, " row"] | Sequence[int]) -> list[Structure]:
    """The given rows of a selection dataset."""
    names = ("block_size", "block_mass", "block_pose", "level", "slot", "target")
    size, mass, pose, level, slot, target = (dataset.column(name) for name in names)
    edges = dataset.edges()
    found = []
    for row in rows:
        own = slice(edges.offset[row], edges.offset[row + 1])
        supports = np.zeros((mass.shape[1],) * 2, bool)
        supports[edges.upper[own], edges.lower[own]] = True
        found.append(
            Structure(
                size[row].astype(float),
                mass[row].astype(float),
                pose[row].astype(float),
                level[row].astype(np.int64),
                slot[row].astype(np.int64),
                supports,
                int(target[row]),
            )
        )
    return found
