"""Spawned towers of few levels: the same code as for 18 of them, in a fiftieth of the time."""

from functools import partial
from unittest.mock import patch

from jenga_data.blocks import sample_blocks
from jenga_data.collect import spawn


def short_towers(levels: int = 4):
    """While this holds, a tower is spawned with so many levels; a context manager."""
    return patch.object(spawn, "sample_blocks", partial(sample_blocks, count=3 * levels))
