"""Model predictive path integral control: arrays in, arrays out.

The optimizer knows neither the simulator nor the network nor the game: it draws plans, is told what each costs, and
returns their weighted mean (Williams et al. 2017, "Information theoretic MPC for model-based reinforcement
learning", and 2018, "Information-theoretic model predictive control", algorithm 2). The current mean is taken as
the base distribution (alpha = 1 in Williams 2018), so the control cost between mean and noise vanishes and a plan
costs what the caller says, nothing else.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jenga_data.errors import JengaError

Vector = tuple[float, float, float]

Rollout = Callable[[Float[np.ndarray, "sample horizon 3"]], Float[np.ndarray, " sample"]]
"""What each plan costs, summed over the horizon."""


@dataclass(frozen=True)
class MPPIConfig:
    """Parameters of the search. Actions are displacements in one control period [m].

    `sigma` is the spread of the plans around their mean, one for all axes or one for each.

    `temperature` is normalised: costs enter as (cost - best) / (median - best), so that the median plan weighs
    exp(-1 / temperature) of the best one. An absolute temperature would have to be tuned again for every
    objective, and any scale that looks at the worse half (range, standard deviation) is blown up by a single plan
    for which the model diverges, which flattens all weights. With the paper's O_a about 2 of 100 plans count at a
    temperature of 0.1, 26 at 0.3 and 85 at 1 (1 / sum of squared weights).

    `initial_action` is the mean of every step before anything is known, and after `reset`. A cost that is linear
    in a_x has no optimum to start from but the limit, which lies 20 sigma away: it starts at a slow pull instead,
    and the search moves it by about half a sigma a decision. With `warm_start` the mean is moved on by one step
    from one decision to the next, its last action repeated; without, each decision starts from `initial_action`.

    The plans that are drawn stay within the search limits, and within the executed limits as well if
    `sample_within_clip`; what is executed stays within the executed limits always. Values beyond a limit are put
    on it, not drawn again, so that the mean can reach the limit. `max_change_x` bounds the change of a_x from one
    period to the next, the first one counted from rest.
    """

    horizon: int = 5
    samples: int = 100
    sigma: float | Vector = 1e-3
    temperature: float = 0.3
    search_low: Vector = (-0.02, -0.02, -0.02)
    search_high: Vector = (0.02, 0.02, 0.02)
    execute_low: Vector = (-0.02, -0.001, -0.001)
    execute_high: Vector = (0.02, 0.001, 0.001)
    sample_within_clip: bool = True
    max_change_x: float | None = 0.013
    initial_action: Vector = (-0.002, 0.0, 0.0)
    warm_start: bool = True

    def __post_init__(self) -> None:
        for name in ("horizon", "samples", "sigma", "temperature"):
            value = np.asarray(getattr(self, name), float)
            if not (np.isfinite(value) & (value > 0)).all():
                raise JengaError(f"{name} is {getattr(self, name)}; it must be finite and above 0")
        low = np.maximum(self.search_low, self.execute_low)
        high = np.minimum(self.search_high, self.execute_high)
        if not np.all(low <= high):
            raise JengaError(f"the search and executed limits leave nothing between {tuple(low)} and {tuple(high)}")
        low, high = self.plan_limits
        if not np.all((low <= self.initial_action) & (self.initial_action <= high)):
            raise JengaError(f"initial_action {self.initial_action} is outside the limits {low} to {high}")
        if self.max_change_x is not None and not (self.max_change_x > 0 and low[0] <= 0 <= high[0]):
            raise JengaError(
                f"max_change_x is {self.max_change_x} with a_x from {low[0]} to {high[0]}; "
                "it must be above 0 and the limits must allow rest, or None for no limit"
            )

    @property
    def plan_limits(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Lowest and highest action of a sampled plan [m]."""
        low, high = np.asarray(self.search_low), np.asarray(self.search_high)
        if self.sample_within_clip:
            low, high = np.maximum(low, self.execute_low), np.minimum(high, self.execute_high)
        return low, high


PRESETS: dict[str, MPPIConfig] = {
    # Section II-C: the search is limited to 2 cm on every axis, the action (section II-A) to 0.1 cm in y and z.
    # The paper gives neither temperature nor initial mean.
    "paper": MPPIConfig(sample_within_clip=False, max_change_x=None),
    # Plans are judged by what will be done, and 13 mm a period squared of 32 ms is the 13 m/s^2 of the arm. Fast pulls
    # disturb least (the tablecloth), and a block is out before a search by 1 mm a decision has found its way there: on
    # 30 validation towers the paper's sigma and a slow start extracted 10, a start at 12 mm 17, this 18.
    "best": MPPIConfig(sigma=(4e-3, 3e-4, 3e-4), initial_action=(-8e-3, 0.0, 0.0)),
}


def mppi_preset(name: str) -> MPPIConfig:
    """Look a preset up by name.

    Raises:
        JengaError: there is no preset of that name.
    """
    if name not in PRESETS:
        raise JengaError(f"unknown MPPI preset {name!r}; allowed: {', '.join(PRESETS)}")
    return PRESETS[name]


@dataclass(frozen=True, eq=False)
class Plan:
    """One decision. `action` is to be executed; `unclipped` is what the search found, before the executed limits.

    `plans`, `costs` and `weights` are the samples, the first of them last decision's mean without noise; a cost
    that was not finite is infinite here and weighs 0. `mean` is the weighted mean plan.
    """

    action: Float[np.ndarray, "3"]
    unclipped: Float[np.ndarray, "3"]
    plans: Float[np.ndarray, "sample horizon 3"]
    costs: Float[np.ndarray, " sample"]
    weights: Float[np.ndarray, " sample"]
    mean: Float[np.ndarray, "horizon 3"]


def softmax_weights(costs: Float[np.ndarray, " sample"], temperature: float) -> Float[np.ndarray, " sample"]:
    """Weights of the plans, summing to 1: exp(-(cost - best) / ((median - best) * temperature)).

    Costs that are not finite weigh 0, and do not enter the median. Where half of all plans are equally good, those
    share the weight.

    Raises:
        JengaError: no cost is finite.
    """
    finite = np.isfinite(costs)
    if not finite.any():
        raise JengaError(
            f"none of {len(costs)} sampled plans has a finite cost: the dynamics model diverged; "
            "train it on data like this tower, or run the naive objective, which needs no model"
        )
    best = costs[finite].min()
    scale = (np.median(costs[finite]) - best) * temperature
    excess = np.where(finite, costs, np.inf) - best
    with np.errstate(over="ignore"):
        weights = np.exp(-excess / scale) if scale > 0 else (excess == 0).astype(float)
    return weights / weights.sum()


class Controller:
    """Plans one action after another. Its whole state is the generator, the mean plan and the last action."""

    def __init__(self, config: MPPIConfig, rng: np.random.Generator) -> None:
        self.config = config
        self._rng = rng
        self.reset()

    def reset(self) -> None:
        """Forget the plan: the next decision starts from `initial_action`, at rest. The generator runs on."""
        self._mean = np.tile(np.asarray(self.config.initial_action, float), (self.config.horizon, 1))
        self._last_x = 0.0

    def plan(self, rollout: Rollout) -> Plan:
        """Draw plans, have `rollout` cost them, and return what to do now.

        Raises:
            JengaError: no plan has a finite cost.
            ValueError: `rollout` does not return one cost a plan.
        """
        c = self.config
        noise = self._rng.normal(0.0, c.sigma, (c.samples, c.horizon, 3))
        noise[0] = 0.0
        plans = self._limited(self._mean + noise, *c.plan_limits)
        costs = np.asarray(rollout(plans.copy()), float)
        if costs.shape != (c.samples,):
            raise ValueError(f"rollout returned costs of shape {costs.shape}, not ({c.samples},)")
        weights = softmax_weights(costs, c.temperature)
        # The rounding of the sum may carry the mean across a limit on which all plans lie.
        mean = self._limited(np.tensordot(weights, plans, axes=1), *c.plan_limits)
        action = self._limited(mean[:1], np.asarray(c.execute_low), np.asarray(c.execute_high))[0]

        if c.warm_start:
            self._mean = np.concatenate([mean[1:], mean[-1:]])
        self._last_x = float(action[0])
        return Plan(
            action=action,
            unclipped=mean[0].copy(),
            plans=plans,
            costs=np.where(np.isfinite(costs), costs, np.inf),
            weights=weights,
            mean=mean,
        )

    def _limited(
        self,
        plans: Float[np.ndarray, "*batch horizon 3"],
        low: Float[np.ndarray, "3"],
        high: Float[np.ndarray, "3"],
    ) -> Float[np.ndarray, "*batch horizon 3"]:
        """Put plans on the limits, first each action, then the change of a_x from one period to the next."""
        plans = np.clip(plans, low, high)
        if (change := self.config.max_change_x) is not None:
            last = np.full(plans.shape[:-2], self._last_x)
            for step in range(plans.shape[-2]):
                last = plans[..., step, 0] = np.clip(plans[..., step, 0], last - change, last + change)
        return plans
