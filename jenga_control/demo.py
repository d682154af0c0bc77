"""The whole loop once, small: simulate, log, convert, train, evaluate, control, replay. What `jenga demo` runs."""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any

from jenga_control.demo_page import DemoResults, write_demo_page
from jenga_control.extraction.evaluate import Switches, evaluate_extraction
from jenga_control.prediction.evaluate import evaluate_dynamics
from jenga_control.replay import shown_with
from jenga_control.selection.evaluate import evaluate_selection
from jenga_control.tables import dynamics_tables, extraction_tables, selection_tables
from jenga_data.agreement import edge_agreement
from jenga_data.collect.config import ExtractionConfig, SelectionConfig
from jenga_data.collect.set_aside import refuse_missing
from jenga_data.collect.workers import collect
from jenga_data.dataset.convert import convert
from jenga_data.dataset.read import open_dataset
from jenga_data.dataset.verify import verify
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.log.reader import read_episode
from jenga_data.replay import style
from jenga_data.replay.curves import episode_curves
from jenga_data.replay.rerun_adapter import write_rrd, write_shown
from jenga_data.replay.side_by_side import film_strip, tower_grid
from jenga_data.report import write_report
from jenga_models.config import DYNAMICS_PRESETS, SELECTION_PRESETS
from jenga_models.overlay import overlay
from jenga_models.pretrained import pretrained
from jenga_models.train import train_dynamics, train_selection


@dataclass(frozen=True)
class DemoSize:
    """How much the demo does: minutes on two cores, and far too little to learn much from."""

    selection_episodes: int = 12
    """Rollouts that pull with a servo, one a tower."""
    extraction_episodes: int = 6
    """Rollouts of a gripper without an arm, up to 51 transitions each."""
    robot_episodes: int = 1
    """Rollouts of the whole robot, which take three times as long."""
    towers: int = 2
    """Held-out towers on which each controller pulls."""
    epochs: int | None = None
    """Of both trainings; by default those of the preset "fast"."""

    def __post_init__(self) -> None:
        if min(self.selection_episodes, self.extraction_episodes) < 3:
            raise JengaError("a demo needs 3 episodes of each kind at least: to train, to validate and to test")
        if self.robot_episodes < 1:
            raise JengaError(f"robot-episodes is {self.robot_episodes}; allowed: 1 or more")
        if self.towers < 1 or (self.epochs is not None and self.epochs < 1):
            raise JengaError(f"towers is {self.towers} and epochs is {self.epochs}; both must be at least 1")


_GRIPPER = ExtractionConfig(body="gripper")
"""Every rollout of it has a pull: with the few of a demo there would else be too little to learn from."""


def free_folder(parent: Path = Path("runs")) -> Path:
    """The first of demo-1, demo-2, ... that does not exist: a demo never overwrites an older one."""
    number = 1
    while (parent / f"demo-{number}").exists():
        number += 1
    return parent / f"demo-{number}"


def run_demo(out: Path, workers: int, seed: int, size: DemoSize) -> dict[str, Any]:
    """Run the loop into the new folder `out`. Returns where everything is.

    Raises:
        JengaError: `out` exists, or a step failed.
    """
    if out.exists():
        raise JengaError(f"{out} exists; a demo needs a new folder: choose another --out")
    began = monotonic()
    logs, data, models, tables = out / "logs", out / "datasets", out / "checkpoints", out / "tables"

    _say(1, "simulate: towers of rounds 1 to 15, random blocks pulled, every rollout an MCAP log")
    collected = {
        "selection": collect(SelectionConfig(), seed, range(size.selection_episodes), workers, logs / "selection"),
        "extraction": collect(_GRIPPER, seed, range(size.extraction_episodes), workers, logs / "extraction"),
        "robot": collect(ExtractionConfig(), seed, range(size.robot_episodes), workers, logs / "robot"),
    }
    for summary in collected.values():
        refuse_missing(Path(summary.out), summary.set_aside)
    _say(2, "convert: logs to Parquet datasets, then check every byte")
    folders = {"selection": data / "demo-selection", "dynamics": data / "demo-dynamics"}
    convert([logs / "selection"], folders["selection"], "demo-selection", "0.1.0")
    convert([logs / "extraction"], folders["dynamics"], "demo-dynamics", "0.1.0")
    for folder in folders.values():
        if not (report := verify(folder)).ok:
            failed = [f"{name}: {check.detail}" for name, check in report.checks.items() if not check.ok]
            raise CheckFailed(f"{folder} does not verify: {'; '.join(failed)}")

    _say(3, "train: which block fails (graph network), how the tower moves (graph network simulator)")
    datasets = {kind: open_dataset(folder) for kind, folder in folders.items()}
    settings = {"epochs": size.epochs} if size.epochs is not None else {}
    selector = models / "selection"
    train_selection(datasets["selection"], _with(SELECTION_PRESETS["fast"], settings), selector)
    simulator = models / "dynamics"
    train_dynamics(datasets["dynamics"], _with(DYNAMICS_PRESETS["fast"], settings), simulator)

    _say(4, "evaluate on held-out towers, next to the trivial baselines")
    selection = evaluate_selection(selector, datasets["selection"], baselines="none")
    dynamics = evaluate_dynamics(simulator, datasets["dynamics"])
    write_report(tables, "selection", selection, selection_tables(selection))
    write_report(tables, "dynamics", dynamics, dynamics_tables(dynamics))

    _say(5, "control: MPPI with the learned model, MPPI without it, and a straight pull, on the same new towers")
    extraction = evaluate_extraction(
        simulator, logs / "closed-loop", towers=size.towers, workers=workers, config=_GRIPPER
    )
    write_report(tables, "extraction", extraction, extraction_tables([extraction, *extraction["baselines"].values()]))
    trained = (pretrained("selection"), pretrained("dynamics"))
    chosen = Switches(select=trained[0])
    evaluate_extraction(trained[1], logs / "trained", ("full",), towers=1, workers=1, switches=chosen)

    _say(6, "replay: the truth and the model's prediction together, and pictures")
    shown, robot = _pick(logs / "closed-loop" / "full"), _pick(logs / "trained" / "full")
    agreement = edge_agreement(read_episode(path) for path in sorted(logs.glob("*ion/*.mcap")))
    results = DemoResults(
        out=out,
        collected=collected,
        manifests={kind: dataset.manifest for kind, dataset in datasets.items()},
        selection=selection,
        dynamics=dynamics,
        extraction=extraction,
        agreement=agreement,
        episode=shown,
        replay=out / "replay.rrd",
        robot=robot,
        robot_replay=out / "robot.rrd",
        pictures=_pictures(out / "pictures", logs, shown, robot, simulator, out / "replay.rrd"),
        checkpoints=(selector, simulator),
        trained=trained,
        seconds=monotonic() - began,
    )
    write_shown([shown_with(robot, read_episode(robot), trained)], results.robot_replay)
    index = write_demo_page(results)
    return {
        "out": str(out),
        "index": str(index),
        "episode": str(shown),
        "robot": str(robot),
        "checkpoints": {"selection": str(selector), "dynamics": str(simulator)},
        "datasets": {kind: str(folder) for kind, folder in folders.items()},
        "tables": str(tables),
        "replay": str(results.replay),
        "edge_agreement": agreement.as_dict(),
        "seconds": round(monotonic() - began, 1),
    }


def closing_words(result: dict[str, Any]) -> str:
    """Where everything is, and what to try next."""
    model = shlex.quote(result["checkpoints"]["dynamics"])
    return "\n".join(
        [
            "",
            f"Everything is in {result['out']} ({result['seconds']:.0f} s). Open this first:",
            f"  {result['index']}",
            "",
            "Try next:",
            f"  jenga replay {shlex.quote(result['episode'])} --model {model}",
            "  jenga collect selection --episodes 200 --seed 1 --workers 2 --out runs/selection",
            f"  jenga train selection --dataset {shlex.quote(result['datasets']['selection'])} --preset paper "
            "--out runs/paper",
        ]
    )


def _say(step: int, what: str) -> None:
    sys.stderr.write(f"[{step}/6] {what}\n")
    sys.stderr.flush()


def _with(preset: Any, settings: dict[str, Any]) -> Any:
    from dataclasses import replace

    return replace(preset, **settings)


def _pick(folder: Path) -> Path:
    """The rollout with the most frames: the one with the most to see."""
    return max(sorted(folder.glob("*.mcap")), key=lambda path: len(read_episode(path).action_frame))


def _pictures(folder: Path, logs: Path, shown: Path, robot: Path, simulator: Path, replay: Path) -> dict[str, Path]:
    """Draw what needs neither OpenGL nor Vulkan, and write the recording for rerun."""
    folder.mkdir(parents=True)
    episode = read_episode(shown)
    prediction = overlay(simulator, shown)
    write_rrd(episode, [prediction], replay)
    pictures = {name: folder / f"{name}.png" for name in ("towers", "film", "curves", "selection", "robot")}

    pulls = sorted((read_episode(path) for path in (logs / "selection").glob("*.mcap")), key=lambda e: e.header.round)
    picked = pulls[:: max(1, len(pulls) // 5)][:5]
    towers = tower_grid(
        [e.tower_state(0) for e in picked],
        [f"round {e.header.round}" for e in picked],
        targets=[e.header.target for e in picked],
    )
    with style.applied():
        style.save(towers, pictures["towers"])
        style.save(film_strip(episode), pictures["film"])
        style.save(film_strip(pulls[-1]), pictures["selection"])
        style.save(film_strip(read_episode(robot)), pictures["robot"])
    episode_curves(episode, [prediction], pictures["curves"])
    return pictures
