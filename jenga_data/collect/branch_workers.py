"""Many towers, each simulated up to the grasp once and then pulled at by many: resumable tower by tower and pull by
pull, with worker processes that are replaced when they die."""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from jenga_data.collect.branches import Branch, Trunk
from jenga_data.collect.config import Actor, ExtractionConfig, episode_key
from jenga_data.collect.set_aside import Bug, Patience, SetAside, set_aside, take_back
from jenga_data.collect.workers import claimed
from jenga_data.errors import JengaError
from jenga_data.log.writer import EpisodeWriter
from jenga_data.pool import Lost, run_all
from jenga_data.progress import progress

Puller = Callable[[str], Branch]
"""What becomes of one tower under the pull of this name."""
MakePuller = Callable[[Trunk], Puller]
"""Made anew in a worker process for each tower, which its pulls share."""
MakeTrunk = Callable[[ExtractionConfig, int, int], Trunk]
"""Takes tower (seed, number) up to the grasp."""

Missing = Mapping[int, Sequence[str]]
"""Which ways have not pulled yet, by the number of the tower."""


def branch_path(out: Path, name: str, config: ExtractionConfig, seed: int, number: int, actor: Actor) -> Path:
    """Where the log of one pull at one tower lies."""
    return out / name / f"{episode_key(config, seed, number, actor)}.mcap"


def run_branches(
    make_puller: MakePuller,
    actors: Mapping[str, Actor],
    config: ExtractionConfig,
    seed: int,
    numbers: Sequence[int],
    workers: int,
    out: Path,
    make_trunk: MakeTrunk = Trunk,
    label: str = "",
    timeout: float = math.inf,
    tell: Callable[[Missing], None] = lambda missing: None,
) -> dict[str, list[SetAside]]:
    """Pull at each tower in every way whose log `out/NAME` does not hold yet; what had to be set aside, by name.

    Args:
        actors: who pulls, by name.
        make_trunk: how; by default as collection does.
        timeout: longest time for one tower [s], with more than one worker.
        tell: is told before it starts what there is to do, unless that is nothing.

    Raises:
        JengaError: as `collect`.
        CheckFailed: one tower after the other had to be set aside.
    """
    if len(numbers) < 1 or workers < 1:
        raise JengaError(f"towers is {len(numbers)} and workers is {workers}; both must be at least 1")
    path = partial(_path, out, config, seed, actors)
    given_up: dict[str, list[SetAside]] = {name: [] for name in actors}
    with ExitStack() as stack:
        for name, actor in actors.items():
            stack.enter_context(claimed(out / name, config, seed, actor))
        missing = {n: [name for name in actors if not path(name, n).exists()] for n in numbers}
        items = [(n, tuple(names)) for n, names in missing.items() if names]
        if items:
            tell(dict(items))
        bar = stack.enter_context(progress(label or "pulling", len(numbers) * len(actors)))
        bar.advance(sum(len(actors) - len(names) for names in missing.values()))
        patience = Patience(out)
        work = partial(_pull_all, make_puller, make_trunk, path, config, seed, actors)
        for (number, names), end in run_all(work, items, workers, timeout):
            for name in names:
                if path(name, number).exists():
                    take_back(path(name, number))
                    continue
                why = end if isinstance(end, Lost) else end[name]
                given_up[name].append(set_aside(path(name, number), seed, number, why))
            lost = [found for part in given_up.values() for found in part if found.number == number]
            patience.failed(lost) if lost else patience.succeeded()
            bar.advance(len(names))
    return given_up


def _path(out: Path, config: ExtractionConfig, seed: int, actors: Mapping[str, Actor], name: str, number: int) -> Path:
    return branch_path(out, name, config, seed, number, actors[name])


def _pull_all(
    make_puller: MakePuller,
    make_trunk: MakeTrunk,
    path: Callable[[str, int], Path],
    config: ExtractionConfig,
    seed: int,
    actors: Mapping[str, Actor],
    item: tuple[int, tuple[str, ...]],
) -> dict[str, Bug]:
    """What a worker does: one tower in all ways that are missing. Bugs by the name of the pull that had them."""
    number, names = item
    names = tuple(name for name in names if not path(name, number).exists())  # done before a worker died
    bugs: dict[str, Bug] = {}
    if not names:
        return bugs
    try:
        trunk = make_trunk(config, seed, number)
        puller = make_puller(trunk)
    except (JengaError, OSError):
        raise
    except Exception as error:  # a bug in one tower shall not cost the others; it is shown at the end
        return dict.fromkeys(names, Bug.of(error))
    for name in names:
        try:
            trunk.log(puller(name), partial(EpisodeWriter, path(name, number)), actors[name])
        except (JengaError, OSError):
            raise
        except Exception as error:
            bugs[name] = Bug.of(error)
    return bugs
