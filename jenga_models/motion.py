"""What of a tower decides how it moves: relative, dimensionless features of blocks and of pairs that may touch.

Nothing here knows where the tower stands: positions count relative to the target and to each other. Blocks are boxes
that lie nearly along x or y, so that turning one by half a turn about any of its axes changes no feature. Contacts of
the simulator, as those of wood, give by hundredths of a millimetre under load: the gaps at the corners where two
blocks overlap, in units of ten micrometres, say which of them carries how much.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from jenga_data.clock import CONTROL_STEP_NS
from jenga_models.graphs import Graphs

STEP = CONTROL_STEP_NS * 1e-9
MILLIMETRE = 1e-3
LEVER = 0.025
"""Rotations enter as what they move so far from the centre [m]: the distance between two slots."""
NEIGHBOURS = 0.065
"""Blocks of one level are a pair up to this distance of their centres across the level [m]."""
SAME_LEVEL = 0.0075
"""Two blocks are of one level up to half a block's height [m]."""
NODE_WIDTH, PAIR_WIDTH = 36, 30

_SIZE, _SIZE_SPREAD = (0.075, 0.025, 0.015), (3e-4, 2.5e-4, 1.75e-4)
_MASS, _MASS_SPREAD = 0.0193, 0.0014
_FINE, _GAP = 2e-5, 1e-5
"""Where displacements and gaps turn from linear to logarithmic [m]."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """Blocks in the world, as boxes along its axes that are turned by a small vector `tilt` [rad]."""

    flag: Float[Tensor, "*sample node"]
    position: Float[Tensor, "*sample node 3"]
    along_x: Bool[Tensor, "*sample node"]
    extent: Float[Tensor, "*sample node 3"]
    """Edge lengths along the world's axes [m]."""
    mass: Float[Tensor, "*sample node"]
    tilt: Float[Tensor, "*sample node 3"]
    velocity: Float[Tensor, "*sample node 3"]
    """Displacement of the centre in a control step at the present velocity [m]."""
    turning: Float[Tensor, "*sample node 3"]
    """Rotation in a control step at the present velocity [rad]."""

    @classmethod
    def of(cls, node: Float[Tensor, "*sample node 18"]) -> "Bodies":
        """From raw features in the order of the graph `G_e+motion`: size, mass, target flag, pose, twist."""
        size, mass, flag, pose, twist = node.split([3, 1, 1, 7, 6], dim=-1)
        axes = _axes(pose[..., 3:])
        along_x = axes[..., 0, 0].abs() > axes[..., 1, 0].abs()
        order = torch.where(along_x[..., None], torch.tensor([0, 1, 2]), torch.tensor([1, 0, 2])).to(node.device)
        extent = size.gather(-1, order)
        turned = axes.gather(-1, order[..., None, :].expand(axes.shape))  # columns: the axis nearest to x, y, z
        turned = turned * torch.where(turned.diagonal(dim1=-2, dim2=-1) < 0, -1.0, 1.0)[..., None, :]
        tilt = torch.stack(
            [
                turned[..., 2, 1] - turned[..., 1, 2],
                turned[..., 0, 2] - turned[..., 2, 0],
                turned[..., 1, 0] - turned[..., 0, 1],
            ],
            dim=-1,
        )
        velocity, turning = (twist * STEP).split(3, dim=-1)
        return cls(flag[..., 0], pose[..., :3], along_x, extent, mass[..., 0], tilt / 2, velocity, turning)


def _axes(quat: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 3 3"]:
    """Rotation matrices of wxyz quaternions."""
    w, x, y, z = quat.unbind(-1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)


def squashed(value: Tensor, unit: float) -> Tensor:
    """Linear up to about `unit`, logarithmic beyond: hundredths of a millimetre count, and so do centimetres."""
    return torch.asinh(value / unit)


def node_features(
    bodies: Bodies,
    target: Float[Tensor, "*sample #node 3"],
    lag: Float[Tensor, "*sample #node 3"],
    graph: Int[Tensor, " node"] | None,
) -> Float[Tensor, "*sample node feature"]:
    """Features of each block; `target` is where its graph's target is, `lag` how far the hand is behind [m]."""
    b = bodies
    size = b.extent - torch.where(
        b.along_x[..., None], b.extent.new_tensor(_SIZE), b.extent.new_tensor([_SIZE[1], _SIZE[0], _SIZE[2]])
    )
    off = b.position - target
    moving = torch.cat([b.velocity, b.turning * LEVER], dim=-1)
    return torch.cat(
        [
            b.flag[..., None],
            b.along_x[..., None].to(off.dtype),
            size / size.new_tensor(_SIZE_SPREAD),
            (b.mass[..., None] - _MASS) / _MASS_SPREAD,
            off / LEVER,
            squashed(off[..., 2:], 0.015),
            b.position[..., 2:] / 0.15,
            _mass_above(b, graph)[..., None] / 0.5,
            squashed(b.tilt, 1e-3),
            moving / MILLIMETRE,
            squashed(moving, _FINE),
            squashed(off[..., :2], 1e-3),
            (off[..., 2:].abs() < SAME_LEVEL).to(off.dtype),
            b.flag[..., None] * lag / MILLIMETRE,
            b.flag[..., None] * squashed(lag, _FINE),
        ],
        dim=-1,
    )


def _mass_above(b: Bodies, graph: Int[Tensor, " node"] | None) -> Float[Tensor, "*sample node"]:
    """Mass of all blocks of the same graph that lie half a block higher or more [kg]."""
    height, mass = b.position[..., 2], b.mass
    if graph is not None:
        blocks = int(torch.bincount(graph)[0])
        height, mass = height.view(-1, blocks), mass.view(-1, blocks)
    higher = height[..., None, :] > height[..., :, None] + SAME_LEVEL
    return (higher * mass[..., None, :]).sum(-1).reshape(b.mass.shape)


def pairs(graphs: Graphs, bodies: Bodies) -> tuple[Int[Tensor, "2 pair"], Int[Tensor, " pair"]]:
    """Sender and receiver of every message, and which kind it is: 0 from above, 1 from below, 2 within a level."""
    upper, lower = graphs.edge_index
    position = bodies.position
    shared = position.reshape(-1, *position.shape[-2:])[0] if graphs.graph is None else position
    blocks = len(shared) if graphs.graph is None else len(shared) // len(graphs)
    each = shared.view(-1, blocks, 3)
    between = (each[:, :, None] - each[:, None]).abs()
    level = (between[..., 2] < SAME_LEVEL) & (between[..., :2].amax(-1) < NEIGHBOURS)
    level &= ~torch.eye(blocks, dtype=torch.bool, device=level.device)
    which, first, second = level.nonzero(as_tuple=True)
    beside = torch.stack([first, second]) + which * blocks
    index = torch.cat([torch.stack([upper, lower]), torch.stack([lower, upper]), beside], dim=1)
    kind = torch.cat(
        [torch.full((n,), k, device=index.device) for k, n in enumerate((len(upper), len(upper), beside.shape[1]))]
    )
    return index, kind


def pair_features(
    bodies: Bodies, index: Int[Tensor, "2 pair"], kind: Int[Tensor, " pair"]
) -> Float[Tensor, "*sample pair feature"]:
    """What the sender is to the receiver: where it lies, how they touch and how they slide."""

    def of(values: Tensor, end: int) -> Tensor:
        return values.index_select(-2, index[end])

    off = of(bodies.position, 0) - of(bodies.position, 1)
    half_s, half_r = of(bodies.extent, 0) / 2, of(bodies.extent, 1) / 2
    low = torch.maximum(off - half_s, -half_r)  # the box in which both lie, seen from the receiver's centre
    high = torch.minimum(off + half_s, half_r)
    middle, overlap = (low + high) / 2, high - low
    tilt_s, tilt_r = of(bodies.tilt, 0), of(bodies.tilt, 1)
    slide = (
        of(bodies.velocity, 0)
        + torch.linalg.cross(of(bodies.turning, 0), middle - off)
        - of(bodies.velocity, 1)
        - torch.linalg.cross(of(bodies.turning, 1), middle)
    )
    gaps = []
    above = torch.where(off[..., 2] > 0, 1.0, -1.0)
    for x in (low[..., 0], high[..., 0]):
        for y in (low[..., 1], high[..., 1]):
            # A face tilted by (rx, ry) is higher by rx * y - ry * x.
            sender = off[..., 2] + tilt_s[..., 0] * (y - off[..., 1]) - tilt_s[..., 1] * (x - off[..., 0])
            receiver = tilt_r[..., 0] * y - tilt_r[..., 1] * x
            gaps.append(above * (sender - receiver) - half_s[..., 2] - half_r[..., 2])
    upright = (kind < 2).to(off.dtype)[:, None]
    gap = squashed(torch.stack(gaps, dim=-1), _GAP) * upright
    # The sum of springs that are pressed: about proportional to the load that this pair carries.
    pressed = torch.relu(-torch.stack(gaps, dim=-1)) / _GAP * upright
    beside = squashed(-overlap[..., :2], 1e-4) * (1 - upright)
    kinds = torch.nn.functional.one_hot(kind, 3).to(off.dtype).expand(*off.shape[:-1], 3)
    return torch.cat(
        [
            kinds,
            off / LEVER,
            overlap[..., :2] / LEVER,
            middle[..., :2] / LEVER,
            gap,
            pressed.clamp_max(10.0) / 3,
            beside,
            (tilt_s - tilt_r) / 5e-3,
            slide / MILLIMETRE,
            squashed(slide, _FINE),
            (of(bodies.flag[..., None], 0)),
        ],
        dim=-1,
    )
