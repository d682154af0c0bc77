"""One small pipeline of real files, made by the command line itself, once for all tests of the room."""

import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from jenga_runs import COLLECT, Made, cheap_closed_loop, jenga

with warnings.catch_warnings():
    # torch_geometric 2.8 still decorates with torch.jit.script, which torch 2.13 deprecates.
    warnings.simplefilter("ignore", DeprecationWarning)
    import torch_geometric.nn  # noqa: F401  (imported so that its warning is over before any test)

torch.set_num_threads(1)


@pytest.fixture(scope="session", autouse=True)
def one_commit(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Logs name no commit: a checkout that changes while tests run must not make two episodes differ."""
    from jenga_data.collect.rollout import provenance

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GIT_DIR", str(tmp_path_factory.getbasetemp() / "no-repository"))
        provenance.cache_clear()
        yield
    provenance.cache_clear()


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("pipeline")


@pytest.fixture(scope="session")
def selection_logs(folder: Path) -> Made:
    out = folder / "selection-logs"
    return _made(out, *COLLECT["selection"], "--episodes", 4, "--out", out, "--json")


@pytest.fixture(scope="session")
def extraction_logs(folder: Path) -> Made:
    out = folder / "extraction-logs"
    return _made(out, *COLLECT["extraction"], "--episodes", 3, "--out", out, "--json")


@pytest.fixture(scope="session")
def selection(folder: Path, selection_logs: Made) -> Made:
    out = folder / "selection"
    return _made(out, "convert", selection_logs.path, "--name", "pulls", "--version", "0.1.0", "--out", out, "--json")


@pytest.fixture(scope="session")
def dynamics(folder: Path, extraction_logs: Made) -> Made:
    out = folder / "dynamics"
    return _made(out, "convert", extraction_logs.path, "--name", "steps", "--version", "0.1.0", "--out", out, "--json")


@pytest.fixture(scope="session")
def selector(folder: Path, selection: Made) -> Made:
    return _trained("selection", selection, folder / "selector")


@pytest.fixture(scope="session")
def simulator(folder: Path, dynamics: Made) -> Made:
    return _trained("dynamics", dynamics, folder / "simulator")


@pytest.fixture(scope="session")
def closed_loop(folder: Path, simulator: Made) -> Made:
    """One tower pulled in three ways."""
    out = folder / "closed-loop"
    ways = ("--objective", "full", "naive", "straight", "--workers", 1)
    with cheap_closed_loop():
        return _made(out, "eval", "extraction", "--model", simulator.path, "--towers", 1, *ways, "--out", out, "--json")


def _trained(kind: str, dataset: Made, out: Path) -> Made:
    return _made(
        out, "train", kind, "--dataset", dataset.path, "--preset", "fast", "--epochs", 1, "--out", out, "--json"
    )


def _made(path: Path, *args: object) -> Made:
    ran = jenga(*args)
    assert ran.code == 0, ran
    return Made(path, ran)
