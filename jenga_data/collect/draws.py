"""Random generators of an episode."""

import numpy as np


def episode_rng(seed: int, number: int, stream: str) -> np.random.Generator:
    """A generator of its own for each part of an episode, so that one part's draws never shift another's."""
    return np.random.default_rng([seed, number, *stream.encode()])
