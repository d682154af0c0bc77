"""What every test of this room needs before its first import."""

import warnings

import torch

with (
    warnings.catch_warnings()
):  # torch_geometric 2.8 still decorates with torch.jit.script, which torch 2.13 deprecates
    warnings.simplefilter("ignore", DeprecationWarning)
    import torch_geometric.nn  # noqa: F401

torch.set_num_threads(1)  # two threads on shared cores wait for each other ten times longer than they work
