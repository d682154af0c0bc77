"""Hand-made features of G_s: sizes, masses, the target and what rests on what; no level, no slot, no pose.

Blocks are told apart by their edges alone: *siblings* of the target rest on a block that it rests on, or carry one
that it carries, which makes them its level mates.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from jenga_control.selection.baselines.structure import Structure
from jenga_data.blocks import GRAVITY

MM = 1e3
GRAM = 1e3


def graph_features(tower: Structure) -> dict[str, float]:
    """Features by name. Lengths in mm, masses in g, forces in N; what there is none of counts as 0."""
    supports, height = tower.supports, tower.size[:, 2] * MM
    above, below = np.flatnonzero(supports[:, tower.target]), np.flatnonzero(supports[tower.target])
    mates = siblings(supports, tower.target)
    over, under = reach(supports.T, tower.target), reach(supports, tower.target)
    weight = float(tower.mass[over].sum()) * GRAVITY
    left = supports[above].sum(axis=1) - 1
    own = tower.size[tower.target] * MM
    return {
        "carries": len(above),
        "rests_on": len(below),
        "siblings": len(mates),
        "blocks_above": int(over.sum()),
        "blocks_below": int(under.sum()),
        "levels_above": longest_path(supports.T, tower.target),
        "levels_below": longest_path(supports, tower.target),
        "weight_above": weight,
        "weight_above_a_block": weight / (1 + len(mates)),
        "length": own[0],
        "width": own[1],
        "height": own[2],
        "mass": float(tower.mass[tower.target]) * GRAM,
        **compared("siblings", own[2], height[mates]),
        "least_support_left": float(left.min()) if len(left) else 0.0,
        "mean_support_left": float(left.mean()) if len(left) else 0.0,
        **spread("above", height[above]),
        **spread("below", height[below]),
    }


def siblings(supports: Bool[np.ndarray, "upper lower"], block: int) -> Int[np.ndarray, " sibling"]:
    """Blocks that share a supporter, or a block that rests on them, with `block`."""
    share = np.logical_or(supports[:, supports[block]].any(axis=1), supports[supports[:, block]].any(axis=0))
    share[block] = False
    return np.flatnonzero(share)


def reach(steps: Bool[np.ndarray, "block block"], start: int) -> Bool[np.ndarray, " block"]:
    """Which blocks some number of steps leads to from `start`, itself left out; `[a, b]` is a step from a to b."""
    found = steps[start].copy()
    while True:
        further = found | steps[found].any(axis=0)
        if (further == found).all():
            found[start] = False
            return found
        found = further


def longest_path(steps: Bool[np.ndarray, "block block"], start: int) -> int:
    """Number of steps of the longest walk from `start`; at most the number of blocks, should the graph have a loop."""
    at, length = steps[start], 0
    while at.any() and length < len(steps):
        at, length = steps[at].any(axis=0), length + 1
    return length


def compared(name: str, own: float, others: Float[np.ndarray, " other"]) -> dict[str, float]:
    """How much higher than others: than the highest, the lowest and the mean of them, and how many are lower [mm]."""
    if len(others) == 0:
        others = np.array([own])
    return {
        f"over_highest_of_{name}": own - float(others.max()),
        f"over_lowest_of_{name}": own - float(others.min()),
        f"over_mean_of_{name}": own - float(others.mean()),
        f"lower_{name}": float((others < own).sum()),
    }


def spread(name: str, height: Float[np.ndarray, " block"]) -> dict[str, float]:
    """How much the highest of some blocks stands out: over the lowest, and over the second highest [mm]."""
    order = np.sort(height)[::-1]
    return {
        f"spread_{name}": float(order[0] - order[-1]) if len(order) else 0.0,
        f"lead_{name}": float(order[0] - order[1]) if len(order) > 1 else 0.0,
    }
