"""What manifests say in words: labels with their thresholds, licence, citation."""

from dataclasses import asdict

from jenga_data.dataset.manifest import Feature, Label
from jenga_data.dataset.schema import FORMAT_VERSION, columns_of
from jenga_data.graph import MAX_GAP, MAX_SINK, MIN_OVERLAP
from jenga_data.outcome import THRESHOLDS

LICENCE = "CC-BY-4.0"
"""Of the data. The code has its own, MIT."""

CITATION = (
    "K. Puthuveetil, X. Zhang, K. Yokoyama, T. Narita: Strategic Jenga Play via Graph Based Dynamics Modeling. "
    "arXiv:2505.09377, 2025.",
    "jenga: a dataset and training toolkit for robot learning with Jenga as the testbed.",
)

DESCRIPTION = {
    "selection": "Block selection in Jenga: towers before a pull and what became of it, one row a (J, b, f). "
    "Simulated with MuJoCo after the experiment of arXiv:2505.09377, section II-B.",
    "dynamics": "Block extraction in Jenga: a tower, the gripper's action and the tower one control step later, one "
    "row a (J_t, b, a_t, J_t+1). Simulated with MuJoCo after the experiment of arXiv:2505.09377, section II-C.",
}


def labels() -> list[Label]:
    """Definitions of all labels and of the edges, decided in this order."""
    limit = asdict(THRESHOLDS)

    def label(name: str, definition: str, *thresholds: str) -> Label:
        return Label(name, definition, {t: limit[t] for t in thresholds})

    edges = {"max_gap": MAX_GAP, "max_sink": MAX_SINK, "min_overlap": MIN_OVERLAP}
    return [
        label("invalid", "the physics broke (not finite, or faster than speed_limit): in no dataset", "speed_limit"),
        label("collapsed", "any block but the target has dropped by more than drop", "drop"),
        label("extracted", "the target is clear of the tower, which still stands `standing` later", "standing"),
        label("stuck", "all else"),
        label("failure", "stuck or collapsed: the paper's f = 1"),
        label("dragged", "a block but the target moved sideways by more than drag", "drag"),
        label("strict_failure", "failure or dragged"),
        label("target_clear", "no other block's footprint overlaps the target's from this frame on"),
        Label(
            "edge",
            "the upper block's bottom lies less than max_gap above and less than max_sink below the lower block's top, "
            "and their footprints overlap by more than min_overlap",
            edges,
        ),
    ]


def features(kind: str, blocks: int, format_version: str = FORMAT_VERSION) -> list[Feature]:
    """The columns of `data/` as the manifest lists them."""
    columns = columns_of(kind, format_version)
    return [Feature(c.name, c.dtype, c.resolved(blocks), c.unit, c.frame, c.description) for c in columns]
