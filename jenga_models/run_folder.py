"""The folder of a training under way: what it was started with, its last whole epoch, its metrics."""

import json
import pickle
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch

from jenga_data.errors import CheckFailed, JengaError
from jenga_models.checkpoint import CARD
from jenga_models.config import Training


class RunFolder:
    """`out` will hold the checkpoint; `out/state` what it takes to resume, until the checkpoint stands."""

    def __init__(self, out: Path, kind: str, config: Training, dataset_hash: str) -> None:
        self.out = out
        self.state = out / "state"
        self.last = self.state / "last.ckpt"
        self.metrics = out / "metrics.csv"
        self._run_file = self.state / "run.json"
        self._run: dict[str, Any] = {"kind": kind, "config": asdict(config), "dataset": {"hash": dataset_hash}}

    def refuse_existing(self) -> None:
        """
        Raises:
            JengaError: the folder exists.
        """
        if self.out.exists():
            raise JengaError(f"{self.out} exists; choose another folder, or add --resume to finish what is in it")

    def finished(self) -> bool:
        """Whether the checkpoint stands already.

        Raises:
            JengaError: it does, but another config or dataset made it.
        """
        if not (self.out / CARD).is_file():
            return False
        self._compare(self.out / CARD)
        return True

    def find_state(self) -> Path | None:
        """Lightning's state after the last whole epoch, None if there was none yet.

        Raises:
            JengaError: there is nothing to resume, or it was started with another config or dataset.
            CheckFailed: the state is damaged.
        """
        if not self._run_file.is_file():
            raise JengaError(f"nothing to resume in {self.out}; start without --resume, in a new folder")
        self._compare(self._run_file)
        if not self.last.is_file():
            return None
        try:
            torch.load(self.last, weights_only=True)
        except (RuntimeError, EOFError, KeyError, pickle.UnpicklingError):
            raise CheckFailed(f"{self.last} is damaged; delete it and resume to train from the start") from None
        return self.last

    def begin(self) -> None:
        """Make the folders and write down what this training is."""
        self.state.mkdir(parents=True, exist_ok=True)
        self._run_file.write_text(json.dumps(self._run, indent=1) + "\n")

    def _compare(self, path: Path) -> None:
        try:
            found = json.loads(path.read_bytes())
            before = {"kind": found["kind"], "dataset": found["dataset"]["hash"], **found["config"]}
        except (ValueError, KeyError, TypeError):
            raise CheckFailed(f"{path} is damaged; train again in a new folder") from None
        now = {"kind": self._run["kind"], "dataset": self._run["dataset"]["hash"], **self._run["config"]}
        differ = [
            f"{name} ({before.get(name)} there, {now.get(name)} now)"
            for name in {**before, **now}
            if before.get(name) != now.get(name)
        ]
        if differ:
            raise JengaError(f"{self.out} was started with another {', '.join(differ)}; resume with the same")
