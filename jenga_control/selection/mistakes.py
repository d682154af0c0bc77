"""The worst mistakes of a model: confident and wrong, each with the commands that show it."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from jenga_control.selection.baselines.suite import Side
from jenga_control.selection.models import Family
from jenga_models.columns import Rows, dataset_name

COUNT = 10


def worst_mistakes(
    dataset: Rows,
    rows: Int[np.ndarray, " row"],
    family: Family,
    test: Side,
    logs: Path | None = None,
    count: int = COUNT,
) -> list[dict[str, Any]]:
    """The pulls on which the model was wrong, the most confident first.

    Args:
        rows: the dataset's rows that `test` holds, in its order.
        logs: folder of the episodes' logs; without it the commands say LOGS.
    """
    pulls, probability = test.pulls, family.prediction.probability
    wrong_by = np.abs(probability - pulls.failure)
    worst = [i for i in np.argsort(-wrong_by, kind="stable") if family.prediction.said[i] != pulls.failure[i]][:count]
    target, level = dataset.column("target"), dataset.column("level")
    episode, where = dataset.column("episode"), getattr(dataset, "folder", dataset_name(dataset))
    return [
        {
            "row": int(rows[i]),
            "episode": str(episode[rows[i]]),
            "round": int(pulls.round[i]),
            "level": int(level[rows[i], target[rows[i]]]),
            "slot": int(pulls.slot[i]),
            "probability": float(probability[i]),
            "outcome": str(pulls.outcome[i]),
            "replay": f"jenga replay {logs or 'LOGS'}/{episode[rows[i]]}.mcap --model {family.members[0].path}",
            "trace": f"jenga dataset trace {where} {rows[i]}",
        }
        for i in worst
    ]
