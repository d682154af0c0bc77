"""`jenga bench log`: how fast logs are written and read, and what part of an episode's time that takes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import thread_time_ns
from typing import Any, TypeVar

import numpy as np

from jenga_data.bench.figures import logging_share
from jenga_data.bench.naive_log import read_naively, write_naively
from jenga_data.bench.speed import Speed, speed_table
from jenga_data.bench.trace import EpisodeTrace, trace_episode
from jenga_data.collect.config import SelectionConfig, check_seed, recipe
from jenga_data.collect.rollout import provenance
from jenga_data.episode import Episode, Frame
from jenga_data.errors import JengaError
from jenga_data.log.reader import attachment, read_episode
from jenga_data.log.writer import EpisodeWriter
from jenga_data.progress import progress
from jenga_data.report import make_folder, write_report
from jenga_data.statistics import ratio_bootstrap

T = TypeVar("T")

REPEATS = 3
"""Of so many measurements the fastest counts: other work on the machine only ever makes one slower."""
_PER_FRAME = 4
"""Messages a frame that both writers write: state, contacts, simulation, transforms."""


@dataclass(frozen=True)
class Times:
    """CPU times [s] of one episode's log of `frames` frames, and of the way that it is compared with."""

    frames: int
    read_messages: int
    """Of the profile's own topics."""
    write: float
    naive_write: float
    read: float
    naive_read: float


def bench_log(config: SelectionConfig, towers: int, seed: int, out: Path) -> dict[str, Any]:
    """Collect selection episodes 0 to `towers` - 1, write and read each log again, and report on it.

    Returns:
        The report, and as `text` its table.

    Raises:
        JengaError: a count or seed that is not allowed, a folder that cannot be written.
    """
    if towers < 1:
        raise JengaError(f"towers is {towers}; allowed: 1 or more, such as 2")
    check_seed(seed)
    make_folder(out)
    traces, times = [], []
    with TemporaryDirectory() as name, progress("measuring logs", 2 * towers) as bar:
        for number in range(towers):
            folder = Path(name) / str(number)
            folder.mkdir()
            traces.append(trace_episode(config, seed, number, folder))
            bar.advance(1)
            (log,) = folder.glob("*.mcap")
            times.append(measure(log, folder))
            bar.advance(1)
    speeds = figures(traces, times)
    report = {name: speed.as_dict() for name, speed in speeds.items()} | {
        "towers": towers,
        "seed": seed,
        "config": recipe(config),
        "provenance": provenance(),
        "out": str(out),
    }
    text = (
        f"# jenga bench log\n\n{towers} selection episodes, seed {seed}; CPU time of one thread, best of {REPEATS}. "
        "The references build every message from new objects, and read message by message through mcap.\n\n"
        f"{speed_table(speeds)}"
    )
    write_report(out, "bench-log", report, text)
    return report | {"text": text}


def measure(log: Path, folder: Path) -> Times:
    """Write and read one log again, in both ways."""
    episode = read_episode(log)
    scene = attachment(log, "scene.xml").decode()
    frames = frames_of(episode)

    def write() -> None:
        with EpisodeWriter(folder / "own.again", episode.header, scene) as writer:
            for frame in frames:
                writer.frame(frame)
            assert episode.result is not None  # the log is one that was finished
            writer.finish(episode.result)

    write_time, _ = _fastest(write)
    naive_write, _ = _fastest(lambda: write_naively(folder / "naive.again", frames))
    read, _ = _fastest(lambda: read_episode(log))
    naive_read, (messages, _) = _fastest(lambda: read_naively(log))
    return Times(len(frames), messages, write_time, naive_write, read, naive_read)


def frames_of(episode: Episode) -> list[Frame]:
    """The frames of an episode without a robot, as they were given to its writer."""
    rows = zip(
        episode.time_ns.tolist(),
        episode.pose,
        episode.twist,
        episode.contacts,
        episode.sim_state,
        episode.turntable.tolist(),
        strict=True,
    )
    return [Frame(index, *row) for index, row in enumerate(rows)]


def figures(traces: Sequence[EpisodeTrace], times: Sequence[Times]) -> dict[str, Speed]:
    """Every figure of the report."""
    frames = np.array([t.frames for t in times], float)
    read = np.array([t.read_messages for t in times], float)
    write_times = np.array([(t.write, t.naive_write) for t in times])
    read_times = np.array([(t.read, t.naive_read) for t in times])
    return {
        "write_frames": _rate("frames written, beside messages built of new objects", "frames/s", frames, write_times),
        "write_messages": _rate("the same in messages", "messages/s", _PER_FRAME * frames, write_times),
        "read_frames": _rate("frames read, beside message by message through mcap", "frames/s", frames, read_times),
        "read_messages": _rate("the same in messages", "messages/s", read, read_times),
        "share": logging_share(traces),
    }


def _rate(what: str, unit: str, count: np.ndarray, seconds: np.ndarray) -> Speed:
    own, naive = seconds.T
    return Speed(
        what,
        value=float(count.sum() / own.sum()),
        unit=unit,
        reference=float(count.sum() / naive.sum()),
        n=len(count),
        ci95=ratio_bootstrap(count, own, np.arange(len(count))),
        ratio_ci95=ratio_bootstrap(naive, own, np.arange(len(count))),
    )


def _fastest(call: Callable[[], T]) -> tuple[float, T]:
    """CPU time of the fastest of some calls [s], and what the last one gave."""

    def timed() -> tuple[float, T]:
        began = thread_time_ns()
        out = call()
        return (thread_time_ns() - began) * 1e-9, out

    tries = [timed() for _ in range(REPEATS)]
    return min(seconds for seconds, _ in tries), tries[-1][1]
