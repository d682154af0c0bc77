"""Trained models that this version of jenga comes with: `selection/` and `dynamics/`, each a checkpoint."""

from pathlib import Path

from jenga_data.errors import JengaError

FOLDER = Path(__file__).parent
KINDS = ("selection", "dynamics")


def pretrained(kind: str) -> Path:
    """The folder of the checkpoint.

    Raises:
        JengaError: it comes with none of that kind.
    """
    from jenga_models.checkpoint import CARD  # loads torch

    if not (FOLDER / kind / CARD).is_file():
        raise JengaError(
            f"this jenga comes with no trained {kind} model; name one: --model CKPT, made by `jenga train {kind}`"
        )
    return FOLDER / kind
