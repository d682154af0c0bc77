"""Growing towers: a fresh one, then round - 1 legal moves that a player could make, computed and not simulated.

A tower that is grown this way is close to its equilibrium; whether it really stands is for the simulator to say.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import isotonic_regression

from jenga_data.blocks import NOMINAL_SIZE, Blocks, sample_blocks
from jenga_data.collect.config import SpawnConfig
from jenga_data.contact_law import ContactLaw
from jenga_data.statics import Equilibrium, PlanarPose, solve
from jenga_data.tower import CENTRE, EMPTY, SLOTS, Layout, Place


@dataclass(frozen=True, eq=False)
class GrownTower:
    """A tower at its computed equilibrium, before it is turned."""

    blocks: Blocks
    layout: Layout
    planar: PlanarPose
    equilibrium: Equilibrium

    @property
    def pose(self) -> Float[np.ndarray, "block 7"]:
        return _poses(self.planar, self.equilibrium)


_PITCH = NOMINAL_SIZE[0] / 3 + 0.0002
"""Distance between the centres of two slots [m]: three blocks side by side with 0.2 mm of air."""
_AIR = 2e-5
"""Least air between two blocks of a level [m]: wood that is put down beside wood is not pressed against it."""


def grow_tower(config: SpawnConfig, law: ContactLaw, round_number: int, rng: np.random.Generator) -> GrownTower | None:
    """Draw a set of blocks and play `round_number` - 1 moves with them.

    Each move takes a block drawn uniformly among the legal targets that a player could take: at most
    `load_limit` rests on them, and the tower without them is in equilibrium. None if no move is left or the
    tower that results is in no equilibrium. `law` is that of the contacts.
    """
    blocks = sample_blocks(config.distribution, rng, wedge=config.wedge)
    layout = Layout.fresh(rng.permutation(len(blocks)))
    planar = PlanarPose(np.zeros((len(blocks), 2)), np.zeros(len(blocks)))
    for level in range(len(layout.grid)):
        for slot in range(SLOTS):
            _put_down(planar, int(layout.grid[level, slot]), Place(level, slot), config, rng)
        _push_apart(blocks, layout, planar, level)
    equilibrium = solve(blocks, layout, planar, law)
    for _ in range(round_number - 1):
        if not equilibrium.stands:
            return None
        block = _takeable(blocks, layout, planar, equilibrium, config.load_limit, law, rng)
        if block is None:
            return None
        place = layout.next_places()[rng.integers(len(layout.next_places()))]
        layout = layout.moved(block, place)
        _put_down(planar, block, place, config, rng)
        _push_apart(blocks, layout, planar, place.level)
        equilibrium = solve(blocks, layout, planar, law, near=equilibrium)
    if not equilibrium.stands:
        return None
    return GrownTower(blocks, layout, planar, equilibrium)


def shifted(tower: GrownTower, block: int, distance: float, law: ContactLaw) -> GrownTower | None:
    """The tower with `block` moved by `distance` [m] along its own x, None if that is in no equilibrium."""
    xy = tower.planar.xy.copy()
    yaw = tower.planar.yaw[block]
    xy[block] += distance * np.array([np.cos(yaw), np.sin(yaw)])
    planar = PlanarPose(xy, tower.planar.yaw)
    equilibrium = solve(tower.blocks, tower.layout, planar, law, near=tower.equilibrium)
    return GrownTower(tower.blocks, tower.layout, planar, equilibrium) if equilibrium.stands else None


def _takeable(
    blocks: Blocks,
    layout: Layout,
    planar: PlanarPose,
    now: Equilibrium,
    limit: float,
    law: ContactLaw,
    rng: np.random.Generator,
) -> int | None:
    candidates = [b for b in layout.legal_targets() if now.load_on(b) <= limit]
    for block in rng.permutation(np.array(candidates, np.int64)):
        if solve(blocks, layout, planar, law, without=int(block), near=now).stands:
            return int(block)
    return None


def _put_down(planar: PlanarPose, block: int, place: Place, config: SpawnConfig, rng: np.random.Generator) -> None:
    along, across = rng.normal(0.0, config.position_sigma, 2)
    across += (place.slot - CENTRE) * _PITCH
    yaw = rng.normal(0.0, config.yaw_sigma)
    if place.level % 2:
        planar.xy[block], planar.yaw[block] = (-across, along), np.pi / 2 + yaw
    else:
        planar.xy[block], planar.yaw[block] = (along, across), yaw


def _push_apart(blocks: Blocks, layout: Layout, planar: PlanarPose, level: int) -> None:
    """Move the blocks of a level across it, as little as it takes (least squares), until no two overlap.

    Two blocks side by side need half of both widths, and what their directions differ by over half their length.
    """
    row = layout.grid[level]
    row = row[row != EMPTY]
    axis, sign = (0, -1.0) if level % 2 else (1, 1.0)
    width, length = blocks.size[row, 1], blocks.size[row, 0]
    skew = np.abs(np.diff(planar.yaw[row])) * np.minimum(length[1:], length[:-1]) / 2
    reach = np.append(0.0, np.cumsum((width[1:] + width[:-1]) / 2 + skew + _AIR))
    # Without what they need, the centres only have to be in order: that is a monotonic regression.
    across = isotonic_regression(sign * planar.xy[row, axis] - reach).x + reach
    planar.xy[row, axis] = sign * across


def _poses(planar: PlanarPose, equilibrium: Equilibrium) -> Float[np.ndarray, "block 7"]:
    """Small tilts about the world's axes after the yaw, as quaternions."""
    cy, sy = np.cos(planar.yaw / 2), np.sin(planar.yaw / 2)
    r, p = equilibrium.roll / 2, equilibrium.pitch / 2
    quat = np.stack([cy, r * cy + p * sy, p * cy - r * sy, sy], axis=1)
    quat /= np.linalg.norm(quat, axis=1, keepdims=True)
    return np.concatenate([planar.xy, equilibrium.z[:, None], quat], axis=1)
