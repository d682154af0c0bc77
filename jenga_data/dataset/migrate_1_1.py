"""From format 1.1 to 1.2, which says in `block_moved` what a selection pull does in its first moments."""

from pathlib import Path
from typing import Any

from jenga_data.dataset.migrate_files import manifest_of, rewritten
from jenga_data.errors import JengaError

_TO = "1.2.0"


def only_transitions(old: Path, plain: dict[str, Any], new: Path) -> dict[str, Any]:
    """A dataset of transitions stays as it is.

    Raises:
        CheckFailed: a file has not the columns of format 1.1.
        JengaError: it is one of pulls: how far they moved what is in their logs alone.
    """
    manifest = manifest_of(old, plain)
    if manifest.kind == "selection":
        raise JengaError(
            f"{manifest.identifier} holds pulls without `block_moved`, which only their logs can say: convert them "
            "again with `jenga convert`"
        )
    return rewritten(old, manifest, new, _TO, "", lambda rows, _: rows)
