"""`jenga bench robot`: what the robot's skills achieve and cost, over random legal targets of random rounds."""

import tempfile
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from jenga_data.bench.speed import Speed, speed_table
from jenga_data.calibrate.movable import MovableConfig, push_block
from jenga_data.calibrate.run import Run, quantiles
from jenga_data.collect.causes import CAUSES, Failure
from jenga_data.collect.config import ExtractionConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.extraction import Pull, RandomPull
from jenga_data.collect.recording import Recording
from jenga_data.collect.robot_extraction import run_with_robot
from jenga_data.collect.skills import Skills
from jenga_data.collect.stage import Stage, set_stage
from jenga_data.episode import EpisodeHeader
from jenga_data.log.writer import EpisodeWriter
from jenga_data.palette import BLUE, MUTED_INK, ORANGE
from jenga_data.report import markdown_table
from jenga_data.sim.robot import Robot
from jenga_data.statistics import Proportion, ratio_bootstrap

SECONDS = 20.0
"""What an episode may cost on one core [s]."""
TRANSITIONS, MINUTES = 12_000, 150.0
"""The paper's dynamics data, and what they may take [min]."""
ACROSS, ALONG = 0.5, 5.0
"""How straight the hand's way in the air has to be [mm]."""
_IN_THE_AIR = ("take_stick", "turn_back", "approach", "put_down")


def robot_case(config: ExtractionConfig, seed: int, number: int) -> dict[str, Any]:
    """One episode of the whole robot, and whether its target is loose by the test of `jenga calibrate movable`.

    Returns:
        `tower`, `round`, `level`, `slot`, `loose`, `outcome`, `cause`, `dragged`; `pushed_mm` and `others_mm`, how far
        the push moved the target and the most of any other block, None where it did not come to a push; `grasped`, what
        came of the grasp ("target", a cause, or None); `across_mm`, `along_mm`, the hand's largest distance from its
        set points in the air; `angle`, `speed`, `torque`, how near joints came to their limits; `simulated` and
        `cpu` seconds, spawning and logging included; `actions` in the tower.
    """
    began = process_time()
    stage = set_stage(config, seed, number)
    watched: list[_Watched] = []

    def make_skills(robot: Robot, recording: Recording, config: ExtractionConfig) -> Skills:
        watched.append(_Watched(robot, recording, config))
        return watched[0]

    pull = Pull(RandomPull(config, episode_rng(seed, number, "policy")), all_actions=True)
    with tempfile.TemporaryDirectory() as folder:

        def open_log(header: EpisodeHeader, scene: str) -> EpisodeWriter:
            return EpisodeWriter(Path(folder) / "episode.mcap", header, scene)

        result = run_with_robot(config, seed, number, stage, open_log, pull, make_skills=make_skills)
    cpu = process_time() - began
    place = stage.layout.place(stage.target)
    return {
        "tower": stage.blocks.tower,
        "round": stage.layout.round,
        "level": place.level,
        "slot": place.slot,
        "loose": is_loose(stage, config),
        "outcome": result.verdict.outcome.value,
        "cause": result.cause,
        "dragged": result.verdict.dragged,
        "cpu": cpu,
        **watched[0].found(),
    }


def is_loose(stage: Stage, config: ExtractionConfig) -> bool:
    """Whether the target slides out under a careful push towards the face that the robot pulls at."""
    movable = MovableConfig(spawn=config.spawn, physics=config.physics)
    return push_block(movable, stage.state, stage.target, 1.0 if stage.face else -1.0)["end"] == "movable"


class _Watched(Skills):
    """Skills that note how exactly they were carried out."""

    def __init__(self, robot: Robot, recording: Recording, config: ExtractionConfig) -> None:
        super().__init__(robot, recording, config)
        self._free = False
        self._steps = config.physics.steps_a_frame
        self._errors: list[tuple[float, float]] = []
        self._margins: list[tuple[float, float, float]] = []
        self._pushed: tuple[float, float] | None = None
        self._grasped: str | None = None
        self._actions = 0

    def substep(self, i: int, step: Callable[[], object] | None = None) -> None:
        super().substep(i, step)
        if i == 0:
            self._free = self._recording.phase_name in _IN_THE_AIR and not self._recording.has_collapsed()
        if self._free:
            self._errors.append(self._arm.error((i + 1) / self._steps))
        margins = self._robot.margins()
        self._margins.append((margins["angle"], margins["speed"], margins["torque"]))
        if i == 0 and self._recording.phase_name == "pull" and self._recording.clear_frame() < 0:
            self._actions += 1

    def push(self) -> None:
        before = self._recording.poses[-1]
        try:
            super().push()
        finally:
            way = self._recording.poses[-1][:, :3] - before[:, :3]
            others = np.delete(np.linalg.norm(way, axis=1), self._target)
            self._pushed = float(way[self._target, 0]) * 1e3, float(others.max()) * 1e3

    def grasp(self) -> None:
        try:
            super().grasp()
            self._grasped = "target"
        except Failure as failure:
            self._grasped = failure.cause
            raise

    def found(self) -> dict[str, Any]:
        across, along = np.max(self._errors, axis=0) * 1e3 if self._errors else (None, None)
        angle, speed, torque = np.array(self._margins).T
        pushed, others = self._pushed or (None, None)
        return {
            "pushed_mm": pushed,
            "others_mm": others,
            "grasped": self._grasped,
            "across_mm": across,
            "along_mm": along,
            "angle": angle.min(),
            "speed": speed.max(),
            "torque": torque.max(),
            "simulated": self._recording.time_ns() * 1e-9,
            "actions": self._actions,
        }


def bench_robot(run: Run, config: ExtractionConfig) -> dict[str, Any]:
    """Run `run.towers` episodes, each of a tower of its own, and report."""
    cases = [(robot_case, {"config": config, "seed": run.seed, "number": n}) for n in range(run.towers)]
    found = run.cases("robot", cases)
    loose = np.array([f["loose"] for f in found], bool)
    pushed = np.array([np.nan if f["pushed_mm"] is None else f["pushed_mm"] for f in found])
    wanted, tolerance = config.robot.push_distance * 1e3, config.robot.push_tolerance * 1e3
    tried = np.isfinite(pushed)
    exact = np.abs(pushed - wanted) <= tolerance
    grasped = np.array([f["grasped"] or "" for f in found])
    causes = np.array([f["cause"] for f in found])
    toppled = np.isin(causes, ["turn_toppled", "approach_toppled", "unsettled", "bumped"])
    cpu = np.array([f["cpu"] for f in found])
    speeds = {
        "episode": Speed(
            "CPU time of an episode, spawning and logging included", float(cpu.mean()), "s", SECONDS, len(found),
            ratio_ci95=ratio_bootstrap(cpu, np.full(len(cpu), SECONDS), np.arange(len(cpu))), limit=1.0,
            more={"largest": float(cpu.max())},
        ),
        "simulated": Speed(
            "simulated time of an episode, beside its CPU time", float(np.mean([f["simulated"] for f in found])), "s",
            float(cpu.mean()), len(found),
        ),
    }  # fmt: skip
    actions = np.array([f["actions"] for f in found])
    if actions.any():
        minutes = TRANSITIONS / actions.mean() * cpu.mean() / run.workers / 60
        speeds["dynamics_data"] = Speed(
            f"{TRANSITIONS:,} transitions with the target in the tower, by CPU time, on {run.workers} workers",
            float(minutes), "min", MINUTES, len(found), limit=1.0,
            more={"episodes": float(TRANSITIONS / actions.mean()), "actions_an_episode": float(actions.mean())},
        )  # fmt: skip
    got = grasped != ""
    report: dict[str, Any] = {
        **{name: speed.as_dict() for name, speed in speeds.items()},
        "episodes": len(found),
        "seed": run.seed,
        "outcomes": dict(sorted(Counter(f["outcome"] for f in found).items())),
        "causes": {"none": int((causes == "").sum())} | dict(sorted(Counter(c for c in causes.tolist() if c).items())),
        "loose": Proportion.of(loose).as_dict(),
        "push_of_loose": Proportion.of(exact[loose & tried]).as_dict(),
        "grasp_of_loose": Proportion.of(grasped[loose & got] == "target").as_dict(),
        "push_of_tight": Proportion.of(exact[~loose & tried]).as_dict(),
        "grasp_of_tight": Proportion.of(grasped[~loose & got] == "target").as_dict(),
        "extracted_of_loose": Proportion.of(np.array([f["outcome"] == "extracted" for f in found])[loose]).as_dict(),
        "toppled_by_turn_or_approach": Proportion.of(toppled).as_dict(),
        "self_collision": Proportion.of(causes == "self_collision").as_dict(),
        "joint_margin_deg": min(f["angle"] for f in found),
        "joint_speed_share": quantiles(np.array([f["speed"] for f in found])),
        "joint_torque_share": quantiles(np.array([f["torque"] for f in found])),
        "across_mm": quantiles(np.array([f["across_mm"] for f in found if f["across_mm"] is not None])),
        "actions_in_tower": float(actions.mean()),
        "along_mm": quantiles(np.array([f["along_mm"] for f in found if f["along_mm"] is not None])),
    }
    rows = [
        ("loose targets (`jenga calibrate movable`)", report["loose"], ""),
        (f"push of a loose target within {wanted:g} +- {tolerance:g} mm", report["push_of_loose"], "at least 0.95"),
        ("grasp of a loose target alone", report["grasp_of_loose"], "at least 0.98"),
        ("loose targets extracted", report["extracted_of_loose"], ""),
        ("push of a tight target as far", report["push_of_tight"], ""),
        ("grasp of a tight target alone", report["grasp_of_tight"], ""),
        ("tower toppled, unsettled or bumped by a turn or an approach", report["toppled_by_turn_or_approach"],
         "at most 0.01"),
        ("self-collisions", report["self_collision"], "0"),
        ("hand off its straight line in the air, largest [mm]", report["across_mm"]["largest"], f"at most {ACROSS}"),
        ("hand behind on it, largest [mm]", report["along_mm"]["largest"], f"at most {ALONG}"),
        ("joint nearest to the end of its range [degrees]", report["joint_margin_deg"], "more than 0"),
        ("share of a joint's speed limit, largest", report["joint_speed_share"]["largest"], "at most 1"),
    ]  # fmt: skip
    text = (
        f"{len(found)} episodes, random legal targets of rounds {config.spawn.first_round} to "
        f"{config.spawn.last_round}.\n\n"
        + markdown_table(("The robot", "Here", "Asked for"), rows)
        + "\n"
        + markdown_table(
            ("Cause", "Episodes", "Meaning"),
            [(name, n, CAUSES.get(name, "nothing went wrong")) for name, n in report["causes"].items()],
        )
        + "\n"
        + speed_table(speeds)
    )
    return run.write("bench-robot", report, text, partial(_figure, pushed, loose, causes, wanted, tolerance))


def _figure(pushed: np.ndarray, loose: np.ndarray, causes: np.ndarray, wanted: float, tolerance: float) -> Figure:
    """Left: how far targets were pushed, right: what went wrong."""
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    tried = np.isfinite(pushed)
    bins = np.linspace(-2, wanted + 6, 33)
    clipped = np.clip(pushed, bins[0], bins[-1])
    left.hist(
        [clipped[loose & tried], clipped[~loose & tried]], bins=list(bins), stacked=True, color=[BLUE, ORANGE],
        label=["loose", "tight"],
    )  # fmt: skip
    for edge in (wanted - tolerance, wanted + tolerance):
        left.axvline(edge, color=MUTED_INK, linestyle=":")
    left.set(xlabel="target pushed out by [mm]", ylabel="episodes", title="push; dotted: what is asked for")
    left.legend()
    names = sorted(set(causes.tolist()), key=lambda name: (name != "", (causes == name).sum()))
    counts = [[((causes == name) & which).sum() for name in names] for which in (loose, ~loose)]
    labels = [name or "nothing" for name in names]
    right.barh(labels, counts[0], color=BLUE)
    right.barh(labels, counts[1], left=counts[0], color=ORANGE)
    right.set(xlabel="episodes", title="what went wrong")
    return figure
