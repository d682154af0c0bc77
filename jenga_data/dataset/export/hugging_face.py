"""A Hugging Face dataset: a folder with a card that `datasets.load_dataset` opens and the hub can show."""

from pathlib import Path

from jenga_data.dataset.export.card import CARD, card
from jenga_data.dataset.export.splits import write_splits
from jenga_data.dataset.read import Dataset


def export_hugging_face(dataset: Dataset, folder: Path) -> None:
    """Write `README.md`, a Parquet file a split and the table of episodes into an empty folder.

    Raises:
        CheckFailed: a file of the dataset is damaged.
    """
    files = write_splits(dataset, folder)
    (folder / CARD).write_text(card(dataset.manifest, files), encoding="utf-8")
