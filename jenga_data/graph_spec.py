"""The graphs of the paper by name: which columns their nodes hold. Light to import, for the command line."""

from dataclasses import dataclass

from jenga_data.errors import JengaError


@dataclass(frozen=True)
class GraphSpec:
    """Which columns of a dataset make a graph: per-node features in order, and whether the action is appended."""

    name: str
    node_features: tuple[str, ...]
    action: bool = False

    def __post_init__(self) -> None:
        unknown = [f for f in self.node_features if f not in FEATURE_WIDTH]
        if unknown:
            raise JengaError(f"unknown node features {unknown}; allowed: {', '.join(FEATURE_WIDTH)}")

    @property
    def node_width(self) -> int:
        """Numbers a node, the action not counted."""
        return sum(FEATURE_WIDTH[f] for f in self.node_features)


FEATURE_WIDTH: dict[str, int] = {
    "block_size": 3,
    "block_mass": 1,
    "target_flag": 1,
    "block_pose": 7,
    "block_twist": 6,
    "level": 1,
    "slot": 3,
    "orientation": 1,
}
"""Node features by the name of their column and how many numbers each has; `slot` is one-hot."""

GRAPHS: dict[str, GraphSpec] = {
    spec.name: spec
    for spec in (
        GraphSpec("G_s", ("block_size", "block_mass", "target_flag")),
        GraphSpec("G_sp", ("block_size", "block_mass", "target_flag", "block_pose")),
        GraphSpec("G_s+layout", ("block_size", "block_mass", "target_flag", "level", "slot", "orientation")),
        GraphSpec("G_e", ("block_mass", "target_flag", "block_pose"), action=True),
        GraphSpec("G_e+motion", ("block_size", "block_mass", "target_flag", "block_pose", "block_twist"), action=True),
    )
}
"""The graphs of the paper (section II-B, II-C), and G_s with the layout, which tells a middle block from a side one;
and G_e with sizes and velocities, without which nobody can say what a contact does."""


def graph_spec(name: str) -> GraphSpec:
    """Look a graph up by name.

    Raises:
        JengaError: there is no graph of that name.
    """
    if name not in GRAPHS:
        raise JengaError(f"unknown graph {name!r}; allowed: {', '.join(GRAPHS)}")
    return GRAPHS[name]
