"""What the heights and places of blocks say of each other, as further features of every block.

A tenth of a millimetre decides which of three blocks carries the tower. From one-hot slots and 1,600 towers a network
does not find out that it has to compare a block with its level mates, with the two sides of its centre, or with what
is left of a level once the block is gone; here these comparisons are made for it. Nothing is added to what a graph
tells: all follows from the edges and from the features of the nodes.
"""

from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from jenga_models.levels import Levels

TALL = 20.0
"""Levels of a tower, roughly: counts of blocks and levels are divided by it."""
HALF = 0.5
"""Of a block's width, in slots."""


def relations_width(at: Mapping[str, slice]) -> int:
    """Numbers that `relations` gives a block."""
    return 16 + (25 if "slot" in at else 0)


def relations(
    levels: Levels, node: Float[Tensor, "graph level place feature"], at: Mapping[str, slice]
) -> Float[Tensor, "graph level place relation"]:
    """Features of every block in its tower, whichever is the target.

    They stay the same when the slots of all even levels, or of all odd ones, are reversed.

    Args:
        node: standardised features at their places (`Levels.spread`); heights are compared in these units.
        at: where each feature stands (`jenga_models.features.feature_slices`); with "slot", sides are told apart.
    """
    height, mass = node[..., at["block_size"].stop - 1], node[..., at["block_mass"].start]
    held = levels.held.expand(len(node), -1, -1)
    columns = [*_mates(height, levels), *_contacts(height, levels), *_counts(mass, held)]
    if "slot" in at:
        row = _Rows(height, held, node[..., at["slot"]])
        columns += [*row.in_level(), *row.beside(up=1), *row.beside(up=-1), *row.balance()]
    return torch.stack([c.expand_as(height) for c in columns], dim=-1)


def _mates(height: Tensor, levels: Levels) -> list[Tensor]:
    """A block beside its level mates: how much higher than the highest, the lowest and their mean."""
    others = (levels.mates > 0).expand(len(height), -1, -1, -1)
    values = height[..., None, :].expand(others.shape)
    count = others.sum(-1)
    some = count > 0
    lower = (others & (values < height[..., None])).sum(-1)
    mean = (values * others).sum(-1) / count.clamp(min=1)
    return [
        count.float() / 2,
        (height - _highest(values, others)) * some,
        (height - _lowest(values, others)) * some,
        (height - mean) * some,
        lower.float() / 2,
    ]


def _contacts(height: Tensor, levels: Levels) -> list[Tensor]:
    """What rests on a block and what it rests on: how many, and how uneven."""
    below = (levels.on > 0).expand(len(height), -1, -1, -1)
    above = below.transpose(-1, -2).roll(-1, 1)
    over, under = (height.roll(way, 1)[..., None, :].expand(below.shape) for way in (-1, 1))
    carries, rests_on = (which.sum(-1).float() / 3 for which in (above, below))
    return [carries, rests_on, *_unevenness(over, above), *_unevenness(under, below)]


def _counts(mass: Tensor, held: Tensor) -> list[Tensor]:
    """How much tower is above and below a block."""
    blocks, weight, level = held.sum(-1), (mass * held).sum(-1), (held.sum(-1) > 0).float()
    found = [_above(blocks), _below(blocks), _above(level), _below(level), _above(weight)]
    return [values[..., None] / TALL for values in found]


class _Rows:
    """Levels as rows of three slots."""

    def __init__(self, height: Tensor, held: Tensor, slot: Float[Tensor, "graph level place 3"]) -> None:
        self.held = held
        lies = slot * held[..., None]
        self.filled: Float[Tensor, "graph level 3"] = lies.sum(2).clamp(max=1)
        self.height: Float[Tensor, "graph level 3"] = (height[..., None] * lies).sum(2)
        self.own = height
        self.centre = lies[..., 1]
        self.side: Float[Tensor, "graph level place"] = lies[..., 2] - lies[..., 0]
        """-1, 0 or 1: slots away from the centre."""

    @property
    def _crown(self) -> Float[Tensor, "graph level"]:
        """How much the centre rises above the line between both sides: above 0 it carries, below 0 it is loose."""
        left, centre, right = self.height.unbind(-1)
        return (centre - (left + right) / 2) * self.filled.prod(-1)

    def in_level(self) -> list[Tensor]:
        left, centre, right = (h[..., None] for h in self.height.unbind(-1))
        has_left, has_centre, has_right = (f[..., None] for f in self.filled.unbind(-1))
        crown, is_centre, is_side = self._crown[..., None], self.centre, self.side.abs()
        other = torch.where(self.side > 0, left, right)
        has_other = torch.where(self.side > 0, has_left, has_right)
        sides = torch.cat([left, right], dim=-1)
        has_sides = torch.cat([has_left, has_right], dim=-1) > 0
        some = has_sides.any(-1, keepdim=True)
        return [
            is_centre,
            crown,
            crown * (2 * is_centre - 1),
            (self.own - centre) * is_side * has_centre,
            (self.own - other) * is_side * has_other,
            (self.own - _highest(sides, has_sides)[..., None]) * is_centre * some,
            (self.own - _lowest(sides, has_sides)[..., None]) * is_centre * some,
            is_side * has_other,
            is_side * has_centre,
        ]

    def beside(self, up: int) -> list[Tensor]:
        """The level above or below as a whole: how many blocks it has, its crown and slope."""
        filled, height = _beyond(self.filled, up), _beyond(self.height, up)
        crown = _beyond(self._crown[..., None], up)[..., 0]
        slope = (height[..., 0] - height[..., 2]).abs() * filled[..., 0] * filled[..., 2]
        columns = [crown, filled[..., 1], filled.sum(-1) / 3, slope]
        return [values[..., None] for values in columns]

    def balance(self) -> list[Tensor]:
        """Where the middle of all higher blocks lies, in slots: seen from the block, and within its mates' footprint.

        A block counts as much as any other; the lengths of blocks are three slots.
        """
        blocks = _above(self.held.sum(-1)).clamp(min=1)
        lean = self.side.sum(-1)
        odd = torch.arange(lean.shape[1], device=lean.device) % 2
        even_above, odd_above = _above(lean * (1 - odd)), _above(lean * odd)
        across = torch.where(odd > 0, odd_above, even_above) / blocks
        along = torch.where(odd > 0, even_above, odd_above) / blocks
        left, right = self._footprint()
        inside = torch.minimum(across[..., None] - left, right - across[..., None])
        some = (_above(self.held.sum(-1)) > 0)[..., None]
        alone = self.held.sum(-1)[..., None] <= 1
        return [
            across[..., None] * self.side,
            across[..., None].abs().expand_as(self.side),
            along[..., None].abs().expand_as(self.side),
            torch.where(alone, -HALF, inside + HALF) * some,
            _above(self.filled.prod(-1))[..., None] / TALL,
            _below(self.filled.prod(-1))[..., None] / TALL,
            _above(self._lone)[..., None] / 3,
            _below(self._lone)[..., None] / 3,
        ]

    def _footprint(self) -> tuple[Tensor, Tensor]:
        """The outermost slots of a block's mates."""
        slots = torch.tensor([-1.0, 0.0, 1.0], device=self.filled.device)
        own = torch.stack([self.side < 0, self.centre > 0, self.side > 0], dim=-1)
        mates = (self.filled[..., None, :] > 0) & ~own
        values = slots.expand(mates.shape)
        return _lowest(values, mates), _highest(values, mates)

    @property
    def _lone(self) -> Float[Tensor, "graph level"]:
        """1 where a level is its centre alone, about which all above can turn."""
        return ((self.filled.sum(-1) == 1) & (self.filled[..., 1] == 1)).float()


def _highest(values: Tensor, which: Bool[Tensor, "*any"]) -> Tensor:
    """The largest of some along the last axis; 0 where there is none."""
    found = values.masked_fill(~which, -torch.inf).amax(-1)
    return torch.where(which.any(-1), found, 0.0)


def _lowest(values: Tensor, which: Bool[Tensor, "*any"]) -> Tensor:
    return -_highest(-values, which)


def _unevenness(values: Tensor, which: Bool[Tensor, "*any"]) -> list[Tensor]:
    """How much the highest stands out: over the lowest, and over the second highest."""
    order = values.masked_fill(~which, -torch.inf).sort(-1, descending=True).values
    two = which.sum(-1) > 1
    lead = (
        torch.where(two, order[..., 0] - order[..., 1], 0.0) if order.shape[-1] > 1 else torch.zeros_like(two.float())
    )
    return [_highest(values, which) - _lowest(values, which), lead]


def _above(each: Float[Tensor, "graph level"]) -> Float[Tensor, "graph level"]:
    """The sum over all higher levels."""
    return each.flip(1).cumsum(1).flip(1) - each


def _below(each: Float[Tensor, "graph level"]) -> Float[Tensor, "graph level"]:
    return each.cumsum(1) - each


def _beyond(row: Float[Tensor, "graph level value"], up: int) -> Float[Tensor, "graph level value"]:
    """What the next level up (1) or down (-1) has; 0 beyond the ends."""
    moved = row.roll(-up, 1).clone()
    moved[:, -1 if up > 0 else 0] = 0.0
    return moved
