"""What runs along with training: the metric log, the choice of the epoch to keep, the bar."""

import csv
import io
import math
from pathlib import Path
from typing import Any

from lightning.pytorch import Callback, LightningModule, Trainer

from jenga_data.errors import JengaError
from jenga_data.progress import Bar


class MetricLog(Callback):
    """Writes one row an epoch to a CSV file. The rows are part of the resumable state, so a resumed run goes on."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: list[dict[str, float]] = []

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        values = {name: float(value) for name, value in sorted(trainer.callback_metrics.items())}
        if not all(math.isfinite(value) for value in values.values()):
            raise JengaError(
                f"training diverged in epoch {trainer.current_epoch}: a loss is not finite; lower learning_rate"
            )
        self.rows.append({"epoch": float(trainer.current_epoch), **values})
        text = io.StringIO()
        writer = csv.DictWriter(text, list(self.rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows({**row, "epoch": int(row["epoch"])} for row in self.rows)
        beside = self.path.with_name(self.path.name + ".partial")
        beside.write_text(text.getvalue())
        beside.replace(self.path)

    def state_dict(self) -> dict[str, Any]:
        return {"rows": self.rows}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        self.rows = list(state_dict["rows"])


class KeepBest(Callback):
    """Remembers the weights of the epoch with the lowest validation loss, and stops `patience` epochs after it.

    With `patience` 0 it keeps the last epoch, as the paper does.
    """

    def __init__(self, patience: int) -> None:
        self.patience = patience
        self.epoch, self.best, self.waited = -1, math.inf, 0
        self.weights: dict[str, Any] = {}

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        loss = float(trainer.callback_metrics["validation_loss"]) if self.patience else -math.inf
        if loss < self.best or not self.patience:
            self.epoch, self.best, self.waited = trainer.current_epoch, loss, 0
            self.weights = {name: value.detach().clone() for name, value in pl_module.state_dict().items()}
        else:
            self.waited += 1
        self._stop_if_done(trainer)

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self._stop_if_done(trainer)

    def _stop_if_done(self, trainer: Trainer) -> None:
        if self.patience and self.waited >= self.patience:
            trainer.should_stop = True

    def state_dict(self) -> dict[str, Any]:
        return {"epoch": self.epoch, "best": self.best, "waited": self.waited, "weights": self.weights}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        self.epoch, self.best, self.waited = (state_dict[name] for name in ("epoch", "best", "waited"))
        self.weights = dict(state_dict["weights"])


class ShowProgress(Callback):
    """Tells a bar of batches how far training is."""

    def __init__(self, bar: Bar) -> None:
        self.bar = bar

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self.bar.advance(trainer.global_step)

    def on_train_batch_end(self, trainer: Trainer, pl_module: LightningModule, *args: Any, **kwargs: Any) -> None:
        self.bar.advance(1)

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        shown = ("train_loss", "validation_loss", "validation_accuracy")
        known = {name: float(trainer.callback_metrics[name]) for name in shown if name in trainer.callback_metrics}
        self.bar.advance(0, ", ".join(f"{name.replace('_', ' ')} {value:.3f}" for name, value in known.items()))
