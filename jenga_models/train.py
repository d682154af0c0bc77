"""Training from a dataset to a checkpoint: deterministic for a seed, resumable at epoch boundaries, quiet."""

import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Int
from lightning.pytorch import LightningModule

from jenga_data.errors import JengaError
from jenga_data.graph_spec import GraphSpec, graph_spec
from jenga_models.callbacks import KeepBest, MetricLog
from jenga_models.checkpoint import load, save
from jenga_models.columns import Rows, dataset_name
from jenga_models.committee import Committee
from jenga_models.config import DynamicsTraining, SelectionTraining, Training
from jenga_models.data import GraphData
from jenga_models.features import Featurizer
from jenga_models.loop import fit
from jenga_models.modules import DynamicsModule, PlanModule, SelectionModule
from jenga_models.problem import Problem, dynamics_problem, selection_problem
from jenga_models.registry import build
from jenga_models.run_folder import RunFolder
from jenga_models.verdicts import labels


@dataclass(frozen=True)
class TrainResult:
    """Where the checkpoint stands and how training went.

    `metrics` are those of the epoch whose weights were kept (`epoch`, from 0), out of `epochs` that were run.
    """

    path: Path
    hash: str
    metrics: dict[str, float]
    seconds: float


def train_selection(dataset: Rows, config: SelectionTraining, out: Path, resume: bool = False) -> TrainResult:
    """Train a selector on the labels of a selection dataset.

    On one platform and number of threads, a seed always gives the same weights, also when training was
    interrupted and resumed.

    Args:
        dataset: as `jenga_data.dataset.read.open_dataset` gives it.
        out: the checkpoint's folder. It must not exist yet, unless `resume` takes an interrupted training up.

    Raises:
        JengaError: the dataset does not fit, the folder exists or does not, or the loss diverged.
        KeyboardInterrupt: Ctrl-C; what was reached after the last whole epoch can be resumed.
    """

    prepare = partial(selection_problem, dataset, config)
    return _train("selection", dataset, config, Path(out), resume, prepare, SelectionModule)


def train_dynamics(dataset: Rows, config: DynamicsTraining, out: Path, resume: bool = False) -> TrainResult:
    """Train a simulator on the transitions of a dynamics dataset; otherwise like `train_selection`."""
    prepare = partial(dynamics_problem, dataset, config)
    module = PlanModule if config.model == "factored" else DynamicsModule
    return _train("dynamics", dataset, config, Path(out), resume, prepare, module)


def _train(
    kind: str,
    dataset: Rows,
    config: Training,
    out: Path,
    resume: bool,
    prepare: Callable[[GraphSpec, Int[np.ndarray, " row"]], Problem],
    lightning: Callable[[torch.nn.Module, Any], LightningModule],
) -> TrainResult:
    started = time.monotonic()
    train, validation = _split(kind, dataset, config)
    folder = RunFolder(out, kind, config, dataset.hash)
    if resume and folder.finished():
        done = load(out)
        return TrainResult(out, done.hash, done.metrics, time.monotonic() - started)
    ready_state = folder.find_state() if resume else folder.refuse_existing()

    spec = graph_spec(config.graph)
    problem = prepare(spec, train)
    featurizer = Featurizer(spec, config.flow, config.edge_attributes, problem.normalisation)
    if problem.keep is not None:
        train, validation = train[problem.keep[train]], validation[problem.keep[validation]]
    module = lightning(build(config, spec, featurizer.edge_width), config)
    data = GraphData(
        problem.store,
        featurizer,
        problem.wanted,
        train=train,
        validation=validation,
        batch_size=config.batch_size,
        seed=config.seed,
        batches=problem.batches,
    )
    log, best = MetricLog(folder.metrics), KeepBest(config.patience)
    try:
        folder.begin()
        with torch.random.fork_rng(devices=[]):
            fit(kind, config, module, data, log, best, folder, ready_state)
        module.load_state_dict(best.weights)
        towers = len(np.unique(dataset.column("tower")[train]))
        size = {"training_rows": float(len(train)), "training_towers": float(towers)}
        metrics = {**log.rows[best.epoch], "epochs": float(len(log.rows)), **size}
        network = module.get_submodule("network")
        if isinstance(network, Committee) and isinstance(config, SelectionTraining) and config.calibrate:
            _calibrate(network, data)
        save(out, network, config, spec, problem.normalisation, dataset, metrics)
        shutil.rmtree(folder.state)
    except OSError as error:
        raise JengaError(f"cannot write {out}: {error.strerror or error}; make room, then add --resume") from error
    return TrainResult(out, load(out).hash, metrics, time.monotonic() - started)


def _calibrate(network: Committee, data: GraphData) -> None:
    network.cpu().eval()
    with torch.no_grad():
        said = [(network(batch.graphs), labels(batch.wanted)) for batch in data.validation_batches()]
    logits, wanted = (torch.cat(parts) for parts in zip(*said, strict=True))
    network.calibrate(logits, wanted)


def _split(
    kind: str, dataset: Rows, config: Training
) -> tuple[Int[np.ndarray, " train"], Int[np.ndarray, " validation"]]:
    """Rows to train on and rows to validate on.

    Raises:
        JengaError: the dataset is of another kind, or a side that is needed is empty.
    """
    name = dataset_name(dataset)
    if dataset.manifest.kind != kind:
        raise JengaError(f"{name} is a {dataset.manifest.kind} dataset; wanted: {kind}")
    train, validation = (np.sort(dataset.rows(split)).astype(np.int64) for split in ("train", "validation"))
    if config.train_on_validation:
        train, validation = np.sort(np.concatenate([train, validation])), validation[:0]
    if config.training_towers:
        train = _of_towers(dataset, train, config.training_towers)
    if config.accelerator == "cuda" and not torch.cuda.is_available():
        raise JengaError("accelerator is cuda, and torch sees no GPU; allowed here: auto, cpu")
    if len(train) == 0:
        raise JengaError(f"{name} has no training rows; convert more episodes")
    calibrate = isinstance(config, SelectionTraining) and config.calibrate
    if (config.patience or calibrate) and len(validation) == 0:
        raise JengaError(
            f"{name} has no validation rows to stop early and calibrate by; convert more towers, or set patience to 0, "
            "calibrate off and train_on_validation"
        )
    return train, validation


def _of_towers(dataset: Rows, rows: Int[np.ndarray, " row"], count: int) -> Int[np.ndarray, " kept"]:
    """The rows of the first `count` towers by their hash, which has nothing to do with what they are like.

    Raises:
        JengaError: there are fewer.
    """
    tower = dataset.column("tower")[rows]
    known = np.unique(tower)
    if count > len(known):
        raise JengaError(
            f"training_towers is {count}; {dataset_name(dataset)} has {len(known)} to train on; 0 takes all of them"
        )
    return rows[np.isin(tower, known[:count])]
