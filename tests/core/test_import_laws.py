"""Which module may load which, in fresh interpreters: what pytest has loaded itself does not count."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
HEAVY = ("numpy", "scipy", "mujoco", "pyarrow", "mcap", "google.protobuf", "rerun", "rich", "matplotlib", "torch")
LEARNING = ("torch", "torch_geometric", "lightning", "safetensors")

IMPORT_ALL = """
import importlib, pkgutil, {package}
for module in pkgutil.walk_packages({package}.__path__, "{package}."):
    importlib.import_module(module.name)
"""


def loaded(code: str, names: tuple[str, ...]) -> list[str]:
    """Which of the named modules a fresh interpreter has after running `code`."""
    code += f"\nimport sys; print(*[name for name in {names} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_imports_go_one_way():
    """The contracts in pyproject.toml, which see every import, also those inside functions."""
    command = [str(Path(sys.executable).with_name("lint-imports")), "--no-cache"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert " 0 broken" in done.stdout


def test_no_module_of_jenga_data_loads_torch():
    everything = IMPORT_ALL.format(package="jenga_data")
    assert loaded(everything, (*LEARNING, "mujoco", "pyarrow")) == ["mujoco", "pyarrow"]


def test_packages_themselves_load_nothing():
    packages = sorted(
        ".".join(file.parent.relative_to(ROOT).parts)
        for top in ("jenga_data", "jenga_models", "jenga_control")
        for file in (ROOT / top).rglob("__init__.py")
        if file.parent.name != "proto"
    )
    assert len(packages) >= 8
    assert loaded("import " + ", ".join(packages), HEAVY) == []


@pytest.mark.parametrize(
    "module",
    [
        "cli",
        "jenga_data.collect.config",
        "jenga_data.graph_spec",
        "jenga_data.progress",
        "jenga_data.sim.physics",
    ],
)
def test_what_the_command_line_needs_for_its_help_is_light(module):
    assert loaded(f"import {module}", HEAVY) == []
