"""What the simulator says from states of logged pulls on: restarted from what a model is told, and under other plans.

The first is the ceiling of a model that is told no more; the second is the truth by which plans are ranked. Each state
is a file of its own, so a run that was stopped goes on, and a model is scored without simulating anything again.
"""

import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from jenga_data.collect.draws import episode_rng
from jenga_data.collect.extraction import LIMITS, executable
from jenga_data.collect.resume import KNOWN, Resumed
from jenga_data.dataset.split import TEST_SHARE, position
from jenga_data.episode import Episode
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.log.reader import read_episode, read_header
from jenga_data.outcome import THRESHOLDS, collapsed
from jenga_data.pool import Lost, run_all
from jenga_data.progress import progress

STEPS = 5
"""How far restarts are followed: the controller's horizon."""
SIGMA = 1e-3
"""Spread of the plans of a decision, the controller's [m]."""


@dataclass(frozen=True, eq=False)
class Branches:
    """One state of a logged pull and what the simulator makes of it: one branch for each restart or plan.

    `lag` is how far the hand's set point is ahead of the hand [m], `pose` has the tower before the first step and after
    each, poses in the world [m].
    """

    tower: str
    target: int
    block_size: Float[np.ndarray, "block 3"]
    block_mass: Float[np.ndarray, " block"]
    level: Int[np.ndarray, " block"]
    slot: Int[np.ndarray, " block"]
    twist: Float[np.ndarray, "block 6"]
    lag: Float[np.ndarray, "3"]
    plan: Float[np.ndarray, "branch step 3"]
    pose: Float[np.ndarray, "branch moment block 7"]

    def write(self, path: Path) -> None:
        beside = path.with_name(path.name + ".partial")
        values: dict[str, Any] = {field.name: np.asarray(getattr(self, field.name)) for field in fields(self)}
        with beside.open("wb") as file:
            np.savez_compressed(file, **values)
        beside.replace(path)

    @classmethod
    def read(cls, path: Path) -> "Branches":
        """
        Raises:
            CheckFailed: the file is damaged.
        """
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as held:
                values: dict[str, Any] = {field.name: held[field.name] for field in fields(cls)}
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            raise CheckFailed(f"{path} is damaged: delete it and run the same command again") from None
        return cls(**values | {"tower": str(values["tower"]), "target": int(values["target"])})


@dataclass(frozen=True)
class States:
    """Which states of a log to branch from: numbers of its actions."""

    log: Path
    numbers: tuple[int, ...]


@dataclass(frozen=True)
class Restarts:
    """Restarts each state from what each of `KNOWN` is told, and makes the actions that the log has; its own way is the
    last branch."""

    out: Path

    def __call__(self, states: States) -> None:
        for resumed, number, path in _to_do(states, self.out, "restart-{}-{}.npz"):
            episode = resumed.episode
            actions = episode.action[number : number + STEPS]
            poses = []
            for known in KNOWN:
                resumed.restart(number, known)
                poses.append(resumed.play(actions))
            poses.append(episode.pose[episode.action_frame[number : number + STEPS] + 1])
            plan = np.broadcast_to(actions, (len(poses), *actions.shape))
            _branches(episode, number, plan, np.stack(poses)).write(path)


@dataclass(frozen=True)
class Candidates:
    """Makes many plans from each state as it was logged: as the controller draws around its last action."""

    out: Path
    count: int
    horizon: int

    def __call__(self, states: States) -> None:
        for resumed, number, path in _to_do(states, self.out, f"decision-{{}}-{{}}-{self.count}x{self.horizon}.npz"):
            plans = self.plans(resumed.episode, number)
            poses = []
            for plan in plans:
                resumed.restart(number)
                poses.append(resumed.play(plan))
            _branches(resumed.episode, number, plans, np.stack(poses)).write(path)

    def plans(self, episode: Episode, number: int) -> Float[np.ndarray, "plan step 3"]:
        """Plans around the last action's speed along x, within the arm's limits."""
        header = episode.header
        rng = episode_rng(header.seed, header.number, f"candidates {number}")
        before = episode.action[number - 1] if number else np.zeros(3)
        mean = np.array([min(before[0], -2 * SIGMA), 0.0, 0.0])
        wanted = mean + SIGMA * rng.normal(size=(self.count, self.horizon, 3))
        plans = np.empty_like(wanted)
        for plan, drawn in zip(plans, np.clip(wanted, -LIMITS, LIMITS), strict=True):
            last = before
            for step in range(self.horizon):
                last = plan[step] = executable(drawn[step], last)
        return plans


def _to_do(states: States, out: Path, name: str) -> Iterator[tuple[Resumed, int, Path]]:
    """The log taken up again, the number of each of its states that has no file yet, and that file.

    `name` has places for the episode's key and the number.
    """
    episode = read_episode(states.log)
    resumed = Resumed(episode)
    for number in states.numbers:
        path = out / name.format(episode.header.key, number)
        if not path.exists():
            yield resumed, number, path


def _branches(
    episode: Episode,
    number: int,
    plan: Float[np.ndarray, "branch step 3"],
    pose: Float[np.ndarray, "branch step block 7"],
) -> Branches:
    header, frame = episode.header, episode.action_frame[number]
    start = np.broadcast_to(episode.pose[frame], (len(pose), 1, *episode.pose[frame].shape))
    return Branches(
        tower=header.blocks.tower,
        target=header.target,
        block_size=header.blocks.size,
        block_mass=header.blocks.mass,
        level=header.layout.level,
        slot=header.layout.slot,
        twist=episode.twist[frame],
        lag=episode.lag[number],
        plan=plan,
        pose=np.concatenate([start, pose], axis=1),
    )


def eligible(episode: Episode) -> list[int]:
    """Actions with `STEPS` - 1 more behind them, the target in the tower before and the tower standing after them."""
    frames, clear = episode.action_frame, -1 if episode.result is None else episode.result.verdict.clear_frame
    numbers = []
    for number in range(len(frames) - STEPS + 1):
        after = frames[number + STEPS - 1] + 1
        fallen = collapsed(episode.pose[0], episode.pose[after], episode.header.target, THRESHOLDS.drop)
        if (clear < 0 or frames[number] < clear) and not fallen:
            numbers.append(number)
    return numbers


def choose(logs: Sequence[Path], count: int, seed: int, held_out: bool) -> list[States]:
    """So many states, drawn from all eligible ones of the logs' held-out towers, or of all towers.

    Raises:
        JengaError: there is none.
    """
    found: list[tuple[Path, int]] = []
    for log in logs:
        header, result = read_header(log)
        if result is None or (held_out and position(header.blocks.tower) >= TEST_SHARE):
            continue
        found += [(log, number) for number in eligible(read_episode(log))]
    if not found:
        which = "held-out towers" if held_out else "towers"
        raise JengaError(f"{len(logs)} logs hold no pull of {STEPS} actions in {which}; give more logs of extraction")
    drawn = np.random.default_rng(seed).permutation(len(found))[:count]
    numbers: dict[Path, list[int]] = {}
    for i in drawn.tolist():
        numbers.setdefault(found[i][0], []).append(found[i][1])
    return [States(log, tuple(sorted(some))) for log, some in sorted(numbers.items())]


def simulate(work: Restarts | Candidates, states: Sequence[States], workers: int, label: str) -> None:
    """Do the work for all states.

    Raises:
        CheckFailed: a worker died twice at the same states.
    """
    work.out.mkdir(parents=True, exist_ok=True)
    with progress(label, sum(len(some.numbers) for some in states)) as bar:
        for some, done in run_all(work, states, workers):
            if isinstance(done, Lost):
                raise CheckFailed(f"{some.log} could not be branched from: {done.tries[-1].reason}")
            bar.advance(len(some.numbers))


def stored(folder: Path, kind: str) -> Iterator[Branches]:
    """Branches of one kind in a folder, "restart" or "decision"."""
    for path in sorted(folder.glob(f"{kind}-*.npz")):
        yield Branches.read(path)
