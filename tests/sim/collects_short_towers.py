"""The program that test_kills.py kills: a collection of short towers into the folder that it is given.

Its workers import it, too, so it does nothing when imported."""

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

from short_tower import SELECTION, run_short

from jenga_data.collect.workers import CollectSummary, run_episodes

CONFIG = replace(SELECTION, pull_seconds=0.2)
SEED, EPISODES = 3, 8


def run(out: Path, workers: int) -> CollectSummary:
    return run_episodes(partial(run_short, CONFIG), CONFIG, SEED, range(EPISODES), workers, out)


if __name__ == "__main__":
    sys.exit(1 if run(Path(sys.argv[1]), 2).set_aside else 0)
