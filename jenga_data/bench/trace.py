"""One selection episode, watched: what each physics step, the log and the rest of it cost in CPU time."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import thread_time_ns
from types import TracebackType
from typing import Any, TypeVar

from jenga_data.collect.config import SelectionConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.rollout import header_of
from jenga_data.collect.selection import pull
from jenga_data.collect.stage import Stage, set_stage
from jenga_data.episode import Action, EpisodeHeader, Frame, GripperSample, Phase, Result
from jenga_data.log.writer import EpisodeWriter
from jenga_data.sim.scene import add_tower, base_spec
from jenga_data.sim.traced import Steps, TracedWorld
from jenga_data.sim.world import World

T = TypeVar("T")

_WARM_UP_STEPS = 16
"""Steps after which a tower that was put down has found its contacts..."""
_REST_STEPS = 64
"""...and steps that are then timed."""


@dataclass(frozen=True, eq=False)
class EpisodeTrace:
    """CPU times of one episode [s]; `steps` are those of the pull and of what follows, `rest` those of the tower while
    nothing is done to it and it may not sleep."""

    stage: Stage
    steps: Steps
    rest: Steps
    phase: dict[str, int]
    """Step at which each phase begins."""
    spawn: float
    logging: float
    whole: float

    def steps_of(self, phase: str) -> slice:
        """Steps between the beginning of a phase and that of the next."""
        later = [step for step in self.phase.values() if step > self.phase[phase]]
        return slice(self.phase[phase], min(later, default=len(self.steps.seconds)))


class TimedLog:
    """Hands everything on to the log of an episode, and adds up the CPU time that this takes."""

    def __init__(self, world: TracedWorld, path: Path, header: EpisodeHeader, scene_xml: str) -> None:
        self.seconds = 0.0
        self.phases: dict[str, int] = {}
        self._world = world
        self._log = self._timed(EpisodeWriter, path, header, scene_xml)

    def __enter__(self) -> "TimedLog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._log.__exit__(kind, error, trace)

    def _timed(self, call: Callable[..., T], *args: object) -> T:
        began = thread_time_ns()
        done = call(*args)
        self.seconds += (thread_time_ns() - began) * 1e-9
        return done

    def frame(self, frame: Frame) -> None:
        self._timed(self._log.frame, frame)

    def action(self, action: Action) -> None:
        self._timed(self._log.action, action)

    def gripper(self, sample: GripperSample) -> None:
        self._timed(self._log.gripper, sample)

    def phase(self, phase: Phase) -> None:
        self.phases[phase.name] = len(self._world)
        self._timed(self._log.phase, phase)

    def finish(self, result: Result) -> None:
        self._timed(self._log.finish, result)


def trace_episode(config: SelectionConfig, seed: int, number: int, folder: Path) -> EpisodeTrace:
    """Run an episode as `collect` does, and log it into `folder`.

    Raises:
        JengaError: as `run_selection`.
    """
    began = thread_time_ns()
    stage = set_stage(config, seed, number)
    spawned = thread_time_ns()
    header = header_of(config, seed, number, stage)
    worlds: list[TracedWorld] = []
    logs: list[TimedLog] = []

    def make_world(*scene: Any) -> World:
        worlds.append(TracedWorld(*scene))
        return worlds[-1]

    def open_log(scene_xml: str) -> TimedLog:
        logs.append(TimedLog(worlds[-1], folder / f"{header.key}.mcap", header, scene_xml))
        return logs[-1]

    pull(config, stage, episode_rng(seed, number, "noise"), open_log, make_world=make_world)
    whole = thread_time_ns() - began
    return EpisodeTrace(
        stage=stage,
        steps=worlds[-1].steps(),
        rest=rest_steps(stage, config),
        phase=logs[-1].phases,
        spawn=(spawned - began) * 1e-9,
        logging=logs[-1].seconds,
        whole=whole * 1e-9,
    )


def rest_steps(stage: Stage, config: SelectionConfig) -> Steps:
    """Steps of a tower to which nothing is done, awake."""
    spec = base_spec(config.physics)
    add_tower(spec, stage.blocks, stage.state.pose, stage.target, config.physics)
    world = TracedWorld(spec, stage.blocks, stage.layout)
    World.step(world, _WARM_UP_STEPS)
    world.step(_REST_STEPS)
    return world.steps()
