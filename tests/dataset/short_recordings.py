"""Datasets of real, simulated episodes: towers of four levels, pulls cut short, a third of a second an episode."""

from pathlib import Path

from short_towers import short_towers

from jenga_data.collect.config import CollectConfig, ExtractionConfig, SelectionConfig, SpawnConfig
from jenga_data.collect.workers import collect
from jenga_data.dataset.convert import convert

SPAWN = SpawnConfig(first_round=1, last_round=2, stand=0.32)
SELECTION = SelectionConfig(spawn=SPAWN, pull_seconds=0.1)
EXTRACTION = ExtractionConfig(body="gripper", spawn=SPAWN, slowest=0.01)
SEED = 3
NUMBERS = (0, 1, 4)


def record(config: CollectConfig, folder: Path, seeds: tuple[int, ...] = (SEED,)) -> Path:
    """Collect `NUMBERS` of each seed into `folder/logs-SEED` and convert all of them into `folder/dataset`."""
    with short_towers():
        for seed in seeds:
            collect(config, seed, NUMBERS, 1, folder / f"logs-{seed}")
    convert([folder / f"logs-{seed}" for seed in seeds], folder / "dataset", "short", "1.0.0")
    return folder / "dataset"


def never(*_: object) -> None:
    raise AssertionError("there was nothing to simulate")
