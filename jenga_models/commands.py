"""The verb that trains, and benches of what training needs. Heavy imports stay inside."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from jenga_data.command_line import Inline, Json, Shown, Verb
from jenga_data.dataset.reference import DYNAMICS, SELECTION
from jenga_data.errors import JengaError


def train(args: Sequence[str]) -> dict[str, Verb]:
    from jenga_models.config import PRESETS, DynamicsTraining, SelectionTraining

    kind = next((a for a in args if a in PRESETS), "selection")
    chosen = _option(args, "--preset") or "best"
    defaults = {name: PRESETS[name].get(chosen, PRESETS[name]["best"]) for name in PRESETS}
    if chosen not in PRESETS[kind]:
        raise JengaError(f"unknown preset {chosen!r}; allowed: {', '.join(PRESETS[kind])}")
    selection_default, dynamics_default = defaults["selection"], defaults["dynamics"]
    assert isinstance(selection_default, SelectionTraining)
    assert isinstance(dynamics_default, DynamicsTraining)

    def show(result: Any, json: bool) -> Shown:
        data = {"checkpoint": str(result.path), "hash": result.hash, "metrics": result.metrics}
        return Shown(
            json, data | {"seconds": result.seconds}, f"{result.path} ({result.seconds:.0f} s) {result.metrics}"
        )

    def selection(
        out: Path,
        dataset: str = SELECTION,
        config: Annotated[SelectionTraining, Inline] = selection_default,
        preset: Literal["paper", "best", "fast"] = "best",
        resume: bool = False,
        json: Json = False,
    ) -> Shown:
        """Train the selector: does pulling this block fail?

        Args:
            out: new folder of the checkpoint.
            dataset: NAME@X.Y.Z or a folder.
            preset: where the hyperparameters below come from; each can be given besides.
            resume: take an interrupted training up.
        """
        from jenga_data.dataset.read import open_dataset

        rows = open_dataset(dataset)  # a wrong name is refused before torch takes its seconds to import
        from jenga_models.train import train_selection

        return show(train_selection(rows, config, out, resume), json)

    def dynamics(
        out: Path,
        dataset: str = DYNAMICS,
        config: Annotated[DynamicsTraining, Inline] = dynamics_default,
        preset: Literal["paper", "best", "fast"] = "best",
        resume: bool = False,
        json: Json = False,
    ) -> Shown:
        """Train the dynamics model: how does the tower move under an action?

        Args:
            out: new folder of the checkpoint.
            dataset: NAME@X.Y.Z or a folder.
            preset: where the hyperparameters below come from; each can be given besides.
            resume: take an interrupted training up.
        """
        from jenga_data.dataset.read import open_dataset

        rows = open_dataset(dataset)  # a wrong name is refused before torch takes its seconds to import
        from jenga_models.train import train_dynamics

        return show(train_dynamics(rows, config, out, resume), json)

    return {"selection": selection, "dynamics": dynamics}


def bench() -> dict[str, Verb]:
    def loader(
        dataset: tuple[str, ...] = (), rounds: int = 7, batch_size: int = 100, seed: int = 0, json: Json = False
    ) -> Shown:
        """How fast training gets its batches from a dataset, beside torch_geometric's Batch.from_data_list.

        Args:
            dataset: NAME@X.Y.Z or a folder, one or several; by default the newest jenga-selection and jenga-dynamics.
            rounds: times that both sides are measured.
            batch_size: graphs a batch.
            seed: of the order of the rows.
        """
        from jenga_data.dataset.read import open_dataset

        where = dataset or _reference_datasets()
        for name in where:
            open_dataset(name)  # a wrong name is refused before torch takes its seconds to import
        from jenga_models.bench.loader import bench_loader

        report = bench_loader(where, rounds, batch_size, seed)
        return Shown(json, report, report.pop("text"))

    def convert(
        logs: tyro.conf.Positional[tuple[Path, ...]], rounds: int = 5, workers: int = 2, json: Json = False
    ) -> Shown:
        """How fast logs become a dataset, beside reading them message by message into torch_geometric's objects.

        Args:
            logs: folders (or files) of MCAP logs, all selection or all extraction, of three towers and more.
            rounds: times that both sides are measured.
            workers: processes that read logs, beside one.
        """
        if not logs:
            raise JengaError("no folder of logs was given; name at least one: jenga bench convert FOLDER")
        from jenga_data.dataset.sources import find_logs

        find_logs(logs)  # a wrong folder is refused before torch takes its seconds to import
        from jenga_models.bench.convert import bench_convert

        report = bench_convert(logs, rounds, workers)
        return Shown(json, report, report.pop("text"))

    return {"loader": loader, "convert": convert}


def _reference_datasets() -> tuple[str, ...]:
    """The newest version at hand of each of the two datasets that this project keeps."""
    from jenga_data.dataset.locate import known_datasets

    newest: dict[str, str] = {}
    for name in sorted(known_datasets(), key=lambda n: [int(part) for part in n.rpartition("@")[2].split(".")]):
        newest[name.rpartition("@")[0]] = name
    names = [name.rpartition("@")[0] for name in (SELECTION, DYNAMICS)]
    found = tuple(newest[name] for name in names if name in newest)
    if not found:
        raise JengaError(f"neither {' nor '.join(names)} is at hand; name a dataset with --dataset")
    return found


def _option(args: Sequence[str], name: str) -> str | None:
    """The value of an option that decides the defaults of others, before all of them are parsed."""
    for position, argument in enumerate(args):
        if argument == name and position + 1 < len(args):
            return args[position + 1]
        if argument.startswith(f"{name}="):
            return argument.removeprefix(f"{name}=")
    return None
