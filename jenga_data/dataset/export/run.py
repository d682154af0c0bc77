"""`jenga dataset export`: which formats there are, and the folder that appears whole or not at all."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from jenga_data.dataset.export.croissant import export_croissant
from jenga_data.dataset.export.hugging_face import export_hugging_face
from jenga_data.dataset.export.lerobot import export_lerobot
from jenga_data.dataset.read import Dataset, open_dataset
from jenga_data.dataset.staging import new_folder
from jenga_data.errors import JengaError

FORMATS: dict[str, Callable[[Dataset, Path], None]] = {
    "croissant": export_croissant,
    "hf": export_hugging_face,
    "lerobot": export_lerobot,
}


@dataclass(frozen=True)
class Exported:
    """What `jenga dataset export --json` prints."""

    dataset: str
    hash: str
    format: str
    out: str
    files: list[str]
    bytes: int


def export(where: str | Path, out: Path, form: str) -> Exported:
    """Write a dataset, given by folder or NAME@X.Y.Z, into the new folder `out` as other tools want it.

    Raises:
        JengaError: there is no such dataset or format, the format cannot hold this kind of dataset, or `out` exists.
        CheckFailed: a file of the dataset is damaged.
    """
    if form not in FORMATS:
        raise JengaError(f"no format {form!r}; allowed: {', '.join(FORMATS)}")
    dataset = open_dataset(where)
    with new_folder(out) as folder:
        FORMATS[form](dataset, folder)
    files = sorted(p for p in out.rglob("*") if p.is_file())
    return Exported(
        dataset=dataset.manifest.identifier,
        hash=dataset.hash,
        format=form,
        out=str(out),
        files=[p.relative_to(out).as_posix() for p in files],
        bytes=sum(p.stat().st_size for p in files),
    )
