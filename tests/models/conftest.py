"""Datasets of small made-up towers, and checkpoints trained on them for an instant."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from fake_towers import FakeDataset, fake_dataset

with (
    warnings.catch_warnings()
):  # torch_geometric 2.8 still decorates with torch.jit.script, which torch 2.13 deprecates
    warnings.simplefilter("ignore", DeprecationWarning)
    import torch_geometric.nn  # noqa: F401

from jenga_models.config import DYNAMICS_PRESETS, SELECTION_PRESETS

torch.set_num_threads(1)  # two threads on shared cores wait for each other ten times longer than they work


@pytest.fixture(scope="session")
def selection_data() -> FakeDataset:
    return fake_dataset("selection", 300)


@pytest.fixture(scope="session")
def dynamics_data() -> FakeDataset:
    return fake_dataset("dynamics", 150)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


QUICK = {"width": 16, "accelerator": "cpu"}


@pytest.fixture(scope="session")
def selector_path(selection_data: FakeDataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A selector trained until it knows the made-up label."""
    from jenga_models.train import train_selection

    config = replace(SELECTION_PRESETS["fast"], epochs=25, learning_rate=1e-2, **QUICK)
    return train_selection(selection_data, config, tmp_path_factory.mktemp("models") / "selector").path


@pytest.fixture(scope="session")
def simulator_path(dynamics_data: FakeDataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulator trained until it knows the made-up motion."""
    from jenga_models.train import train_dynamics

    config = replace(DYNAMICS_PRESETS["fast"], epochs=40, batch_size=16, learning_rate=1e-2, **QUICK)
    return train_dynamics(dynamics_data, config, tmp_path_factory.mktemp("models") / "simulator").path
