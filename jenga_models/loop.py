"""Lightning's trainer, set up to be quiet, to leave no litter and to take up where it was."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import torch
from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.callbacks import ModelCheckpoint

from jenga_data.progress import progress
from jenga_models.callbacks import KeepBest, MetricLog, ShowProgress
from jenga_models.config import Training
from jenga_models.data import GraphData
from jenga_models.run_folder import RunFolder


def fit(
    kind: str,
    config: Training,
    module: LightningModule,
    data: GraphData,
    log: MetricLog,
    best: KeepBest,
    folder: RunFolder,
    resume_from: Path | None,
) -> None:
    """Run the epochs that are left; afterwards `best` holds the weights and `log` the rows.

    Raises:
        KeyboardInterrupt: Ctrl-C; `folder` holds the state after the last whole epoch.
    """
    on_gpu = config.accelerator != "cpu" and torch.cuda.is_available()
    total = config.epochs * len(data.train_dataloader())
    with _quiet(), progress(f"training {kind}", total) as bar:
        trainer = Trainer(
            accelerator="cuda" if on_gpu else "cpu",
            devices=1,
            # Sums over edges come in any order on a GPU, unless told otherwise; on a CPU they never do.
            deterministic="warn" if on_gpu else False,
            max_epochs=config.epochs,
            gradient_clip_val=config.gradient_clip or None,
            num_sanity_val_steps=0,
            limit_val_batches=None if data.val_dataloader() else 0,
            logger=False,
            enable_progress_bar=False,
            enable_model_summary=False,
            default_root_dir=folder.state,
            callbacks=[log, best, ShowProgress(bar), _save_every_epoch(folder)],
        )
        try:
            trainer.fit(module, datamodule=data, ckpt_path=resume_from, weights_only=True)
        except SystemExit:
            # Lightning turns Ctrl-C into an exit of the whole program.
            raise KeyboardInterrupt from None


def _save_every_epoch(folder: RunFolder) -> ModelCheckpoint:
    return ModelCheckpoint(
        dirpath=folder.last.parent,
        filename=folder.last.stem,
        save_on_train_epoch_end=True,
        enable_version_counter=False,
    )


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence Lightning's log lines and warnings for a while."""
    loggers = [logging.getLogger(name) for name in ("lightning.pytorch", "lightning.fabric")]
    levels = [logger.level for logger in loggers]
    try:
        for logger in loggers:
            logger.setLevel(logging.ERROR)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
