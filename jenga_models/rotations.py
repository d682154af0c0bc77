"""Rotations of blocks as vectors: axis times angle [rad], in the world; quaternions are wxyz."""

import torch
from jaxtyping import Float
from torch import Tensor


def product(first: Float[Tensor, "*batch 4"], second: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 4"]:
    """The rotation `second`, and then `first`."""
    w, v = first[..., :1], first[..., 1:]
    u, q = second[..., :1], second[..., 1:]
    real = w * u - (v * q).sum(-1, keepdim=True)
    return torch.cat([real, w * q + u * v + torch.linalg.cross(v, q)], dim=-1)


def between(start: Float[Tensor, "*batch 4"], end: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 3"]:
    """The rotation that takes `start` to `end`, the short way."""
    turn = product(end, torch.cat([start[..., :1], -start[..., 1:]], dim=-1))
    turn = torch.where(turn[..., :1] < 0, -turn, turn)
    length = turn[..., 1:].norm(dim=-1, keepdim=True)
    angle = 2 * torch.atan2(length, turn[..., :1])
    # Towards no rotation at all the ratio tends to 2.
    return turn[..., 1:] * torch.where(length > 0, angle / length.clamp_min(1e-30), 2.0)


def turned(quat: Float[Tensor, "*batch 4"], rotation: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 4"]:
    """`quat` after a rotation in the world, of length 1: the inverse of `between`."""
    half = rotation / 2
    angle = half.norm(dim=-1, keepdim=True)
    turn = torch.cat([angle.cos(), half * torch.sinc(angle / torch.pi)], dim=-1)
    return torch.nn.functional.normalize(product(turn, quat), dim=-1)
