"""Numbers of the episodes of a dataset's split, to collect other pulls of the same towers."""

from pathlib import Path

import numpy as np

from jenga_data.collect.config import CollectConfig, config_from_dict
from jenga_data.dataset.manifest import SPLITS
from jenga_data.dataset.read import open_dataset
from jenga_data.errors import JengaError

_TOWER = ("kind", "spawn", "physics", "body", "sticks_out")
"""Parts of a configuration that decide, with seed and number, which tower stands there."""


def numbers_on_towers(where: str | Path, split: str, seed: int, config: CollectConfig) -> list[int]:
    """Numbers of the episodes of one split that have this seed, ascending.

    Args:
        split: "train", "validation", "test", or "all".
        config: of the new collection; with these numbers it must give the same towers.

    Raises:
        JengaError: there is no such dataset or split, it has no episode of this seed there, or the configuration
            would give other towers.
        CheckFailed: the dataset is damaged.
    """
    dataset = open_dataset(where)
    name = dataset.manifest.identifier
    if split not in (*SPLITS, "all"):
        raise JengaError(f"no split {split!r}; allowed: {', '.join(SPLITS)}, all")
    table = dataset.episodes()
    sides = SPLITS if split == "all" else (split,)
    here = np.isin(table["tower"], [tower for side in sides for tower in dataset.manifest.splits.towers(side)])
    chosen = here & (table["seed"] == seed)
    if not chosen.any():
        seeds = ", ".join(map(str, np.unique(table["seed"][here]).tolist())) or "none"
        raise JengaError(
            f"{name} has no {split} episode of seed {seed}; its seeds there: {seeds}; give one with --seed"
        )
    for recorded in np.unique(table["config"][chosen]).tolist():
        _refuse_other_towers(name, config, config_from_dict(dataset.manifest.provenance.configs.get(recorded, {})))
    return np.unique(table["number"][chosen]).tolist()


def _refuse_other_towers(name: str, config: CollectConfig, recorded: CollectConfig) -> None:
    for part in _TOWER:
        own, other = getattr(config, part, None), getattr(recorded, part, None)
        if own != other:
            raise JengaError(
                f"{part} differs from that of {name}, so the towers would be others; it was {other}: "
                "give the options that it was collected with"
            )
