"""What a plan costs: the objective of the paper (section II-C, "MPPI for Block Extraction"), array to array.

    O(a_t, b, V_t, V_t+1) = O_a(a_t) + O_d(b, V_t, V_t+1)

summed over the steps of the horizon. The pull goes in -x, so that a plan that pulls has a negative cost.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jenga_data.errors import JengaError

OBJECTIVES = ("naive", "full")
"""O_a alone, the paper's baseline; and O_a + O_d."""

NORMS = ("position", "pose")
"""3-D norm of the positions, or 7-D norm of the poses, which adds metres to quaternion components."""


@dataclass(frozen=True)
class CostConfig:
    """Weights of the objective; the paper's values are the defaults.

    The paper writes the norm over V, whose entries are 7-D poses, and does not say what it adds up. In metres alone
    1 mm summed over all blocks costs as much as 0.1 mm of pull gains; `norm="pose"` is the other reading.
    """

    alpha: float = 1000.0
    beta: float = 800.0
    gamma: float = 100.0
    norm: str = "position"
    objective: str = "full"

    def __post_init__(self) -> None:
        for name, allowed in (("norm", NORMS), ("objective", OBJECTIVES)):
            if getattr(self, name) not in allowed:
                raise JengaError(f"unknown {name} {getattr(self, name)!r}; allowed: {', '.join(allowed)}")
        for name in ("alpha", "beta", "gamma"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise JengaError(f"{name} is {getattr(self, name)}; it must be finite and not negative")

    @property
    def needs_dynamics(self) -> bool:
        """Whether the objective looks at predicted towers at all: the naive one does not."""
        return self.objective == "full"


PAPER_COST = CostConfig()


def action_cost(action: Float[np.ndarray, "*batch 3"], config: CostConfig = PAPER_COST) -> Float[np.ndarray, "*batch"]:
    """O_a(a_t) = alpha a_x + beta |a_y| + beta |a_z|, actions in [m].

    It "attempts to both encourage movement in the primary extraction direction, the -x-direction, and discourage
    erroneous movements in the y and z directions".
    """
    return np.asarray(config.alpha * action[..., 0] + config.beta * np.abs(action[..., 1:]).sum(-1))


def disturbance_cost(
    pose: Float[np.ndarray, "*batch block 7"],
    next_pose: Float[np.ndarray, "*batch block 7"],
    target: int,
    config: CostConfig = PAPER_COST,
) -> Float[np.ndarray, "*batch"]:
    """O_d(b, V_t, V_t+1) = gamma * sum over i != b of ||V_t+1,i - V_t,i||, positions in [m].

    It "penalizes any displacement of blocks in the tower that are not the selected block b". With the 7-D norm, q
    and -q are the same rotation: the nearer of the two counts.
    """
    change = next_pose[..., :3] - pose[..., :3]
    if config.norm == "pose":
        quat, next_quat = pose[..., 3:], next_pose[..., 3:]
        sign = np.where((quat * next_quat).sum(-1, keepdims=True) < 0, -1.0, 1.0)
        change = np.concatenate([change, sign * next_quat - quat], axis=-1)
    moved = np.linalg.norm(change, axis=-1)
    # Summed around the target, not subtracted from the total: a target whose prediction is NaN costs nothing.
    return np.asarray(config.gamma * (moved[..., :target].sum(-1) + moved[..., target + 1 :].sum(-1)))


def plan_cost(
    actions: Float[np.ndarray, "*batch horizon 3"],
    poses: Float[np.ndarray, "*batch horizon+1 block 7"] | None,
    target: int,
    config: CostConfig = PAPER_COST,
) -> Float[np.ndarray, "*batch"]:
    """The objective summed over the horizon. `poses` starts with the tower now; the naive objective ignores it.

    Raises:
        ValueError: the objective needs predicted towers and `poses` is None.
    """
    cost = np.asarray(action_cost(actions, config).sum(-1))
    if not config.needs_dynamics:
        return cost
    if poses is None:
        raise ValueError(f"the objective {config.objective!r} needs predicted poses")
    disturbance = disturbance_cost(poses[..., :-1, :, :], poses[..., 1:, :, :], target, config)
    return np.asarray(cost + disturbance.sum(-1))
