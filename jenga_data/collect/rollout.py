"""What every kind of rollout shares: how it opens its log and what its header says."""

import platform
import subprocess
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cache
from importlib import metadata
from pathlib import Path

from jenga_data.collect.config import NOBODY, Actor, CollectConfig, episode_key, recipe
from jenga_data.collect.recording import Recorder
from jenga_data.collect.stage import Stage
from jenga_data.episode import EpisodeHeader, RobotModel

OpenLog = Callable[[EpisodeHeader, str], AbstractContextManager[Recorder]]
"""Opens the log of one episode, given its header and the scene's MJCF."""


def header_of(
    config: CollectConfig, seed: int, number: int, stage: Stage, actor: Actor = NOBODY, robot: RobotModel | None = None
) -> EpisodeHeader:
    """The header of the episode that starts from `stage`."""
    return EpisodeHeader(
        key=episode_key(config, seed, number, actor),
        kind=config.kind,
        seed=seed,
        number=number,
        blocks=stage.blocks,
        layout=stage.layout,
        target=stage.target,
        turn=stage.turn,
        face=stage.face,
        config=recipe(config, actor),
        checkpoint=actor.checkpoint,
        provenance=provenance() | {"spawn_tries": str(stage.tries)},
        robot=robot,
    )


@cache
def provenance() -> dict[str, str]:
    """Versions of what made an episode, and the kind of machine."""
    names = ("jenga", "mujoco", "numpy", "scipy", "mcap")
    return {f"{name}_version": metadata.version(name) for name in names} | {
        "python_version": platform.python_version(),
        "machine": f"{platform.system()}-{platform.machine()}",
        "git_commit": _git_commit(),
    }


def _git_commit() -> str:
    """The commit of the checkout that this code runs from, "" where it was installed without one."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return ""
    try:
        done = subprocess.run(
            ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=40", "--match="],
            capture_output=True, text=True, timeout=10, check=True,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()
