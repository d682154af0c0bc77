"""A new version without some episodes: only the files that hold one of them are written again."""

import operator
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from jenga_data.dataset.assemble import assemble
from jenga_data.dataset.episode_table import Table, chosen
from jenga_data.dataset.parents import Edited, check_new, inherited, moved_towers, open_parent
from jenga_data.dataset.provenance import remaining_provenance
from jenga_data.dataset.schema import EPISODE_COLUMNS, EPISODES, Column
from jenga_data.dataset.split import split_towers
from jenga_data.dataset.staging import new_folder, refuse_existing
from jenga_data.dataset.take import take_episodes
from jenga_data.errors import JengaError


def drop(
    where: str | Path,
    out: Path,
    version: str,
    *,
    episodes: Sequence[str] = (),
    conditions: Sequence[str] = (),
    name: str | None = None,
) -> Edited:
    """Make a version of a dataset without some episodes in the new folder `out`.

    Args:
        where: folder or NAME@X.Y.Z of the dataset.
        episodes: keys of episodes to drop.
        conditions: as `matching` reads them; episodes that meet all of them are dropped.
        name: of the new dataset, by default that of the old one.

    Raises:
        JengaError: nothing or too much is selected, or `out` exists or cannot be written.
        CheckFailed: the dataset is damaged.
    """
    refuse_existing(out)
    parent = open_parent(where)
    name = name or parent.manifest.name
    check_new(name, version, [parent])
    gone = _selected(parent.episodes, episodes, conditions)
    left = chosen(parent.episodes, ~gone)
    splits = split_towers(left["tower"].tolist())
    provenance = remaining_provenance(parent.manifest.provenance, parent.episodes, left)
    draft = inherited([parent], name, version, splits, provenance, parent.manifest.counts.invalid)
    with new_folder(out) as folder:
        parts, taken = take_episodes(parent, left["episode"].tolist(), folder, frozenset(splits.train))
        manifest = assemble(folder, draft, parts, left)
    return Edited(manifest, taken, len(parts) - taken, 0, moved_towers([parent], splits))


def _selected(table: Table, episodes: Sequence[str], conditions: Sequence[str]) -> Bool[np.ndarray, " episode"]:
    if bool(episodes) == bool(conditions):
        raise JengaError("choose episodes either by --episodes KEY... or by --where CONDITION..., e.g. 'round > 12'")
    if episodes:
        known = set(table["episode"].tolist())
        if unknown := [key for key in episodes if key not in known]:
            raise JengaError(
                f"{len(unknown)} of {len(episodes)} keys name no episode, first {unknown[0]}; see {EPISODES}"
            )
        return np.isin(table["episode"], list(episodes))
    gone = np.all([matching(table, condition) for condition in conditions], axis=0)
    if not gone.any():
        raise JengaError(f"no episode has {' and '.join(conditions)}: nothing to drop")
    return gone


_COMPARE: dict[str, Callable[[Any, Any], Any]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}
_CONDITION = re.compile(rf"\s*(\w+)\s*({'|'.join(_COMPARE)})(.*)", re.DOTALL)


def matching(table: Table, condition: str) -> Bool[np.ndarray, " episode"]:
    """Which episodes meet a condition "COLUMN OP VALUE", e.g. "round > 12", "outcome == stuck" or "dragged == true".

    OP is one of == != < <= > >=. VALUE is read as the column's type, texts without quotes; after == and != several
    may stand, separated by commas: "outcome == stuck,collapsed".

    Raises:
        JengaError: it is no condition, names no column of the table of episodes, or the value is not of its type.
    """
    found = _CONDITION.fullmatch(condition)
    if not found:
        raise JengaError(
            f"{condition!r} is no condition; allowed: COLUMN OP VALUE, e.g. 'round > 12', 'outcome == stuck'"
        )
    name, op, text = found.groups()
    columns = {column.name: column for column in EPISODE_COLUMNS}
    if name not in columns:
        raise JengaError(f"{condition!r} names no column of episodes; allowed: {', '.join(columns)}")
    several = op in ("==", "!=")
    values = [_value(columns[name], part.strip(), condition) for part in (text.split(",") if several else [text])]
    if several:
        return np.isin(table[name], values) == (op == "==")
    if columns[name].dtype in ("string", "bool"):
        raise JengaError(f"{condition!r} orders {name}, which is no number; allowed: == and !=")
    return _COMPARE[op](table[name], values[0])


def _value(column: Column, text: str, condition: str) -> Any:
    if column.dtype == "string":
        return text
    try:
        if column.dtype == "bool":
            return {"true": True, "false": False}[text.lower()]
        return np.float32(text) if column.dtype == "float32" else int(text)
    except (ValueError, KeyError):
        allowed = {"bool": "true or false", "float32": "a number"}.get(column.dtype, "a whole number")
        raise JengaError(f"{condition!r} compares {column.name} with {text!r}; allowed: {allowed}") from None
