"""What Lightning trains: a network, its loss and its optimizer."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
import torch
from lightning.pytorch import LightningModule
from torch import Tensor, nn
from torch.nn import functional

from jenga_data.graph_spec import graph_spec
from jenga_models.batch import Batch
from jenga_models.committee import Committee, mean_log_probability
from jenga_models.config import DynamicsTraining, SelectionTraining, Training
from jenga_models.factored import MOTION_UNIT
from jenga_models.mirror import mirrored
from jenga_models.verdicts import labels, motion_loss, verdict_loss

PLAN_WEIGHTS = (1.0, 0.5, 0.2)
"""Of the errors of steps, of their sums and of velocities."""


class _Module(LightningModule, ABC):
    """Logs the mean of every metric over the epoch, once for training and once for validation rows."""

    def __init__(self, network: nn.Module, config: Training) -> None:
        super().__init__()
        self.network, self.config = network, config

    @abstractmethod
    def metrics(self, batch: Batch) -> dict[str, Tensor]:
        """What to report of a batch; `loss` is what is minimised."""

    def _step(self, split: str, batch: Batch) -> Tensor:
        metrics = self.metrics(batch)
        for name, value in metrics.items():
            self.log(f"{split}_{name}", value, on_step=False, on_epoch=True, batch_size=len(batch))
        return metrics["loss"]

    def on_train_batch_start(self, batch: Batch, batch_idx: int) -> None:
        # What a step draws depends on nothing before it, so that a resumed training draws the same.
        step = (self.config.seed, self.current_epoch, batch_idx)
        torch.manual_seed(int(np.random.SeedSequence(step).generate_state(1)[0]))

    def training_step(self, batch: Batch) -> Tensor:
        return self._step("train", batch)

    def validation_step(self, batch: Batch) -> None:
        self._step("validation", batch)

    def configure_optimizers(self) -> Any:
        config = self.config
        optimizer: torch.optim.Optimizer
        if config.weight_decay:
            optimizer = torch.optim.AdamW(self.parameters(), config.learning_rate, weight_decay=config.weight_decay)
        else:
            optimizer = torch.optim.Adam(self.parameters(), config.learning_rate)
        if config.schedule == "constant":
            return optimizer
        return [optimizer], [torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, config.epochs)]


class SelectionModule(_Module):
    """Cross-entropy over (holds, fails) (paper, section II-B); in training that of each member of a committee, and what
    it says of the verdicts besides."""

    config: SelectionTraining

    def metrics(self, batch: Batch) -> dict[str, Tensor]:
        graphs, wanted = batch.graphs, labels(batch.wanted)
        if self.training and self.config.mirror:
            graphs = mirrored(graphs, graph_spec(self.config.graph))
        if self.training and isinstance(self.network, Committee):
            if self.config.learns_verdicts:
                said = self.network.judge(graphs)
                more = self.config.verdict * verdict_loss(said.verdict, batch.wanted)
                each, more = said.label, more + self.config.motion * motion_loss(said.motion, batch.wanted)
            else:
                each, more = self.network.each(graphs), 0.0
            loss = functional.cross_entropy(each.flatten(0, 1), wanted.repeat(len(each))) + more
            logits = mean_log_probability(each)
        else:
            logits = self.network(graphs)
            loss = functional.cross_entropy(logits, wanted)
        return {"loss": loss, "accuracy": (logits.argmax(1) == wanted).float().mean()}


class DynamicsModule(_Module):
    """Error of the 7-D displacement of every block, in units of its scale (paper, section II-C)."""

    config: DynamicsTraining

    def metrics(self, batch: Batch) -> dict[str, Tensor]:
        said = self.network(batch.graphs)
        if self.config.loss == "mse":
            return {"loss": functional.mse_loss(said, batch.wanted)}
        return {"loss": functional.huber_loss(said, batch.wanted, delta=self.config.huber_delta)}


class PlanModule(_Module):
    """Error of a block's motion over a plan: in each step, from the start on, and of its velocity after each step.

    An error is a length, of the displacement or of the rotation at a lever; see `DynamicsTraining.softness`.
    """

    config: DynamicsTraining

    def metrics(self, batch: Batch) -> dict[str, Tensor]:
        said = self.network(batch.graphs)
        motion, after, made = batch.wanted.split([6, 6, 1], dim=-1)
        step = said[..., :6] - motion
        errors = step, step.cumsum(1), said[..., 6:] - after
        total = sum(w * self._length(error) for w, error in zip(PLAN_WEIGHTS, errors, strict=True))
        return {"loss": (total * made[..., 0]).sum() / made.sum()}

    def _length(self, error: Tensor) -> Tensor:
        """Of displacement and rotation together [mm]."""
        soft = self.config.softness
        squares = (error / error.new_tensor(MOTION_UNIT)).unflatten(-1, (2, 3)).square().sum(-1)
        return ((squares + soft * soft).sqrt() - soft).sum(-1)
