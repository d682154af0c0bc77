"""How much of the friction that is there a tower needs to be moved as one piece."""

import numpy as np
from jaxtyping import Float
from scipy.optimize import linprog
from scipy.sparse import coo_array, hstack, kron

from jenga_data.blocks import Blocks
from jenga_data.statics import Equilibrium, PlanarPose

_SIDES = 16
"""A contact's disc of friction is replaced by a polygon within it: at most 2 % too little."""
_LEAST_FORCE = 1e-6
"""A contact that carries less [N] holds nothing."""


def friction_share(
    blocks: Blocks,
    planar: PlanarPose,
    rest: Equilibrium,
    acceleration: Float[np.ndarray, "block 2"],
    spin: Float[np.ndarray, " block"],
    friction: float,
) -> float:
    """The least s for which friction forces of at most s mu N at each contact give all blocks their accelerations.

    With the normal forces N as at rest, forces f_c are sought for which each block i has

        sum f_c = m_i a_i,    sum (x_c - x_i) x f_c = I_i alpha_i,    |f_c| <= s mu N_c,

    a contact's force acting on the block above, and its opposite on the block below: a linear program. By the static
    theorem of limit analysis nothing has to slide where s <= 1. What the accelerations change in the normal forces is
    left out: it is of the order of acceleration over gravity.

    Args:
        acceleration: of each block's centre along x and y [m/s^2].
        spin: angular acceleration of each block about z [rad/s^2].
        friction: mu.

    Raises:
        ValueError: the contacts cannot give these accelerations, however rough they are.
    """
    held = np.flatnonzero(rest.force > _LEAST_FORCE)
    count = len(held)
    rows, columns, values = [], [], []
    for body, sign in ((rest.upper[held], 1.0), (rest.lower[held], -1.0)):
        (on,) = np.nonzero(body >= 0)
        lever = rest.xy[held][on] - planar.xy[body[on]]
        # Force along x and y, and moment about z: rows 3 i to 3 i + 2 of block i.
        rows += [3 * body[on], 3 * body[on] + 1, 3 * body[on] + 2, 3 * body[on] + 2]
        columns += [2 * on, 2 * on + 1, 2 * on, 2 * on + 1]
        values += [np.full(len(on), sign), np.full(len(on), sign), -sign * lever[:, 1], sign * lever[:, 0]]
    size = (3 * len(blocks), 2 * count + 1)
    balance = coo_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), size)
    inertia = blocks.mass * (blocks.size[:, 0] ** 2 + blocks.size[:, 1] ** 2) / 12
    needed = np.column_stack([blocks.mass[:, None] * acceleration, inertia * spin]).ravel()

    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    sides = kron(np.eye(count), np.column_stack([np.cos(angle), np.sin(angle)]), format="coo")
    there = friction * np.cos(np.pi / _SIDES) * np.repeat(rest.force[held], _SIDES)
    found = linprog(
        np.append(np.zeros(2 * count), 1.0),
        A_ub=hstack([sides, coo_array(-there[:, None])], format="csr"),
        b_ub=np.zeros(_SIDES * count),
        A_eq=balance.tocsr(),
        b_eq=needed,
        bounds=(None, None),
    )
    if found.status != 0:
        raise ValueError(f"no friction gives these accelerations: {found.message}")
    return float(found.x[-1])
