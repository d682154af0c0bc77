"""`jenga bench loader`: how fast training gets its batches, beside torch_geometric's own way to make them.

Both sides give the same tensors for the same rows on one thread. Ours is the loader that training uses: the order of
the rows, nodes, edges counted through the batch, attributes of edges, actions and what the network should say are
gathered from the arrays that were read from Parquet and normalised once. Theirs is `Batch.from_data_list` over a
list of `Data` objects that were made beforehand, their features normalised too: only the call is timed.
"""

import os
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from jenga_data.bench.speed import Speed, speed_table
from jenga_data.dataset.read import Dataset, open_dataset
from jenga_data.errors import JengaError
from jenga_data.graph_spec import graph_spec
from jenga_data.statistics import ratio_bootstrap
from jenga_models.bench.pyg import data_object, read_data_objects, same, union
from jenga_models.bench.tiled import Tiled
from jenga_models.columns import Rows, dataset_name
from jenga_models.config import PRESETS, DynamicsTraining, SelectionTraining
from jenga_models.data import Batches, GraphData
from jenga_models.features import Featurizer
from jenga_models.problem import Problem, dynamics_problem, selection_problem
from jenga_models.ready import ReadyStore
from jenga_models.store import EpochOrder

GRAPHS_A_SECOND = 100_000
"""What training on one thread needs so that it never waits for its data..."""
RATIO = 10.0
"""...and how much faster than torch_geometric that is at least."""
ROWS = 2000
"""A dataset of fewer rows is tiled: a handful of graphs would stay in the processor's cache."""
PRESETS_SHOWN = {"selection": ("paper", "best", "fast"), "dynamics": ("paper", "fast")}
"""By kind: those whose batches are graphs of one step. Dynamics' best learns from plans of several."""
_EPOCHS = 10
"""Epochs of ours a round: one of theirs takes about as long."""
_READ_ROWS = 200


def bench_loader(where: Sequence[str], rounds: int = 7, batch_size: int = 100, seed: int = 0) -> dict[str, Any]:
    """Measure the loader on the given datasets. Times are CPU times, so that other work on the machine counts little.

    Raises:
        JengaError: there is no such dataset, it has no training rows, or a count is below 1.
    """
    for name, value in (("rounds", rounds), ("batch_size", batch_size)):
        if value < 1:
            raise JengaError(f"{name} is {value}; allowed: 1 and more")
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    datasets = [open_dataset(name) for name in where]
    for dataset in datasets:
        if not len(dataset.rows("train")):
            raise JengaError(f"{dataset_name(dataset)} has no training rows; convert more episodes")
    speeds: dict[str, Speed] = {}
    alike = True
    with _one_thread():
        for dataset in datasets:
            for preset in PRESETS_SHOWN[dataset.manifest.kind]:
                contest = Contest.of(dataset, preset, batch_size, seed)
                alike &= contest.same_batches()
                speeds[f"{dataset.manifest.kind}_{preset}"] = contest.run(rounds)
            speeds[f"{dataset.manifest.kind}_read"] = _reading(dataset, rounds)
    report = {name: speed.as_dict() for name, speed in speeds.items()} | {
        "same_batches": alike,
        "datasets": [dataset_name(dataset) for dataset in datasets],
        "batch_size": batch_size,
        "rounds": rounds,
        "threads": 1,
        "cores": os.cpu_count(),
        "load_before": load,
    }
    return report | {"text": _text(speeds, report)}


class _one_thread:
    """torch on one thread while the body runs."""

    def __enter__(self) -> None:
        self._before = torch.get_num_threads()
        torch.set_num_threads(1)

    def __exit__(self, *_: object) -> None:
        torch.set_num_threads(self._before)


@dataclass(frozen=True, eq=False)
class Contest:
    """One dataset as one preset sees it, ready for both sides."""

    dataset: Rows
    tiled: int
    preset: str
    graph: str
    batches: Batches
    order: EpochOrder
    data: GraphData
    objects: list[Any]

    @classmethod
    def of(cls, dataset: Rows, preset: str, batch_size: int, seed: int, at_least: int = ROWS) -> "Contest":
        tiled = Tiled(dataset, -(-at_least // len(dataset)))
        config = PRESETS[dataset.manifest.kind][preset]
        spec = graph_spec(config.graph)
        problem = _problem(tiled, config)
        featurizer = Featurizer(spec, config.flow, config.edge_attributes, problem.normalisation)
        every, none = np.arange(len(tiled)), np.zeros(0, np.int64)
        data = GraphData(
            problem.store, featurizer, problem.wanted, train=every, validation=none, batch_size=batch_size, seed=seed
        )
        batches = Batches(problem.store, featurizer, problem.wanted)
        objects = [data_object(batches[torch.tensor([row])]) for row in every[:at_least].tolist()]
        order = EpochOrder(every[:at_least], batch_size, seed)
        return cls(dataset, tiled.times, preset, config.graph, batches, order, data, objects)

    def same_batches(self) -> bool:
        """Whether both sides give the same tensors for every batch of an epoch."""
        return all(same(self.batches[rows], self.their_batch(rows)) for rows in self.order.batches(0))

    def their_batch(self, rows: torch.Tensor) -> Any:
        return union([self.objects[row] for row in rows.tolist()])

    def run(self, rounds: int) -> Speed:
        times = np.array([self._round(k) for k in range(rounds)])
        graphs = np.array([len(self.batches.ready.store) * _EPOCHS, len(self.objects)])
        rate, wall = graphs * rounds / times[..., 0].sum(0), graphs * rounds / times[..., 1].sum(0)
        each, number = np.arange(rounds), np.full(rounds, 1.0)
        edges = len(self.batches.ready.store.upper) / len(self.batches.ready.store)
        return Speed(
            f"batches of {self.order.batch_size} graphs ({self.graph}, preset {self.preset}), beside "
            "Batch.from_data_list",
            value=float(rate[0]),
            unit="graphs/s",
            reference=float(rate[1]),
            n=rounds,
            ci95=ratio_bootstrap(graphs[0] * number, times[:, 0, 0], each),
            ratio_ci95=ratio_bootstrap(times[:, 1, 0] / graphs[1], times[:, 0, 0] / graphs[0], each),
            limit=RATIO,
            at_least=True,
            more={
                "needed": GRAPHS_A_SECOND,
                "needed_met": bool(rate[0] >= GRAPHS_A_SECOND),
                "wall_clock": float(wall[0]),
                "reference_wall_clock": float(wall[1]),
                "rows": len(self.dataset),
                "tiled": self.tiled,
                "blocks": self.batches.ready.store.blocks,
                "edges_a_graph": edges,
                "messages_a_graph": edges * (2 if self.batches.ready.featurizer.flow == "both" else 1),
            },
        )

    def _round(self, number: int) -> tuple[tuple[float, float], tuple[float, float]]:
        """CPU and wall clock time [s] of `_EPOCHS` epochs of ours and one pass of theirs."""

        def ours() -> None:
            loader = self.data.train_dataloader()
            assert isinstance(loader.sampler, EpochOrder)
            for epoch in range(number * _EPOCHS, (number + 1) * _EPOCHS):
                loader.sampler.set_epoch(epoch)
                for _ in loader:
                    pass

        def theirs() -> None:
            for rows in self.order.batches(number):
                self.their_batch(rows)

        return _timed(ours), _timed(theirs)


def _problem(dataset: Rows, config: object) -> Problem:
    every = np.arange(len(dataset))
    if isinstance(config, SelectionTraining):
        return selection_problem(dataset, config, graph_spec(config.graph), every)
    assert isinstance(config, DynamicsTraining)
    return dynamics_problem(dataset, config, graph_spec(config.graph), every)


def _reading(dataset: Dataset, rounds: int) -> Speed:
    """From Parquet files to what batches are gathered from, once a training, beside an object a row."""
    kind = dataset.manifest.kind
    config = PRESETS[kind][PRESETS_SHOWN[kind][-1]]
    spec = graph_spec(config.graph)

    def ours() -> None:
        problem = _problem(open_dataset(dataset.folder), config)
        ReadyStore.of(problem.store, Featurizer(spec, config.flow, config.edge_attributes, problem.normalisation))

    def theirs() -> None:
        read_data_objects(dataset, spec, _READ_ROWS)

    for once in (ours, theirs):
        once()  # what is loaded only once is loaded before
    times = np.array([(_timed(ours)[0], _timed(theirs)[0]) for _ in range(rounds)])
    rows = np.array([len(dataset), min(len(dataset), _READ_ROWS)])
    rate = rows * rounds / times.sum(0)
    return Speed(
        "rows read from Parquet, normalised and ready to gather (once a training), beside an object a row",
        value=float(rate[0]),
        unit="rows/s",
        reference=float(rate[1]),
        n=rounds,
        ratio_ci95=ratio_bootstrap(times[:, 1] / rows[1], times[:, 0] / rows[0], np.arange(rounds)),
        more={"rows": len(dataset), "files": len(dataset.manifest.data_files), "seconds": float(times[:, 0].mean())},
    )


def _timed(work: Callable[[], None]) -> tuple[float, float]:
    """CPU and wall clock time [s]."""
    cpu, wall = time.process_time(), time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        work()
    return time.process_time() - cpu, time.perf_counter() - wall


def _text(speeds: dict[str, Speed], report: dict[str, Any]) -> str:
    met = [name for name, speed in speeds.items() if speed.limit and not (speed.more or {}).get("needed_met")]
    lines = [
        f"CPU time on one thread, {report['rounds']} rounds, of {', '.join(report['datasets'])}.",
        f"Below {GRAPHS_A_SECOND:,} graphs/s: {', '.join(met) or 'none'}. Both sides' batches are equal: "
        f"{'yes' if report['same_batches'] else 'NO'}.",
    ]
    rows = {name: (speed.more or {})["rows"] for name, speed in speeds.items() if name.endswith("_read")}
    for name, count in rows.items():
        if count < ROWS:
            lines.append(f"{name.removesuffix('_read')}: {count} rows, repeated to {ROWS:,} or more for the batches.")
    return "\n".join([*lines, "", speed_table(speeds)])
