"""Checks on the numbers in the rows. Each yields one line for every kind of thing that is wrong in a batch of rows."""

from collections.abc import Iterator

import numpy as np

from jenga_data.dataset.rows import Ragged, Rows
from jenga_data.geometry import footprint_overlap, vertical_gap
from jenga_data.graph import MAX_GAP, MAX_SINK, MIN_OVERLAP

UNIT_TOLERANCE = 1e-5
"""How far a stored quaternion's length may be from 1: a hundred roundings to 32 bit."""
EDGE_TOLERANCE = 1e-6
"""How far rounding of poses and sizes to 32 bit may move a gap or an overlap [m], with room to spare."""
_ROWS_AT_ONCE = 64


def check_ranges(rows: Rows, blocks: int) -> Iterator[str]:
    """Numbers are finite, quaternions of unit length, sizes positive, and ids name something."""
    for name, column in rows.items():
        values = column.values if isinstance(column, Ragged) else column
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            yield f"{name} is not finite"
        if name in ("block_pose", "next_pose"):
            length = np.linalg.norm(np.asarray(values)[..., 3:].astype(float), axis=-1)
            if not (np.abs(length - 1) < UNIT_TOLERANCE).all():
                yield f"{name} has quaternions whose length is not 1"
        low, high = _LIMITS.get(name, (-np.inf, np.inf))
        high = blocks - 1 if high == _LAST_BLOCK else high
        if values.dtype.kind in "iuf" and len(values) and not low <= values.min() <= values.max() <= high:
            yield f"{name} goes from {values.min()} to {values.max()}; allowed: {low} to {high}"


_LAST_BLOCK = -1.0
_SMALLEST = np.finfo(np.float32).tiny
_LIMITS = {
    "frame": (0, np.inf),
    "round": (1, np.inf),
    "target": (0, _LAST_BLOCK),
    "turn": (0, 3),
    "face": (0, 1),
    "block_size": (_SMALLEST, np.inf),
    "block_mass": (_SMALLEST, np.inf),
    "level": (0, np.inf),
    "slot": (0, 2),
    "edge_upper": (0, _LAST_BLOCK),
    "edge_lower": (0, _LAST_BLOCK),
    "moved": (0, np.inf),
}


def check_edges(rows: Rows) -> Iterator[str]:
    """The edges of each row are those that its poses and sizes give, but for pairs on the very border."""
    pose, size = np.asarray(rows["block_pose"]).astype(float), np.asarray(rows["block_size"]).astype(float)
    upper, lower, force = rows["edge_upper"], rows["edge_lower"], rows["edge_force"]
    assert isinstance(upper, Ragged)
    assert isinstance(lower, Ragged)
    assert isinstance(force, Ragged)
    if not (np.array_equal(upper.offset, lower.offset) and np.array_equal(upper.offset, force.offset)):
        yield "edge_upper, edge_lower and edge_force have different lengths"
        return
    row = np.repeat(np.arange(len(pose)), np.diff(upper.offset))
    stored = np.zeros((len(pose), pose.shape[1], pose.shape[1]), bool)
    stored[row, upper.values, lower.values] = True
    if stored.sum() != len(row):
        yield "a row has an edge twice"
    extra = missing = 0
    for start in range(0, len(pose), _ROWS_AT_ONCE):
        part = slice(start, start + _ROWS_AT_ONCE)
        gap, overlap = vertical_gap(pose[part], size[part]), footprint_overlap(pose[part], size[part])
        # How far inside the limits a pair is: negative where it is no edge.
        depth = np.minimum(np.minimum(MAX_GAP - gap, gap + MAX_SINK), overlap - MIN_OVERLAP)
        extra += int((stored[part] & (depth < -EDGE_TOLERANCE)).sum())
        missing += int((~stored[part] & (depth > EDGE_TOLERANCE)).sum())
    if extra:
        yield f"{extra} edges join blocks that do not lie on each other"
    if missing:
        yield f"{missing} pairs of blocks that lie on each other have no edge"


def check_layout(rows: Rows) -> Iterator[str]:
    """No two blocks of a row have the same place in the tower."""
    place = 3 * np.asarray(rows["level"]).astype(int) + np.asarray(rows["slot"])
    crowded = (np.diff(np.sort(place, axis=1), axis=1) == 0).any(axis=1)
    if crowded.any():
        yield f"{crowded.sum()} rows have two blocks in one slot"


def check_transitions(rows: Rows) -> Iterator[str]:
    """Where a row follows the one before by one frame, it begins with the state in which that one ended."""
    episode, frame = np.asarray(rows["episode"]), np.asarray(rows["frame"])
    follows = np.flatnonzero((episode[1:] == episode[:-1]) & (np.diff(frame) == 1))
    for now, then in (("block_pose", "next_pose"), ("block_twist", "next_twist")):
        if then in rows:
            begun, ended = np.asarray(rows[now])[follows + 1], np.asarray(rows[then])[follows]
            if odd := (begun != ended).any(axis=(1, 2)).sum():
                yield f"{odd} rows do not begin with the {then} of the row before"
