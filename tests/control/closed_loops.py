"""Closed loops that cost little: cheap physics, an untrained model, or no simulator at all."""

import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from made_up_dataset import BLOCKS, dynamics_dataset, nominal_pose, untrained

from jenga_control.extraction.evaluate import evaluate_extraction
from jenga_data.blocks import sample_blocks
from jenga_data.collect.branches import Branch, Tape, Trunk
from jenga_data.collect.config import NOBODY, ExtractionConfig, SpawnConfig
from jenga_data.collect.rollout import header_of
from jenga_data.collect.stage import Stage
from jenga_data.episode import CONTROL_STEP_NS, Action, Contacts, Frame, Result
from jenga_data.outcome import Outcome, Verdict
from jenga_data.sim.physics import PhysicsConfig
from jenga_data.tower import Layout, TowerState
from jenga_models.config import DynamicsTraining

CHEAP = ExtractionConfig(
    body="gripper",
    spawn=SpawnConfig(last_round=1, settle=0.064),
    physics=PhysicsConfig(timestep_ns=4_000_000, sleep_tolerance=0.1, impratio=1.0),
)
MODEL = DynamicsTraining(width=16, hidden_layers=1, edge_memory=False)
TARGET = 1


@cache
def evaluated(base: Path) -> tuple[Path, dict[str, Any]]:
    """One real tower pulled in all three ways with an untrained model: the folder and the report."""
    folder = base / "closed-loops"
    folder.mkdir()
    model = untrained(folder / "model", MODEL, dynamics_dataset())
    return folder, evaluate_extraction(model, folder / "logs", towers=1, workers=1, config=CHEAP)


class MadeUpPulls:
    """In place of `Trunk`: a tower of three levels a number, grasped at once, and the given results."""

    def __init__(self, results: dict[str, list[Result]]) -> None:
        """`results` by the controller's name; a rollout's number chooses among them."""
        self.results, self.ran = results, []

    def __call__(self, config, seed, number, stage=None, careful=False) -> "MadeUpTrunk":
        return MadeUpTrunk(self, config, seed, number)


class MadeUpTrunk(Trunk):
    """A tower of three levels at the grasp; what a branch comes to is decided when it is logged, by who acts."""

    def __init__(self, pulls: MadeUpPulls, config, seed, number) -> None:
        self.pulls, self.config, self.seed, self.number = pulls, config, seed, number
        self.stage = Stage(tower(number), TARGET, 0, 0, 1)

    @property
    def grasped(self) -> bool:
        return True

    def branch(self, policy, all_actions=False) -> Branch:
        state, tape = self.stage.state, Tape()
        nothing = Contacts(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)))
        for i in range(4):
            tape.frame(Frame(i, i * CONTROL_STEP_NS, state.pose, state.twist, nothing, np.zeros(0)))
            if i < 3:
                action = policy.act(state, TARGET)
                tape.action(Action(i, i * CONTROL_STEP_NS, action, action))
        return Branch(tape, result(Outcome.STUCK))

    def log(self, branch, open_log, actor=NOBODY) -> Result:
        name = actor.controller["name"]
        self.pulls.ran.append((name, self.number))
        at_speed = f"{name}-{actor.controller.get('speed')}"
        ended = self.pulls.results.get(at_speed, self.pulls.results.get(name, []))[self.number]
        with open_log(header_of(self.config, self.seed, self.number, self.stage, actor), "<mujoco/>") as log:
            branch.tape.play(log)
            log.finish(ended)
        return ended


def tower(number: int = 0) -> TowerState:
    blocks = sample_blocks("nominal", np.random.default_rng(number), BLOCKS)
    return TowerState(blocks, Layout.fresh(np.arange(BLOCKS)), nominal_pose(), np.zeros((BLOCKS, 6)))


def result(outcome: Outcome, cause: str = "", moved: float = 0.001, dragged: bool = False) -> Result:
    return Result(Verdict(outcome, dragged, float("nan") if outcome is Outcome.INVALID else moved, -1), cause)


def copied(logs: Path, to: Path) -> Path:
    return Path(shutil.copytree(logs, to))
