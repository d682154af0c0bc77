"""A trained model as a folder that can be shared: `model.safetensors` and `checkpoint.json`, no pickle."""

import hashlib
import json
from dataclasses import asdict, dataclass, fields
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, get_args

import msgspec
from safetensors import SafetensorError
from safetensors.torch import load as load_weights
from safetensors.torch import save as save_weights
from torch import nn

from jenga_data.errors import CheckFailed, JengaError
from jenga_data.graph_spec import GraphSpec
from jenga_models.columns import Rows, dataset_name
from jenga_models.config import LATER, DynamicsTraining, SelectionTraining, Training
from jenga_models.features import Featurizer, attribute_width
from jenga_models.normalisation import Normalisation
from jenga_models.pretrained import KINDS, pretrained
from jenga_models.registry import build
from jenga_models.simulator import Simulator

FORMAT_VERSION = 1
"""Counts up whenever an older or newer reader would read something else than was written."""

WEIGHTS = "model.safetensors"
CARD = "checkpoint.json"

Kind = Literal["selection", "dynamics"]
CONFIGS: dict[str, type[Training]] = {"selection": SelectionTraining, "dynamics": DynamicsTraining}
PACKAGES = ("torch", "torch-geometric", "lightning", "numpy")


@dataclass(frozen=True)
class TrainedOn:
    """The dataset that made a checkpoint."""

    name: str
    version: str
    hash: str

    def __str__(self) -> str:
        return f"{self.name}@{self.version}"


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A trained network with all it needs to be used: `model` is in evaluation mode, on the CPU."""

    kind: Kind
    config: Training
    featurizer: Featurizer
    model: nn.Module
    dataset: TrainedOn
    metrics: dict[str, float]
    versions: dict[str, str]
    path: Path
    hash: str
    """SHA-256 over the weights' file and the card."""

    @property
    def spec(self) -> GraphSpec:
        return self.featurizer.spec

    @property
    def name(self) -> str:
        """The folder's name, for people."""
        return self.path.resolve().name

    @property
    def simulator(self) -> Simulator:
        """What the outputs of a dynamics model mean."""
        config = self.require("dynamics").config
        assert isinstance(config, DynamicsTraining)
        return Simulator.of(self.featurizer.normalisation, config.residual_to_action)

    def require(self, kind: Kind) -> "Checkpoint":
        """This checkpoint, if it is of that kind.

        Raises:
            JengaError: it is of the other kind.
        """
        if self.kind != kind:
            raise JengaError(
                f"{self.path} is a {self.kind} checkpoint; wanted: {kind} (`jenga train {kind}` makes one)"
            )
        return self


def save(
    out: Path,
    model: nn.Module,
    config: Training,
    spec: GraphSpec,
    normalisation: Normalisation,
    dataset: Rows,
    metrics: dict[str, float],
) -> None:
    """Write a checkpoint into the folder `out`; the card comes last, so that a folder with a card is complete."""
    weights = save_weights({name: value.detach().cpu().contiguous() for name, value in model.state_dict().items()})
    manifest = dataset.manifest
    card = {
        "format": "jenga-checkpoint",
        "format_version": FORMAT_VERSION,
        "kind": _kind_of(config),
        "config": asdict(config),
        "graph": asdict(spec),
        "normalisation": normalisation.to_json(),
        "dataset": {"name": manifest.name, "version": str(manifest.version), "hash": dataset.hash},
        "metrics": metrics,
        "versions": {package: version(package) for package in PACKAGES},
        "weights_sha256": hashlib.sha256(weights).hexdigest(),
    }
    _write(out / WEIGHTS, weights)
    _write(out / CARD, (json.dumps(card, indent=1, allow_nan=False) + "\n").encode())


def _kind_of(config: Training) -> str:
    return next(kind for kind, cls in CONFIGS.items() if isinstance(config, cls))


def _write(path: Path, content: bytes) -> None:
    beside = path.with_name(path.name + ".partial")
    beside.write_bytes(content)
    beside.replace(path)


def load(path: Path | str) -> Checkpoint:
    """Read a checkpoint from its folder.

    `selection` and `dynamics` are the models that jenga comes with, where there is no folder of that name.

    Raises:
        JengaError: there is none, it has another format version, or its architecture is not registered.
        CheckFailed: a file is damaged, or the parts do not fit each other.
    """
    path = Path(path)
    if str(path) in KINDS and not path.exists():
        path = pretrained(str(path))
    blobs = {name: _read(path, name) for name in (CARD, WEIGHTS)}
    card = _card(path, blobs[CARD])
    if hashlib.sha256(blobs[WEIGHTS]).hexdigest() != card["weights_sha256"]:
        raise CheckFailed(f"{path / WEIGHTS} is damaged: its SHA-256 is not the one in {CARD}; copy the folder again")
    try:
        spec = msgspec.convert(card["graph"], GraphSpec)
        config = _config(card["kind"], card["config"])
        trained_on = msgspec.convert(card["dataset"], TrainedOn)
        metrics = msgspec.convert(card["metrics"], dict[str, float])
        versions = msgspec.convert(card["versions"], dict[str, str])
    except msgspec.ValidationError as error:
        raise CheckFailed(f"{path / CARD} does not hold together: {error}") from None
    attributes = attribute_width(spec) if config.edge_attributes else 0
    try:
        normalisation = Normalisation.from_json(card["normalisation"], spec.node_width, attributes)
    except CheckFailed as error:
        raise CheckFailed(f"{path / CARD}: {error}") from None
    featurizer = Featurizer(spec, config.flow, config.edge_attributes, normalisation)
    model = build(config, spec, featurizer.edge_width)
    try:
        model.load_state_dict(load_weights(blobs[WEIGHTS]))
    except (SafetensorError, RuntimeError):
        raise CheckFailed(
            f"the weights of {path} do not fit graph {spec.name} and model {config.model!r} of its card; "
            "they were made by other code, train again"
        ) from None
    digest = hashlib.sha256(blobs[WEIGHTS] + blobs[CARD]).hexdigest()
    return Checkpoint(card["kind"], config, featurizer, model.eval(), trained_on, metrics, versions, path, digest)


def _read(path: Path, name: str) -> bytes:
    if not path.exists():
        raise JengaError(
            f"no checkpoint at {path}: there is no such folder; `jenga train` makes one, "
            f"and {' and '.join(KINDS)} come along"
        )
    try:
        return (path / name).read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        raise JengaError(
            f"{path} is no checkpoint: it has no {name}; if its training was interrupted, finish it with --resume"
        ) from None


def _card(path: Path, blob: bytes) -> dict[str, Any]:
    try:
        card = json.loads(blob)
    except (json.JSONDecodeError, UnicodeDecodeError):
        raise CheckFailed(f"{path / CARD} is damaged: it is not whole JSON; copy the folder again") from None
    if not isinstance(card, dict) or card.get("format") != "jenga-checkpoint":
        raise JengaError(f"{path / CARD} is no checkpoint's card: its format is not jenga-checkpoint")
    if card.get("format_version") != FORMAT_VERSION:
        raise JengaError(
            f"{path} has checkpoint format {card.get('format_version')}, this code reads {FORMAT_VERSION}; "
            "use the version of jenga that made it, or train again"
        )
    parts = ("kind", "config", "graph", "normalisation", "dataset", "metrics", "versions", "weights_sha256")
    missing = [part for part in parts if part not in card]
    if missing or card["kind"] not in get_args(Kind):
        raise CheckFailed(f"{path / CARD} does not hold together: {', '.join(missing) or 'kind'} missing or unknown")
    return card


def _config(kind: str, plain: Any) -> Training:
    wanted = {field.name for field in fields(CONFIGS[kind])}
    if not isinstance(plain, dict) or not wanted - LATER <= set(plain) <= wanted:
        raise msgspec.ValidationError("config has other fields than this code's")
    return msgspec.convert(plain, CONFIGS[kind])


def check_dataset(checkpoint: Checkpoint, dataset: Rows) -> str:
    """One line that says so when `dataset` is not the one that the checkpoint was trained on, "" when it is.

    Raises:
        JengaError: the dataset is of another kind than the checkpoint.
    """
    checkpoint.require(dataset.manifest.kind)
    if checkpoint.dataset.hash == dataset.hash:
        return ""
    here = dataset_name(dataset)
    other = " of another content" if here == str(checkpoint.dataset) else ""
    return f"{checkpoint.path} was trained on {checkpoint.dataset}, not on {here}{other}"
