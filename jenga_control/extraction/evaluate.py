"""Evaluating the closed loop: the same towers and targets for every way to pull, read from the logs it leaves."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from jenga_control.extraction.closed_loop import ClosedLoop
from jenga_control.extraction.hindsight import Hindsight
from jenga_control.extraction.scores import Ended, paired, scores
from jenga_control.extraction.selected_stage import selected_stage
from jenga_control.extraction.touch import TouchConfig
from jenga_control.extraction.ways import Choices, Pullers, Way, ways
from jenga_data.collect.branch_workers import Missing, branch_path, run_branches
from jenga_data.collect.branches import Trunk
from jenga_data.collect.config import SEED_LIMIT, Actor, ExtractionConfig
from jenga_data.collect.set_aside import refuse_missing
from jenga_data.errors import JengaError
from jenga_data.log.reader import read_episode, read_header

TIMED_DECISIONS = 20
TOWER_TIMEOUT = 7200.0
"""Longest time for one tower in all ways [s], learned dynamics on a busy core included."""
NAMES = ("full", "naive", "straight")
PAPER = {"full": 0.65, "naive": 0.54}
"""Success of 100 rollouts each in the paper's table II."""

APPROACH_SECONDS = {"robot": 12.0, "gripper": 1.5}
"""What a tower costs up to the grasp, spawning included [s of one core], measured on 18 levels..."""
PULL_SECONDS = {"straight": 5.0, "naive": 6.0, "full": 10.0, "hindsight": 22.0, "simulator": 120.0}
"""...and each way to pull from there on. Hindsight takes 6 s where its first pull is a clean success, and 45 s where
none of its eight is."""


@dataclass(frozen=True)
class Switches:
    """What goes past the paper, each on its own."""

    select: Path | None = None
    """Folder of a selection checkpoint: it picks the target among all legal ones, in place of chance."""
    push_control: bool = False
    """The robot's push watches the other blocks (`jenga_data.collect.careful_push`)."""
    touch: TouchConfig | None = None
    """The pull heeds what the fingers feel."""

    def as_dict(self) -> dict[str, bool]:
        return {"select": self.select is not None, "push_control": self.push_control, "touch": self.touch is not None}


PLAIN = Switches()


def evaluate_extraction(
    models: Path | Sequence[Path] | None,
    out: Path,
    controllers: Sequence[str] = NAMES,
    towers: int = 100,
    seed: int = SEED_LIMIT,
    workers: int = 2,
    preset: str = "best",
    config: ExtractionConfig | None = None,
    dynamics: str = "learned",
    switches: Switches = PLAIN,
    simulator_search: tuple[int, int] = (16, 3),
) -> dict[str, Any]:
    """Pull the same targets of `towers` towers in each way; every rollout is logged in `out`, a folder for each way.

    A tower is simulated up to the grasp once; all ways go on from there. Every tower that was started is in the
    denominator, those that were not grasped included. The report is that of the first way, with the others under
    `baselines` and the paired difference to each.

    Args:
        controllers: names as `ways` takes them.
        simulator_search: samples and horizon where the simulator is the model.

    Raises:
        JengaError: no way or one twice, one needs a model and none was given, or the folder holds something else.
        CheckFailed: a rollout had to be set aside.
    """
    config = config or ExtractionConfig()
    if seed < SEED_LIMIT:
        raise JengaError(f"seed is {seed}; evaluation uses seeds from {SEED_LIMIT} up, which no training data may have")
    if config.body != "robot" and (switches.select or switches.push_control):
        raise JengaError("--select and --push-control are for the whole robot; leave --gripper out")
    given = (models,) if isinstance(models, Path) else tuple(models or ())
    choices = Choices(config, given, preset, dynamics, switches.touch, simulator_search)
    found = ways(controllers, choices)
    actors = {name: switched(way.actor, switches) for name, way in found.items()}
    trunk = partial(_trunk, switches.select, switches.push_control)

    def tell(missing: Missing) -> None:
        if sys.stderr.isatty():  # for people, as the bars
            sys.stderr.write(cost_line(found, config.body, workers, missing) + "\n")

    pullers = Pullers(found)
    done = run_branches(
        pullers, actors, config, seed, range(towers), workers, out, trunk, "pulling", TOWER_TIMEOUT, tell
    )
    for name in found:
        refuse_missing(out / name, done[name])  # a tower that is left out would spoil the comparison
    ended = {
        name: [_ended(branch_path(out, name, config, seed, number, actors[name])) for number in range(towers)]
        for name in found
    }
    return _report(found, ended, switches, out)


def switched(actor: Actor, switches: Switches) -> Actor:
    """The actor with the switches in its settings, so that keys and recipes differ; unchanged where none is on."""
    settings = dict(actor.controller)
    if switches.select is not None:
        settings["select"] = _selector_hash(switches.select)
    if switches.push_control:
        from jenga_data.collect.careful_push import SETTINGS

        settings["push_control"] = SETTINGS
    return Actor(settings, actor.checkpoint)


def _selector_hash(folder: Path) -> str:
    from jenga_models.checkpoint import load

    return load(folder).require("selection").hash


def _trunk(select: Path | None, careful: bool, config: ExtractionConfig, seed: int, number: int) -> Trunk:
    stage = None if select is None else selected_stage(select, config, seed, number)
    return Trunk(config, seed, number, stage, careful)


def cost_line(found: Mapping[str, Way], body: str, workers: int, missing: Missing) -> str:
    """What an evaluation will take, from costs measured on an idle core; `missing` is what is not logged yet."""
    each = {name: PULL_SECONDS[_kind(way)] for name, way in found.items()}
    rollouts = [name for names in missing.values() for name in names]
    seconds = len(missing) * APPROACH_SECONDS[body] + sum(each[name] for name in rollouts)
    parts = ", ".join(f"{name} {each[name]:.0f} s" for name in found)
    return (
        f"{len(missing)} towers, {len(rollouts)} rollouts to do: about {seconds / 60 / workers:.0f} min on {workers} "
        f"idle cores (a tower up to the grasp {APPROACH_SECONDS[body]:.0f} s; then {parts})"
    )


def _kind(way: Way) -> str:
    if isinstance(way, Hindsight):
        return "hindsight"
    return "simulator" if way.model_name == "simulator" else way.controller


def _ended(path: Path) -> Ended:
    header, result = read_header(path)
    assert result is not None  # a rollout gets its name when it has ended
    return Ended(path, header, result)


def _report(
    found: Mapping[str, Way], ended: Mapping[str, list[Ended]], switches: Switches, out: Path
) -> dict[str, Any]:
    reports = {
        name: {"way": name}
        | describe(way)
        | scores(ended[name])
        | {"switches": switches.as_dict(), "logs": str(out / name)}
        for name, way in found.items()
    }
    for name, way in found.items():
        if isinstance(way, ClosedLoop) and way.controller != "straight":
            reports[name]["control_hz"] = decision_rate(way, ended[name])
    first, *others = found
    report = reports[first]
    for other in others:
        reports[other]["paired"] = paired(ended[first], ended[other])
    report["baselines"] = {name: reports[name] for name in others}
    return report


def describe(way: Way) -> dict[str, Any]:
    """What was asked of what."""
    if isinstance(way, Hindsight):
        said = {"objective": f"hindsight, best of {len(way.pulls)} pulls", "dynamics": "none", "search": None}
        return said | {"control_hz": None, "model": ""}
    straight = way.controller == "straight"
    return {
        "objective": f"straight pull, {way.speed} m/s" if straight else way.cost.objective,
        "dynamics": way.model_name,
        "search": None if straight else asdict(way.search),
        "control_hz": None,
        "model": way.actor.checkpoint,
    }


def decision_rate(loop: ClosedLoop, ended: Sequence[Ended]) -> float | None:
    """Decisions a second in this process, on the towers of a log, after one to warm up.

    None with the simulator as the model, which needs a running world: `jenga bench control` times it.
    """
    if loop.model_name == "simulator":
        return None
    episode = read_episode(next((run.path for run in ended if run.result.verdict.clear_frame >= 0), ended[0].path))
    policy = loop.policy(np.random.default_rng(0))
    frames = episode.action_frame if len(episode.action_frame) else np.zeros(1, np.int64)
    policy.act(episode.tower_state(int(frames[0])), episode.header.target)
    began = perf_counter()
    for i in range(TIMED_DECISIONS):
        policy.act(episode.tower_state(int(frames[i % len(frames)])), episode.header.target)
    return TIMED_DECISIONS / (perf_counter() - began)
