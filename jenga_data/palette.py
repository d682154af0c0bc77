"""Every colour of a replay, a picture or a curve, in one place.

Signal colours are Okabe and Ito's eight (https://jfly.uni-koeln.de/color/), which people with any common colour
blindness tell apart; wood keeps to pale browns so that none of them is lost on it. Colours are sRGB in [0, 1].
"""

import numpy as np
from jaxtyping import Float, Int

BLACK = (0.0, 0.0, 0.0)
ORANGE = (0.902, 0.624, 0.0)
SKY_BLUE = (0.337, 0.706, 0.914)
GREEN = (0.0, 0.620, 0.451)
YELLOW = (0.941, 0.894, 0.259)
BLUE = (0.0, 0.447, 0.698)
VERMILLION = (0.835, 0.369, 0.0)
PURPLE = (0.800, 0.475, 0.655)

TARGET = BLUE
"""The block to pull: the hue farthest from wood, also for people who see no red or no green."""
FAILURE = VERMILLION
SUCCESS = GREEN
FORCE = YELLOW
UNKNOWN = (0.62, 0.64, 0.67)
"""What has no value: a block that is no legal target has no probability of failure."""

TABLE = (0.80, 0.82, 0.84)
STEEL = (0.36, 0.38, 0.42)
RUBBER = (0.14, 0.15, 0.17)
ARM = (0.93, 0.93, 0.92)
JOINT = (0.30, 0.32, 0.35)
INK = (0.13, 0.15, 0.18)
MUTED_INK = (0.42, 0.45, 0.49)
PAPER = (1.0, 1.0, 1.0)

AXES = (VERMILLION, GREEN, BLUE)
"""x, y and z, wherever three components stand side by side."""

OUTLINE = (0.31, 0.33, 0.35)
"""Blocks of which only the edges are drawn, on black, so that arrows show."""

PHASES = (SKY_BLUE, ORANGE, GREEN, PURPLE, YELLOW, VERMILLION)
"""Lanes of phases, in the order in which they first come."""

JOINTS = (SKY_BLUE, ORANGE, GREEN, PURPLE, VERMILLION, YELLOW, (0.62, 0.64, 0.67))
"""Curves of a robot's joints, from the base on: they stand on black and on white, where the darkest blue is lost."""

_MODELS = (PURPLE, GREEN, SKY_BLUE, ORANGE, YELLOW)
_WOOD = np.array([(0.925, 0.795, 0.610), (0.855, 0.695, 0.490)])
_GRAIN = 0.024
"""Standard deviation of the brightness between blocks of a level: enough to tell neighbours apart."""


def wood(level: Int[np.ndarray, " block"]) -> Float[np.ndarray, "block 3"]:
    """A wood tone for each block: by the parity of its level, and slightly its own, the same in every picture."""
    shade = np.random.default_rng(0).normal(0.0, _GRAIN, (len(level), 1))
    warmth = np.random.default_rng(1).normal(0.0, _GRAIN / 3, (len(level), 1)) * np.array([1.0, 0.0, -1.0])
    return np.clip(_WOOD[np.asarray(level) % 2] + np.clip(shade, -2 * _GRAIN, 2 * _GRAIN) + warmth, 0.0, 1.0)


def block_colours(level: Int[np.ndarray, " block"], target: int | None = None) -> Float[np.ndarray, "block 3"]:
    """Wood, and the target in its own colour."""
    colours = wood(level)
    if target is not None:
        colours[target] = TARGET
    return colours


def model_colour(index: int) -> tuple[float, float, float]:
    """Colour of the ghosts and curves of the n-th model; the sixth model repeats the first."""
    return _MODELS[index % len(_MODELS)]


def joint_colour(index: int) -> tuple[float, float, float]:
    """Colour of a robot's n-th joint's curves; the eighth joint repeats the first."""
    return JOINTS[index % len(JOINTS)]


def probability_colours(probability: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch 3"]:
    """From sky blue (0, safe) over near white (0.5) to vermillion (1, fails); `UNKNOWN` where it is NaN."""
    stops = np.array([SKY_BLUE, (0.96, 0.95, 0.93), FAILURE])
    return _ramp(probability, np.array([0.0, 0.5, 1.0]), stops)


def error_colours(error: Float[np.ndarray, "*batch"], full_scale: float) -> Float[np.ndarray, "*batch 3"]:
    """From near white (0) over orange to a dark vermillion at `full_scale` and beyond, darker all the way."""
    stops = np.array([(0.97, 0.96, 0.94), (0.965, 0.790, 0.420), VERMILLION, (0.48, 0.13, 0.0)])
    return _ramp(np.asarray(error) / full_scale, np.linspace(0.0, 1.0, len(stops)), stops)


def _ramp(
    value: Float[np.ndarray, "*batch"], at: Float[np.ndarray, " stop"], stops: Float[np.ndarray, "stop 3"]
) -> Float[np.ndarray, "*batch 3"]:
    colours = np.stack([np.interp(value, at, stops[:, channel]) for channel in range(3)], axis=-1)
    return np.where(np.isnan(value)[..., None], UNKNOWN, colours)


def rgba8(colour: Float[np.ndarray, "*batch 3"] | tuple[float, float, float], alpha: float = 1.0) -> np.ndarray:
    """Bytes red, green, blue, alpha of one colour or of many, as viewers take them."""
    rgb = np.asarray(colour, dtype=float)
    full = np.concatenate([rgb, np.full((*rgb.shape[:-1], 1), alpha)], axis=-1)
    return np.round(np.clip(full, 0.0, 1.0) * 255).astype(np.uint8)
