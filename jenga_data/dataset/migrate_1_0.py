"""From format 1.0 to 1.1, which has the column `block_wedge`, and poses, velocities and forces in steps."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from jenga_data.dataset.migrate_files import manifest_of, rewritten
from jenga_data.dataset.rows import Ragged, Rows, in_steps
from jenga_data.dataset.schema import FORCE_STEP, POSE_STEP, TWIST_STEP
from jenga_data.errors import JengaError

_TO = "1.1.0"
_WEDGE = "block_wedge"
_STEP = {
    "block_pose": POSE_STEP,
    "next_pose": POSE_STEP,
    "block_twist": TWIST_STEP,
    "next_twist": TWIST_STEP,
    "edge_force": FORCE_STEP,
}


def add_wedge(old: Path, plain: dict[str, Any], new: Path) -> dict[str, Any]:
    """Every block gets the wedge 0, which is that of a box; what comes in steps is rounded to them.

    Raises:
        CheckFailed: a file has not the columns of format 1.0.
        JengaError: the config of a collection had wedge-shaped blocks: their wedges are in its logs alone.
    """
    manifest = manifest_of(old, plain)
    for key, config in manifest.provenance.configs.items():
        spawn = config.get("spawn")
        if isinstance(spawn, dict) and spawn.get("wedge"):
            raise JengaError(
                f"{old} has wedge-shaped blocks (config {key}), whose wedges format 1.0 did not keep: convert its logs "
                "again with `jenga convert`"
            )
    return rewritten(old, manifest, new, _TO, _WEDGE, _lifted)


def _lifted(rows: Rows, schema: pa.Schema) -> Rows:
    for name in rows.keys() & _STEP.keys():
        column, step = rows[name], _STEP[name]
        ragged = isinstance(column, Ragged)
        rows[name] = Ragged(column.offset, in_steps(column.values, step)) if ragged else in_steps(column, step)
    if _WEDGE in schema.names:
        rows[_WEDGE] = np.zeros((len(rows["episode"]), schema.field(_WEDGE).type.list_size))
    return rows
