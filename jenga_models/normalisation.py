"""Shifts and scales of what goes into a network and what comes out, taken from the training rows."""

from dataclasses import dataclass, fields, replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from jenga_data.errors import CheckFailed

MIN_SCALE = 1e-5
"""Ten micrometres, or the like in a quaternion: below it is creep of the simulated contacts, nothing to learn."""

ROLES = 2
"""Rows of displacement statistics: 0 for the other blocks, 1 for the target."""


@dataclass(frozen=True, eq=False)
class Normalisation:
    """(value - mean) / scale for node features, edge attributes, actions and displacements, in raw SI units."""

    node_mean: Float[Tensor, " feature"]
    node_scale: Float[Tensor, " feature"]
    edge_mean: Float[Tensor, " attribute"]
    edge_scale: Float[Tensor, " attribute"]
    action_mean: Float[Tensor, "3"]
    action_scale: Float[Tensor, "3"]
    delta_mean: Float[Tensor, "role 7"]
    delta_scale: Float[Tensor, "role 7"]

    @classmethod
    def none(cls, node_width: int, edge_width: int) -> "Normalisation":
        """Leaves everything as it is."""
        shapes = ((node_width,), (edge_width,), (3,), (ROLES, 7))
        return cls(*(full(shape) for shape in shapes for full in (torch.zeros, torch.ones)))

    def to(self, device: Any) -> "Normalisation":
        return replace(self, **{f.name: getattr(self, f.name).to(device) for f in fields(self)})

    def to_json(self) -> dict[str, Any]:
        """Plain lists; a float32 survives the way through JSON bit by bit."""
        return {f.name: getattr(self, f.name).tolist() for f in fields(self)}

    @classmethod
    def from_json(cls, plain: Any, node_width: int, edge_width: int) -> "Normalisation":
        """The inverse of `to_json`.

        Raises:
            CheckFailed: a part is missing, has another size, or is not finite with positive scales.
        """
        neutral = cls.none(node_width, edge_width)
        parts: dict[str, Tensor] = {}
        for field in fields(cls):
            wanted = getattr(neutral, field.name).shape
            try:
                values = torch.tensor(plain[field.name], dtype=torch.float32)
            except (KeyError, TypeError, ValueError, RuntimeError):
                raise CheckFailed(f"normalisation lacks numbers for {field.name}") from None
            if values.shape != wanted:
                raise CheckFailed(
                    f"normalisation {field.name} has shape {tuple(values.shape)}, the graph needs {tuple(wanted)}"
                )
            if not values.isfinite().all() or (field.name.endswith("_scale") and not (values > 0).all()):
                raise CheckFailed(f"normalisation {field.name} is not finite, or a scale in it is not positive")
            parts[field.name] = values
        return cls(**parts)


def moments(values: Float[Tensor, "count width"]) -> tuple[Float[Tensor, " width"], Float[Tensor, " width"]]:
    """Mean and standard deviation of each column (in double precision: heights differ in the fifth digit).

    A column that varies by less than `MIN_SCALE` gets that scale, so that noise is not blown up to a signal.
    """
    wide = values.double()
    return wide.mean(0).float(), wide.std(0, correction=0).clamp_min(MIN_SCALE).float()
