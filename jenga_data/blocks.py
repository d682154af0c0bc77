"""What real Jenga blocks measure, and sampling sets of them.

The figures are the block statistics of two real sets published with the JengaRobot project
(https://github.com/svetliy95/JengaRobot, read 2026; numbers cited, no code or file used). Length, width,
height and mass are drawn independently: the measured correlations are at most 0.14.
"""

import hashlib
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from jenga_data.errors import JengaError

BLOCK_COUNT = 54
GRAVITY = 9.81
"""Standard acceleration towards the table [m/s^2]."""


@dataclass(frozen=True)
class Quantity:
    """A normal distribution cut off at the smallest and largest value that was measured."""

    mean: float
    sigma: float
    low: float
    high: float

    def __post_init__(self) -> None:
        if not (self.low <= self.mean <= self.high and self.sigma >= 0):
            raise ValueError(f"need low <= mean <= high and sigma >= 0, got {self}")

    def sample(self, count: int, rng: np.random.Generator) -> Float[np.ndarray, " count"]:
        """Draw by rejection, so that the truncated tails do not pile up at the limits."""
        values = rng.normal(self.mean, self.sigma, count)
        while (outside := (values < self.low) | (values > self.high)).any():
            values[outside] = rng.normal(self.mean, self.sigma, int(outside.sum()))
        return values


@dataclass(frozen=True)
class BlockDistribution:
    """Length, width, height [m] and mass [kg] of the blocks of one real set, and their wedge: how much higher a block
    is at its +x end than at its -x end [m]."""

    length: Quantity
    width: Quantity
    height: Quantity
    mass: Quantity
    wedge: Quantity


_MM = 1e-3
_G = 1e-3
_WEDGE = Quantity(0.0, 0.070 * _MM, -0.25 * _MM, 0.25 * _MM)
"""Of the 54 blocks of the first set; the sign is which end is which, so that the mean is zero."""

DISTRIBUTIONS: dict[str, BlockDistribution] = {
    # 54 blocks of one set, n = 53 to 54 measurements each.
    "measured": BlockDistribution(
        length=Quantity(75.03 * _MM, 0.278 * _MM, 74.4 * _MM, 75.7 * _MM),
        width=Quantity(24.93 * _MM, 0.245 * _MM, 24.05 * _MM, 25.35 * _MM),
        height=Quantity(14.84 * _MM, 0.175 * _MM, 14.48 * _MM, 15.20 * _MM),
        mass=Quantity(19.27 * _G, 1.41 * _G, 15.9 * _G, 23.0 * _G),
        wedge=_WEDGE,
    ),
    # A second real set, of which 9 blocks were measured (height and mass only; the rest as in the first).
    "measured-second": BlockDistribution(
        length=Quantity(75.03 * _MM, 0.278 * _MM, 74.4 * _MM, 75.7 * _MM),
        width=Quantity(24.93 * _MM, 0.245 * _MM, 24.05 * _MM, 25.35 * _MM),
        height=Quantity(14.64 * _MM, 0.038 * _MM, 14.52 * _MM, 14.76 * _MM),
        mass=Quantity(12.9 * _G, 2.1 * _G, 6.6 * _G, 19.2 * _G),
        wedge=_WEDGE,
    ),
    # The size on the box, all blocks alike: for tests and for calibration against a known answer.
    "nominal": BlockDistribution(
        length=Quantity(75 * _MM, 0.0, 75 * _MM, 75 * _MM),
        width=Quantity(25 * _MM, 0.0, 25 * _MM, 25 * _MM),
        height=Quantity(15 * _MM, 0.0, 15 * _MM, 15 * _MM),
        mass=Quantity(19.27 * _G, 0.0, 19.27 * _G, 19.27 * _G),
        wedge=Quantity(0.0, 0.0, 0.0, 0.0),
    ),
}

NOMINAL_SIZE = (75 * _MM, 25 * _MM, 15 * _MM)
"""Length, width, height on the box [m]."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """One set of blocks. `size` holds full edge lengths [m] along the block's own x, y, z; `mass` is in [kg].

    `wedge` [m] is how much higher a block is at its +x end than at its -x end: its bottom is flat, its top tilted, and
    `size` has its mean height. By default blocks are boxes.
    """

    size: Float[np.ndarray, "block 3"]
    mass: Float[np.ndarray, " block"]
    wedge: Float[np.ndarray, " block"] = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if len(self.wedge) == 0:
            object.__setattr__(self, "wedge", np.zeros(len(self.mass)))
        if not len(self.size) == len(self.mass) == len(self.wedge):
            raise ValueError(f"{len(self.size)} sizes, {len(self.mass)} masses and {len(self.wedge)} wedges")
        if not (np.all(self.size > 0) and np.all(self.mass > 0)):
            raise ValueError("every size and mass must be positive")

    def __len__(self) -> int:
        return len(self.mass)

    @property
    def tower(self) -> str:
        """Name of this set: a hash of its exact sizes and masses, and of its wedges if it has any. Splits go by it."""
        digest = hashlib.sha256(np.ascontiguousarray(self.size, "<f8").tobytes())
        digest.update(np.ascontiguousarray(self.mass, "<f8").tobytes())
        if self.wedge.any():
            digest.update(np.ascontiguousarray(self.wedge, "<f8").tobytes())
        return digest.hexdigest()[:16]


def sample_blocks(distribution: str, rng: np.random.Generator, count: int = BLOCK_COUNT, wedge: bool = False) -> Blocks:
    """Draw a set of `count` blocks from the named distribution: boxes, or wedges as real blocks are.

    Raises:
        JengaError: no distribution has that name.
    """
    if distribution not in DISTRIBUTIONS:
        raise JengaError(f"unknown block distribution {distribution!r}; allowed: {', '.join(DISTRIBUTIONS)}")
    d = DISTRIBUTIONS[distribution]
    size = np.stack([q.sample(count, rng) for q in (d.length, d.width, d.height)], axis=1)
    mass = d.mass.sample(count, rng)
    return Blocks(size, mass, d.wedge.sample(count, rng)) if wedge else Blocks(size, mass)
