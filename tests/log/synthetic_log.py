"""A synthetic episode, by default of two levels, without a simulator, and writing it."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import three_link_robot

from jenga_data.blocks import Blocks, sample_blocks
from jenga_data.episode import (
    LEFT_FINGER,
    TABLE,
    Action,
    Contacts,
    EpisodeHeader,
    Frame,
    GripperSample,
    Phase,
    Result,
)
from jenga_data.log.writer import EpisodeWriter
from jenga_data.outcome import Outcome, Verdict
from jenga_data.tower import Layout

STEP_NS = 32_000_000
SCENE = "<mujoco model='jenga'/>"


@dataclass(frozen=True)
class Script:
    """All that is written of one made-up episode."""

    header: EpisodeHeader
    frames: list[Frame]
    actions: list[Action]
    gripper: list[GripperSample]
    phases: list[Phase]
    result: Result


def stacked_pose(blocks: Blocks, layout: Layout) -> np.ndarray:
    """Blocks at their places in the tower, at rest."""
    _, width, height = 0.075, 0.025, 0.015
    pose = np.zeros((len(blocks), 7))
    pose[:, 2] = (layout.level + 0.5) * height
    even = layout.level % 2 == 0
    across = (layout.slot - 1) * width
    pose[even, 1] = across[even]
    pose[~even, 0] = -across[~even]
    pose[even, 3] = 1.0
    pose[~even, 3] = pose[~even, 6] = np.sqrt(0.5)
    return pose


def make_script(frames: int = 12, blocks: int = 6, state: int = 20, seed: int = 0, gripper: bool = True) -> Script:
    """`frames` control steps in which the target slides out along -x by 5 mm a step."""
    rng = np.random.default_rng(seed)
    own = sample_blocks("measured", rng, blocks)
    layout = Layout.fresh(np.arange(blocks))
    header = EpisodeHeader(
        key="0123456789abcdef",
        kind="extraction",
        seed=7,
        number=3,
        blocks=own,
        layout=layout,
        target=1,
        turn=2,
        face=1,
        config={"rounds": [1, 15], "physics": {"friction": 0.35}, "name": "Übung"},
        provenance={"version": "0.1.0", "machine": "x86_64"},
    )
    start = stacked_pose(own, layout)
    steps = []
    for i in range(frames):
        pose = start.copy()
        pose[1, 0] -= 0.005 * i
        contacts = Contacts(
            np.array([0, 3, 1]), np.array([TABLE, 0, LEFT_FINGER]), rng.normal(size=(3, 3)) if i else np.zeros((3, 3))
        )
        steps.append(Frame(i, i * STEP_NS, pose, rng.normal(size=(blocks, 6)), contacts, rng.normal(size=state)))
    samples = [
        GripperSample(
            t * STEP_NS // 4, np.array([-0.1, 0, 0.02, 1, 0, 0, 0]), 0.025, rng.normal(size=3), rng.normal(size=3)
        )
        for t in range(4 * frames if gripper else 0)
    ]
    return Script(
        header=header,
        frames=steps,
        actions=[Action(i, i * STEP_NS, np.array([-0.005, 0, 0]), rng.normal(size=3)) for i in range(frames - 1)],
        gripper=samples,
        phases=[Phase(0, 0, "grasp"), Phase(2, 2 * STEP_NS, "pull")],
        result=Result(Verdict(Outcome.STUCK, dragged=True, moved=0.0163, clear_frame=-1), "slipped"),
    )


def with_robot(script: Script) -> Script:
    """The same with a robot, on a turntable that turns by 0.01 rad a frame."""
    frames = [
        replace(frame, turntable=0.01 * frame.index, robot=three_link_robot.state(0.05 * frame.index, speed=1.5))
        for frame in script.frames
    ]
    return replace(script, header=replace(script.header, robot=three_link_robot.MODEL), frames=frames)


def write(path: Path, script: Script) -> Path:
    """Write a script to its end, each record at its time."""
    with EpisodeWriter(path, script.header, SCENE) as writer:
        play(writer, script)
        writer.finish(script.result)
    return path


def play(writer: EpisodeWriter, script: Script) -> None:
    """Write all but the end of a script."""
    samples = iter(script.gripper)
    for frame in script.frames:
        writer.frame(frame)
        for phase in (p for p in script.phases if p.frame == frame.index):
            writer.phase(phase)
        for action in (a for a in script.actions if a.frame == frame.index):
            writer.action(action)
        for _, sample in zip(range(4), samples, strict=False):
            writer.gripper(sample)
