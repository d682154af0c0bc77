"""The verb that trains: heavy imports stay inside."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from jenga_data.command_line import Inline, Json, Shown, Verb
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
        dataset: str,
        out: Path,
        config: Annotated[SelectionTraining, Inline] = selection_default,
        preset: Literal["paper", "best", "fast"] = "best",
        resume: bool = False,
        json: Json = False,
    ) -> Shown:
        """Train the selector: does pulling this block fail?

        Args:
            dataset: NAME@X.Y.Z or a folder.
            out: new folder of the checkpoint.
            preset: where the hyperparameters below come from; each can be given besides.
            resume: take an interrupted training up.
        """
        from jenga_data.dataset.read import open_dataset

        rows = open_dataset(dataset)  # a wrong name is refused before torch takes its seconds to import
        from jenga_models.train import train_selection

        return show(train_selection(rows, config, out, resume), json)

    def dynamics(
        dataset: str,
        out: Path,
        config: Annotated[DynamicsTraining, Inline] = dynamics_default,
        preset: Literal["paper", "best", "fast"] = "best",
        resume: bool = False,
        json: Json = False,
    ) -> Shown:
        """Train the dynamics model: how does the tower move under an action?

        Args:
            dataset: NAME@X.Y.Z or a folder.
            out: new folder of the checkpoint.
            preset: where the hyperparameters below come from; each can be given besides.
            resume: take an interrupted training up.
        """
        from jenga_data.dataset.read import open_dataset

        rows = open_dataset(dataset)  # a wrong name is refused before torch takes its seconds to import
        from jenga_models.train import train_dynamics

        return show(train_dynamics(rows, config, out, resume), json)

    return {"selection": selection, "dynamics": dynamics}


def _option(args: Sequence[str], name: str) -> str | None:
    """The value of an option that decides the defaults of others, before all of them are parsed."""
    for position, argument in enumerate(args):
        if argument == name and position + 1 < len(args):
            return args[position + 1]
        if argument.startswith(f"{name}="):
            return argument.removeprefix(f"{name}=")
    return None
