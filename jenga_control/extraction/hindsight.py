"""The ceiling of every controller: from the grasp on, the best of many pulls at the same tower, known afterwards."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from jenga_control.extraction.closed_loop import StraightPull
from jenga_data.collect.branches import Branch, Trunk
from jenga_data.collect.config import Actor, ExtractionConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.extraction import Policy, RandomPull
from jenga_data.episode import CONTROL_STEP_NS
from jenga_data.errors import JengaError
from jenga_data.outcome import Outcome

PULLS = (
    "straight-0.5", "straight-0.15", "straight-0.05", "straight-0.3", "straight-0.6", "straight-0.1", "noisy-0.5",
    "noisy-0.15", "noisy-0.3", "straight-0.2", "straight-0.075", "noisy-0.075",
)  # fmt: skip
"""Tried one after the other at speeds in m/s, noisy ones with the data's noise on every axis, until one gets the
block out without dragging another; if none does, the best is the one that got it out, and then the one that moved the
other blocks least. The first eight are the default."""


@dataclass(frozen=True)
class Hindsight:
    """A way to pull that nobody has: it tries each of `pulls` from the same state and keeps the best."""

    config: ExtractionConfig
    pulls: tuple[str, ...] = PULLS[:8]

    def __post_init__(self) -> None:
        if len(self.pulls) < 8:
            raise JengaError(f"hindsight of {len(self.pulls)} pulls; allowed: 8 and more")

    @property
    def actor(self) -> Actor:
        return Actor({"name": "hindsight", "pulls": list(self.pulls)})

    def pull(self, trunk: Trunk, tried: Callable[[str, Policy], Branch] | None = None) -> Branch:
        """The best branch; its notes say which pull it was and what came of each that was tried.

        Args:
            tried: gives the branch of a pull by its name and policy, by default from the trunk; for who has some.
        """
        if not trunk.grasped:
            return trunk.branch(StraightPull(0.0))
        found: dict[str, Branch] = {}
        for name in self.pulls:
            policy = named_pull(name, self.config, trunk)
            found[name] = tried(name, policy) if tried else trunk.branch(policy)
            verdict = found[name].result.verdict
            if verdict.outcome is Outcome.EXTRACTED and not verdict.dragged:
                break
        best = min(found, key=lambda name: _badness(found[name]))
        ends = {name: branch.result.verdict.outcome.value for name, branch in found.items()}
        notes = {"hindsight_best": best, "hindsight_tried": msgspec.json.encode(ends).decode()}
        return replace(found[best], notes=notes)


def _badness(branch: Branch) -> tuple[bool, bool, float]:
    verdict = branch.result.verdict
    return verdict.outcome is not Outcome.EXTRACTED, verdict.dragged, np.nan_to_num(verdict.moved, nan=np.inf)


def named_pull(name: str, config: ExtractionConfig, trunk: Trunk) -> Policy:
    """The open-loop pull of a name: "straight-SPEED" or "noisy-SPEED", in m/s.

    Raises:
        JengaError: there is none of that name.
    """
    kind, _, text = name.partition("-")
    speed = pull_speed(text)
    if kind == "straight":
        return StraightPull(speed)
    if kind == "noisy":
        step = speed * CONTROL_STEP_NS * 1e-9
        noisy = replace(config, slowest=step, fastest=step)
        return RandomPull(noisy, episode_rng(trunk.seed, trunk.number, name))
    raise JengaError(f"unknown pull {name!r}; allowed: straight-SPEED and noisy-SPEED, e.g. straight-0.15")


FASTEST = 0.625
"""2 cm in a control step of 32 ms [m/s]."""


def pull_speed(text: str) -> float:
    """A speed from a pull's name [m/s].

    Raises:
        JengaError: it is none, or more than an action may be.
    """
    try:
        speed = float(text)
    except ValueError:
        speed = float("nan")
    if not 0 < speed <= FASTEST:
        raise JengaError(f"{text!r} is no speed of a pull; allowed: above 0 up to {FASTEST} m/s, which is 2 cm a step")
    return speed
