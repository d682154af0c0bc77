"""What the episodes of a dataset are functions of, and which of them this jenga can make again. No simulator here."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jenga_data.collect.config import CollectConfig, config_dict, config_from_dict
from jenga_data.collect.numbers import MOST
from jenga_data.dataset.manifest import Manifest
from jenga_data.dataset.read import Dataset
from jenga_data.errors import JengaError


@dataclass(frozen=True, order=True)
class Origin:
    """An episode is a function of these. `config` is the hash under which the manifest holds the configuration,
    `checkpoint` that of the model that acted, empty if none did."""

    config: str
    seed: int
    number: int
    checkpoint: str = ""

    def __str__(self) -> str:
        return f"seed {self.seed}, number {self.number}, config {self.config}"


def origins_of(dataset: Dataset) -> dict[str, Origin]:
    """Origin of each episode that has rows, by its key, in the order of the table.

    Raises:
        CheckFailed: the table of episodes is damaged.
    """
    columns = dataset.episodes()
    fields = (columns[name].tolist() for name in ("config", "seed", "number", "checkpoint"))
    return dict(zip(columns["episode"].tolist(), map(Origin, *fields), strict=True))


def recipe_origins(manifest: Manifest) -> Iterator[Origin]:
    """Origin of every episode that the recipes name, those whose physics broke included.

    Raises:
        JengaError: they name absurdly many.
    """
    ranges = [(recipe, first, last) for recipe in manifest.provenance.recipes for first, last in recipe.numbers]
    if (count := sum(max(last - first + 1, 0) for _, first, last in ranges)) > MOST:
        raise JengaError(f"the recipes of {manifest.identifier} name {count} episodes; allowed: at most {MOST}")
    for recipe, first, last in ranges:
        for number in range(first, last + 1):
            yield Origin(recipe.config, recipe.seed, number, recipe.checkpoint)


def config_of(manifest: Manifest, origin: Origin) -> CollectConfig:
    """The configuration to make an episode again with. Fields that came later have their defaults.

    Raises:
        JengaError: it cannot be made again by simulating alone; the message says why.
    """
    values = manifest.provenance.configs.get(origin.config)
    if values is None or not re.fullmatch("[0-9a-f]{1,64}", origin.config):
        raise JengaError(f"the manifest of {manifest.identifier} has no config {origin.config[:64]!r}")
    if origin.checkpoint or "controller" in values:
        model = f" with the model {origin.checkpoint[:12]}" if origin.checkpoint else ""
        raise JengaError(f"a controller pulled{model}: only `jenga eval extraction` makes such a log")
    if origin.seed < 0 or origin.number < 0:
        raise JengaError(f"{origin} is none of this jenga's: seeds and numbers are 0 or more")
    return config_from_dict(values)


def later_fields(manifest: Manifest, config: str) -> list[str]:
    """Fields of a configuration, with their path, that this jenga has and the recorded one lacks.

    Raises:
        JengaError: as `config_of`.
    """
    recorded = manifest.provenance.configs.get(config, {})
    return _lacking(config_dict(config_of(manifest, Origin(config, 0, 0))), recorded)


def _lacking(now: dict, then: dict) -> list[str]:
    lacks = [name for name in now if name not in then]
    for name, value in now.items():
        if isinstance(value, dict) and isinstance(then.get(name), dict):
            lacks += [f"{name}.{field}" for field in _lacking(value, then[name])]
    return lacks


def sort_out(manifest: Manifest, origins: Iterable[Origin]) -> tuple[list[Origin], dict[str, list[Origin]]]:
    """Those that can be made again, and those that cannot by the reason why."""
    can: list[Origin] = []
    cannot: dict[str, list[Origin]] = {}
    known: dict[tuple[str, str, bool], str] = {}
    for origin in origins:
        kind = origin.config, origin.checkpoint, min(origin.seed, origin.number) < 0
        if kind not in known:
            known[kind] = _reason(manifest, origin)
        if known[kind]:
            cannot.setdefault(known[kind], []).append(origin)
        else:
            can.append(origin)
    return can, cannot


def _reason(manifest: Manifest, origin: Origin) -> str:
    try:
        config_of(manifest, origin)
    except JengaError as error:
        return str(error)
    return ""


def evenly(items: Sequence[Origin], count: int) -> list[Origin]:
    """`count` of them, evenly spread from the first to the last; all if there are not so many."""
    if count >= len(items):
        return list(items)
    return [items[i] for i in np.linspace(0, len(items) - 1, count).round().astype(int)]
