"""The ways to pull by their names: what `jenga eval extraction --objective` takes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from jenga_control.extraction.closed_loop import DYNAMICS, ClosedLoop
from jenga_control.extraction.hindsight import PULLS, Hindsight, pull_speed
from jenga_control.extraction.touch import TouchConfig
from jenga_control.planning.cost import CostConfig
from jenga_control.planning.mppi import PRESETS, mppi_preset
from jenga_data.collect.branches import Branch, Trunk
from jenga_data.collect.config import ExtractionConfig
from jenga_data.errors import JengaError

Way = ClosedLoop | Hindsight
KNOWN = "full, naive, straight-SPEED and hindsight; full and naive also with -paper or -best, full with -simulator"


@dataclass(frozen=True)
class Choices:
    """What a name leaves open.

    `search` overrides the preset where it is given; `models` are folders of dynamics checkpoints: with more than one,
    each objective that asks a model is evaluated once for each, named by its hash.
    """

    config: ExtractionConfig
    models: tuple[Path, ...] = ()
    preset: str = "best"
    dynamics: str = "learned"
    touch: TouchConfig | None = None
    simulator_search: tuple[int, int] = (16, 3)
    """Samples and horizon where the simulator is the model."""


def ways(names: Sequence[str], choices: Choices) -> dict[str, Way]:
    """The ways to pull of these names, in their order.

    Raises:
        JengaError: none or one twice, an unknown name, or one needs a model and none was given.
    """
    if not names or len(set(names)) < len(names):
        raise JengaError(f"ways to pull: {', '.join(names) or 'none'}; allowed: one or more of {KNOWN}, each once")
    found: dict[str, Way] = {}
    for name in names:
        found |= _ways_of(name, choices)
    return found


def _ways_of(name: str, choices: Choices) -> dict[str, Way]:
    kind, *rest = name.split("-")
    if kind == "hindsight" and len(rest) <= 1:
        return {name: Hindsight(choices.config, PULLS[: _count(rest[0])] if rest else PULLS[:8])}
    naive = CostConfig(objective="naive")
    if kind == "straight" and len(rest) <= 1:
        speed = pull_speed(rest[0]) if rest else ClosedLoop.speed
        loop = ClosedLoop(choices.config, "straight", mppi_preset("best"), naive, speed=speed, touch=choices.touch)
        return {name: loop}
    if kind not in ("full", "naive") or any(word not in (*PRESETS, *DYNAMICS) for word in rest):
        raise JengaError(f"unknown way to pull {name!r}; allowed: {KNOWN}")
    preset = next((word for word in rest if word in PRESETS), choices.preset)
    dynamics = next((word for word in rest if word in DYNAMICS), choices.dynamics)
    search = mppi_preset(preset)
    if kind == "naive":
        return {name: ClosedLoop(choices.config, kind, search, naive, touch=choices.touch)}
    if dynamics == "simulator":
        samples, horizon = choices.simulator_search
        search = replace(search, samples=samples, horizon=horizon)
    full = ClosedLoop(choices.config, kind, search, CostConfig(), dynamics=dynamics, touch=choices.touch)
    return _with_models(name, full, choices.models) if dynamics == "learned" else {name: full}


def _count(text: str) -> int:
    """How many pulls hindsight has."""
    if not (text.isdecimal() and int(text) <= len(PULLS)):
        raise JengaError(f"hindsight of {text!r} pulls; allowed: 8 to {len(PULLS)}, e.g. hindsight-{len(PULLS)}")
    return int(text)


def _with_models(name: str, loop: ClosedLoop, models: Sequence[Path]) -> dict[str, Way]:
    from jenga_models.checkpoint import load
    from jenga_models.pretrained import pretrained

    models = models or (pretrained("dynamics"),)
    loops = [replace(loop, model=model, model_hash=load(model).require("dynamics").hash) for model in models]
    if len(loops) == 1:
        return {name: loops[0]}
    named: dict[str, Way] = {f"{name}-{loop.model_hash[:8]}": loop for loop in loops}
    if len(named) < len(loops):
        raise JengaError("one of the models was given twice; name each checkpoint once")
    return named


@dataclass(frozen=True)
class Pullers:
    """Makes, in a worker process, what pulls at one tower in every way; straight pulls are simulated once a tower."""

    ways: dict[str, Way]

    def __call__(self, trunk: Trunk) -> "Puller":
        return Puller(self.ways, trunk)


class Puller:
    """All ways at one tower."""

    def __init__(self, ways: dict[str, Way], trunk: Trunk) -> None:
        self._ways, self._trunk = ways, trunk
        self._straight: dict[float, Branch] = {}

    def __call__(self, name: str) -> Branch:
        way = self._ways[name]
        if isinstance(way, Hindsight):
            return way.pull(self._trunk, self._tried)
        if way.controller == "straight" and way.touch is None:
            return self._once(way.speed, lambda: way.pull(self._trunk))
        return way.pull(self._trunk)

    def _tried(self, name: str, policy) -> Branch:
        kind, _, speed = name.partition("-")
        if kind == "straight":
            return self._once(float(speed), lambda: self._trunk.branch(policy))
        return self._trunk.branch(policy)

    def _once(self, speed: float, pull) -> Branch:
        if speed not in self._straight:
            self._straight[speed] = pull()
        return self._straight[speed]
