"""What every room needs before its first import."""

import os
import signal
from collections.abc import Iterator

import jaxtyping
import pytest

os.environ["CI"] = "1"  # rerun sends no usage reports from continuous integration
os.environ["OMP_NUM_THREADS"] = "1"  # two threads on shared cores wait for each other ten times longer than they work

# A shell's background job is deaf to Ctrl-C, and so is all that it starts: tests of interrupts would find nothing.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Types and array shapes are checked while tests run; in production that costs nothing.
jaxtyping.install_import_hook(["jenga_data", "jenga_models", "jenga_control"], "shape_checker.check")


@pytest.fixture
def unchecked_shapes() -> Iterator[None]:
    """Shapes as unchecked as in production: for tests of what the code itself says to arrays that do not fit."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)
