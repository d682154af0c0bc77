"""Which towers train, validate and test. A tower's side is a function of its hash, so a new tower moves no old one."""

import hashlib
from collections.abc import Iterable

from jenga_data.dataset.manifest import Splits
from jenga_data.errors import JengaError

TEST_SHARE = 0.2
"""4:1, as in the paper (section II-B)."""
VALIDATION_SHARE = 0.1
"""Part of the training side that is held back for early stopping."""

RULE = (
    f"by tower: u = first 8 bytes of sha256(tower id) as a fraction of 2^64; test where u < {TEST_SHARE}, validation "
    f"where u < {TEST_SHARE + (1 - TEST_SHARE) * VALIDATION_SHARE:.2f}, else train; a side that would be empty gets "
    "the tower nearest to it"
)


def position(tower: str) -> float:
    """Where a tower lies between 0 and 1, evenly spread and the same everywhere."""
    return int.from_bytes(hashlib.sha256(tower.encode()).digest()[:8], "big") / 2**64


def split_towers(towers: Iterable[str]) -> Splits:
    """Put every tower on one side.

    Only in datasets so small that a side would stay empty (about 1 of 5 with 20 towers, for validation) is a tower
    borrowed from the next side, and may go back when towers are added.

    Raises:
        JengaError: there are fewer towers than sides.
    """
    order = sorted(set(towers), key=lambda tower: (position(tower), tower))
    if len(order) < 3:
        raise JengaError(f"{len(order)} towers cannot be split into train, validation and test: collect at least 3")
    edge = TEST_SHARE + (1 - TEST_SHARE) * VALIDATION_SHARE
    test = sum(position(t) < TEST_SHARE for t in order)
    held_back = sum(position(t) < edge for t in order)
    test = min(max(test, 1), len(order) - 2)
    held_back = min(max(held_back, test + 1), len(order) - 1)
    return Splits(
        rule=RULE,
        train=sorted(order[held_back:]),
        validation=sorted(order[test:held_back]),
        test=sorted(order[:test]),
    )
