"""What every room needs before its first import."""

import os

from jaxtyping import install_import_hook

os.environ["CI"] = "1"  # rerun sends no usage reports from continuous integration
os.environ["OMP_NUM_THREADS"] = "1"  # two threads on shared cores wait for each other ten times longer than they work

# Types and array shapes are checked while tests run; in production that costs nothing.
install_import_hook(["jenga_data", "jenga_models", "jenga_control"], "shape_checker.check")
