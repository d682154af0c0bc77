"""Where datasets lie: by path, or by NAME@X.Y.Z in the known places."""

import os
import re
from pathlib import Path

from jenga_data.dataset.manifest import MANIFEST, load_manifest
from jenga_data.errors import JengaError

FOLDER = "datasets_manifest"
SEARCH_PATH = "JENGA_DATASETS"
"""Environment variable: folders to search first, separated as in PATH."""


def search_folders() -> list[Path]:
    """Where names are looked up: $JENGA_DATASETS, the current folder's and the checkout's `datasets_manifest`."""
    own = [Path(p) for p in os.environ.get(SEARCH_PATH, "").split(os.pathsep) if p]
    checkout = Path(__file__).resolve().parents[2] / FOLDER
    return [p for p in dict.fromkeys([*own, Path(FOLDER).absolute(), checkout]) if p.is_dir()]


def known_datasets() -> dict[str, Path]:
    """Folder of every dataset that can be named, by NAME@X.Y.Z; the first place found wins.

    A folder is a dataset if it lies one or two levels below a search folder and has a manifest that can be read:
    one that cannot must not hide the others.
    """
    known: dict[str, Path] = {}
    for root in search_folders():
        for path in sorted([*root.glob(f"*/{MANIFEST}"), *root.glob(f"*/*/{MANIFEST}")]):
            try:
                known.setdefault(load_manifest(path).identifier, path.parent)
            except JengaError:
                continue
    return dict(sorted(known.items()))


def locate(where: str | Path) -> Path:
    """The folder of a dataset, given that folder, its manifest or its NAME@X.Y.Z.

    Raises:
        JengaError: there is no such dataset; the message lists the known ones.
    """
    path = Path(where)
    if path.name == MANIFEST and path.is_file():
        return path.parent
    if path.is_dir():
        return path
    known = known_datasets()
    if str(where) in known:
        return known[str(where)]
    wanted = f"dataset {str(where)!r}" if re.fullmatch(r"[^/\\]+@[^/\\]+", str(where)) else f"folder or dataset {where}"
    places = f"; searched ${SEARCH_PATH} and {FOLDER}/"
    raise JengaError(f"no {wanted}; known: {', '.join(known) or 'none'}{places}: convert logs with `jenga convert`")
