"""Checks on where a dataset says it comes from. Each yields one line for every kind of thing that is wrong."""

import hashlib
import re
from collections.abc import Iterator
from itertools import groupby

import msgspec
import numpy as np

from jenga_data.dataset.manifest import Manifest

Table = dict[str, np.ndarray]


def check_provenance(manifest: Manifest, episodes: Table) -> Iterator[str]:
    """Every episode is one of a recipe, every config is the one that its hash names, every log has a hash."""
    known = manifest.provenance.configs
    for name, config in known.items():
        if hashlib.sha256(msgspec.json.encode(config, order="deterministic")).hexdigest()[:16] != name:
            yield f"config {name[:64]!r} has another hash"
    if unknown := {r.config for r in manifest.provenance.recipes} - known.keys():
        yield f"recipes use {len(unknown)} configs that are not there, first {min(unknown)[:64]!r}"
    if odd := sum(not re.fullmatch("[0-9a-f]{64}", digest) for digest in set(episodes["log_sha256"].tolist())):
        yield f"{odd} logs have no SHA-256"
    columns = (episodes[name].tolist() for name in ("config", "seed", "checkpoint", "number", "episode"))
    ranges = {(r.config, r.seed, r.checkpoint): r.numbers for r in manifest.provenance.recipes}
    apart = []
    for recipe, members in groupby(sorted(zip(*columns, strict=True)), lambda entry: entry[:3]):
        numbers = ranges.get(recipe, [])
        apart += [key for *_, number, key in members if not any(a <= number <= b for a, b in numbers)]
    if apart:
        yield f"{len(apart)} episodes are of no recipe, first {apart[0]}"
