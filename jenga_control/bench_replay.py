"""`jenga bench replay`: how long it takes to make a recording for rerun of a long episode, with and without a model."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Any

import numpy as np

from jenga_data.bench.speed import Speed, speed_table
from jenga_data.blocks import sample_blocks
from jenga_data.episode import (
    CONTROL_STEP_NS,
    TABLE,
    Action,
    Contacts,
    EpisodeHeader,
    Frame,
    GripperSample,
    Phase,
    Result,
)
from jenga_data.errors import JengaError
from jenga_data.graph import support_edges
from jenga_data.graph_spec import graph_spec
from jenga_data.log.reader import read_episode
from jenga_data.log.writer import EpisodeWriter
from jenga_data.outcome import Outcome, Verdict
from jenga_data.replay.rerun_adapter import write_shown
from jenga_data.replay.shown import Shown
from jenga_data.tower import Layout, nominal_poses
from jenga_models.checkpoint import Checkpoint, TrainedOn, load
from jenga_models.config import DYNAMICS_PRESETS
from jenga_models.features import Featurizer, attribute_width
from jenga_models.normalisation import Normalisation
from jenga_models.overlay import overlay, predict_one_step
from jenga_models.registry import build

PLAIN_SECONDS, MODEL_SECONDS = 2.0, 10.0
"""What a recording of a minute may take, without a model and with one."""
TARGET = 27
_SAMPLE_NS = 4_000_000


def bench_replay(seconds: float = 60.0, model: Path | None = None, repeats: int = 3) -> dict[str, Any]:
    """Time recordings of a made-up episode: a frame every control step, fingertips at 250 Hz, an action a frame.

    Times are CPU times of all threads of the process, the fastest of some tries: on idle cores nobody waits longer.

    Args:
        seconds: length of the episode [s].
        model: folder of a dynamics checkpoint; by default a network of the preset "best" with random weights, which
            takes as long as a trained one.

    Raises:
        JengaError: `seconds` or `repeats` is not positive, or the checkpoint cannot be read.
    """
    if not (0 < seconds <= 600 and repeats >= 1):
        raise JengaError(f"seconds is {seconds} and repeats {repeats}; allowed: 0 to 600, and 1 or more")
    checkpoint = untrained() if model is None else load(model).require("dynamics")
    with TemporaryDirectory(prefix="jenga-bench-") as folder:
        log, out = Path(folder) / "long.mcap", Path(folder) / "long.rrd"
        frames = write_episode(log, seconds)
        episode = read_episode(log)

        def recorded(shown: Shown) -> None:
            write_shown([shown], out)

        plain = _fastest(lambda: recorded(Shown(episode)), repeats)
        opened = _fastest(lambda: recorded(Shown(read_episode(log))), repeats)
        predicted = _fastest(lambda: recorded(Shown(episode, [predict_one_step(checkpoint, episode)])), repeats)
        overlay(checkpoint, log)  # leaves the sidecar
        again = _fastest(lambda: recorded(Shown(episode, [overlay(checkpoint, log)])), repeats)
        size = out.stat().st_size
    speeds = {
        "write": _speed("recording of the episode, without models", plain, PLAIN_SECONDS, 1.0),
        "read_and_write": _speed("the same with reading the log", opened, PLAIN_SECONDS, 1.0),
        "with_model": _speed("prediction of every step, and the recording with it", predicted, MODEL_SECONDS, 1.0),
        "with_sidecar": _speed("the same from the sidecar file, which keeps the prediction", again, predicted[0], None),
    }
    report: dict[str, Any] = {name: speed.as_dict() for name, speed in speeds.items()}
    report |= {"seconds": seconds, "frames": frames, "samples": len(episode.gripper.time_ns), "bytes": size}
    report["model"] = "untrained network of the preset best" if model is None else str(model)
    head = (
        f"A made-up episode of {seconds:g} s: {frames} frames of {len(episode.header.blocks)} blocks, "
        f"{report['samples']} fingertip samples at 250 Hz; model: {report['model']}. "
        f"CPU time of all threads, fastest of {repeats}.\n\n"
    )
    return report | {"text": head + speed_table(speeds)}


def write_episode(path: Path, seconds: float) -> int:
    """Log a tower that sways a little while its target is pulled; returns the number of frames."""
    rng = np.random.default_rng(0)
    layout, blocks = Layout.fresh(), sample_blocks("nominal", rng)
    start = nominal_poses(layout)
    upper, lower = support_edges(start, blocks.size)
    bottom = np.flatnonzero(layout.level == 0)
    first, second = np.r_[upper, bottom], np.r_[lower, np.full(len(bottom), TABLE)]
    count = max(2, round(seconds * 1e9 / CONTROL_STEP_NS))
    header = EpisodeHeader("bench-replay", "extraction", 0, 0, blocks, layout, TARGET, 0, 0, {})
    twist, nothing = np.zeros((len(blocks), 6)), np.zeros(0)
    way = np.array([-0.1 / count, 0.0, 0.0])
    with EpisodeWriter(path, header, "") as writer:
        for i in range(count):
            time_ns = i * CONTROL_STEP_NS
            pose = start.copy()
            pose[:, :3] += rng.normal(0, 1e-4, (len(blocks), 3))
            pose[TARGET, :3] = start[TARGET, :3] + i * way
            contacts = Contacts(first, second, rng.normal(0, 1, (len(first), 3)))
            if i == 0:
                writer.phase(Phase(0, 0, "pull"))
            writer.frame(Frame(i, time_ns, pose, twist, contacts, nothing))
            if i + 1 < count:
                writer.action(Action(i, time_ns, way, way))
            for sample in range(CONTROL_STEP_NS // _SAMPLE_NS):
                left, right = rng.normal(0, 1, (2, 3))
                writer.gripper(GripperSample(time_ns + sample * _SAMPLE_NS, pose[TARGET], 0.025, left, right))
        writer.finish(Result(Verdict(Outcome.STUCK, False, 0.001, -1)))
    return count


def untrained() -> Checkpoint:
    """A dynamics network of the preset "best" with random weights, nowhere on disk."""
    config = DYNAMICS_PRESETS["best"]
    spec = graph_spec(config.graph)
    edges = attribute_width(spec) if config.edge_attributes else 0
    featurizer = Featurizer(spec, config.flow, config.edge_attributes, Normalisation.none(spec.node_width, edges))
    network = build(config, spec, featurizer.edge_width).eval()
    return Checkpoint(
        "dynamics", config, featurizer, network, TrainedOn("none", "0.0.0", ""), {}, {}, Path("untrained"), "0" * 64
    )


def _fastest(call: Callable[[], object], repeats: int) -> tuple[float, float]:
    """CPU time and wall clock of the fastest try [s]."""
    times = []
    for _ in range(repeats):
        wall, cpu = perf_counter(), process_time()
        call()
        times.append((process_time() - cpu, perf_counter() - wall))
    return min(times)


def _speed(what: str, time: tuple[float, float], reference: float, limit: float | None) -> Speed:
    cpu, wall = time
    return Speed(what, value=cpu, unit="s", reference=reference, n=1, limit=limit, more={"wall_seconds": wall})
