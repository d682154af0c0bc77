"""`jenga bench convert`: how fast logs become a dataset, beside reading the same logs message by message.

Ours is `jenga convert`, whole: every byte hashed and compared with its checksums, splits, statistics,
Parquet files and manifest written. Theirs reads every message of every log through `mcap`, decodes those of the
profile with protobuf's generated classes (not slower than `mcap_protobuf.decoder`, which builds them for every file
anew) and builds a `Data` object of torch_geometric for every row, with every column that the row has in our dataset:
support edges by the same geometry, the force on each of them, labels, and the mean force on each fingertip. It
compares no checksums and writes nothing.
"""

import os
import secrets
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from google.protobuf.message import Message
from mcap.reader import make_reader

from jenga_data.bench.speed import Speed, speed_table
from jenga_data.clock import MOMENTS
from jenga_data.dataset.convert import check_workers, convert
from jenga_data.dataset.sources import find_logs
from jenga_data.errors import JengaError
from jenga_data.graph import support_edges
from jenga_data.log import profile
from jenga_data.log.gather import MESSAGES
from jenga_data.outcome import THRESHOLDS, Outcome, collapsed
from jenga_data.statistics import ratio_bootstrap
from jenga_models.bench.pyg import Data

RATIO = 5.0
"""How much faster converting is at least."""


def bench_convert(logs: Sequence[Path], rounds: int = 5, workers: int = 2) -> dict[str, Any]:
    """Measure converting logs of one kind: CPU time in one process, and what a user waits with `workers`.

    Raises:
        JengaError: the logs make no dataset, or `rounds` or `workers` is below 1.
    """
    if rounds < 1:
        raise JengaError(f"rounds is {rounds}; allowed: 1 and more")
    check_workers(workers)
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    paths = find_logs(logs)
    size = sum(path.stat().st_size for path in paths)
    with TemporaryDirectory(prefix="jenga-bench-") as folder:

        def ours(workers: int = 1) -> int:
            return convert(logs, Path(folder) / secrets.token_hex(8), "bench", "1.0.0", workers=workers).counts.rows

        def theirs() -> int:
            return sum(len(data_objects(path)) for path in paths)

        rows, objects = ours(), theirs()  # what is loaded only once is loaded before
        times = np.array([(*_timed(ours), *_timed(theirs), *_timed(partial(ours, workers))) for _ in range(rounds)])
    own, own_wall, plain, plain_wall, _, many_wall = times.T
    what = "logs made into a dataset, beside reading them message by message into Data objects"
    speeds = {
        "convert": _speed(f"{what}; CPU time", own, plain, len(paths)),
        "one_worker": _speed("the same by the clock", own_wall, plain_wall, len(paths)),
    }
    if workers > 1:
        speeds["workers"] = _speed(
            f"{workers} workers by the clock, beside one process", many_wall, plain_wall, len(paths)
        )
    report = {name: speed.as_dict() for name, speed in speeds.items()} | {
        "rounds": rounds,
        "worker_count": workers,
        "logs": len(paths),
        "bytes": size,
        "rows": rows,
        "objects": objects,
        "cores": os.cpu_count(),
        "load_before": load,
    }
    head = f"{rounds} rounds, {len(paths)} logs of {size / 1e6:.0f} MB, {rows} rows.\n\n"
    return report | {"text": head + speed_table(speeds)}


def _speed(what: str, ours: np.ndarray, theirs: np.ndarray, logs: int) -> Speed:
    """Logs a second of both, from the seconds of each round."""
    return Speed(
        what,
        value=logs / float(ours.mean()),
        unit="logs/s",
        reference=logs / float(theirs.mean()),
        n=len(ours),
        ratio_ci95=ratio_bootstrap(theirs, ours, np.arange(len(ours))),
        limit=RATIO,
        at_least=True,
    )


def data_objects(path: Path) -> list[Data]:
    """The rows of one log as objects, in the obvious way."""
    found: dict[str, list[Any]] = {topic: [] for topic in MESSAGES}
    times: dict[str, list[int]] = {topic: [] for topic in MESSAGES}
    metadata: dict[str, str] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream)
        for record in reader.iter_metadata():
            metadata |= record.metadata if record.name == profile.EPISODE_METADATA else {}
        for _, channel, message in reader.iter_messages():
            kind: type[Message] | None = MESSAGES.get(channel.topic)
            if kind is not None:
                found[channel.topic].append(kind.FromString(message.data))
                times[channel.topic].append(message.log_time)
    tower, outcome = found[profile.TOWER][0], found[profile.OUTCOME][0]
    states = {state.frame: state for state in found[profile.STATE]}
    time = {state.frame: at for state, at in zip(found[profile.STATE], times[profile.STATE], strict=True)}
    contacts = {contact.frame: contact for contact in found[profile.CONTACTS]}
    actions = found[profile.ACTION] if metadata["kind"] == "extraction" else []
    size, mass, count = np.array(tower.size).reshape(-1, 3), np.array(tower.mass), len(tower.mass)
    wedge = np.array(tower.wedge) if tower.wedge else np.zeros(count)
    first_pose, _ = _arrays(states[0])
    gripper = _forces(found[profile.GRIPPER], times[profile.GRIPPER])
    objects = []
    for action in actions or [None]:
        frame = action.frame if action else 0
        pose, twist = _arrays(states[frame])
        edges = support_edges(pose, size)
        if action:
            after, after_twist = _arrays(states[frame + 1])
            during = (gripper[0] > time[frame]) & (gripper[0] <= time[frame + 1])
            more: dict[str, Any] = {
                "action": torch.tensor(list(action.displacement)),
                "reached": torch.tensor(list(action.reached)),
                "next_pose": torch.tensor(after, dtype=torch.float32),
                "next_twist": torch.tensor(after_twist, dtype=torch.float32),
                "left_force": torch.tensor(gripper[1][during].sum(0) / max(during.sum(), 1)),
                "right_force": torch.tensor(gripper[2][during].sum(0) / max(during.sum(), 1)),
                "target_clear": 0 <= outcome.clear_frame <= frame,
                "collapsed": bool(collapsed(first_pose, after[None], tower.target, THRESHOLDS.drop)[0]),
            }
        else:
            failure = outcome.label != Outcome.EXTRACTED
            more = {
                "failure": failure,
                "strict_failure": failure or outcome.dragged,
                "dragged": outcome.dragged,
                "outcome": outcome.label,
                "moved": outcome.moved,
                "block_moved": torch.tensor(_moved(states), dtype=torch.float32),
            }
        objects.append(
            Data(
                x=torch.tensor(np.c_[size, mass, wedge, tower.level, tower.slot], dtype=torch.float32),
                pose=torch.tensor(pose, dtype=torch.float32),
                twist=torch.tensor(twist, dtype=torch.float32),
                edge_index=torch.tensor(edges),
                edge_attr=torch.tensor(_lift(contacts.get(frame), edges, count), dtype=torch.float32),
                episode=metadata["key"],
                tower=metadata["tower"],
                round=tower.moves + 1,
                frame=frame,
                target=tower.target,
                turn=tower.turn,
                face=tower.face,
                **more,
            )
        )
    return objects


def _moved(states: dict[int, Any]) -> np.ndarray:
    """How far each block had moved at each of the moments, or by the last frame."""
    start, _ = _arrays(states[0])
    return np.stack([_arrays(states[min(moment, max(states))])[0][:, :3] - start[:, :3] for moment in MOMENTS])


def _arrays(state: Any) -> tuple[np.ndarray, np.ndarray]:
    return np.array(state.pose).reshape(-1, 7), np.array(state.twist).reshape(-1, 6)


def _forces(samples: list[Any], times: list[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times of the gripper's samples, and the forces on its left and right fingertip."""
    left = np.array([list(sample.left_force) for sample in samples]).reshape(-1, 3)
    right = np.array([list(sample.right_force) for sample in samples]).reshape(-1, 3)
    return np.array(times, np.int64), left, right


def _lift(contact: Any, edges: np.ndarray, blocks: int) -> np.ndarray:
    """Upward force on the upper block of each edge by the lower one."""
    lift = np.zeros((blocks, blocks))  # [on, by]
    if contact is not None:
        first, second = np.array(contact.first, np.int64), np.array(contact.second, np.int64)
        up = np.array(contact.force).reshape(-1, 3)[:, 2]
        between = (first >= 0) & (second >= 0)
        np.add.at(lift, (first[between], second[between]), up[between])
        np.add.at(lift, (second[between], first[between]), -up[between])
    return lift[edges[0], edges[1]]


def _timed(work: Callable[[], int]) -> tuple[float, float]:
    """CPU and clock time [s]."""
    start = time.process_time(), time.perf_counter()
    work()
    return time.process_time() - start[0], time.perf_counter() - start[1]
