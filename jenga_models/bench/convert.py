"""`jenga bench convert`: how fast logs become a dataset, beside reading the same logs message by message.

Ours is `jenga convert` in one process, whole: every byte hashed and compared with its checksums, splits, statistics,
Parquet files and manifest written. Theirs reads every message of every log through `mcap`, decodes those of the
profile with protobuf and builds a `Data` object of torch_geometric for every row, with the same columns; it compares
no checksums and writes nothing.
"""

import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from google.protobuf.message import Message
from mcap.reader import make_reader

from jenga_data.bench.speed import Speed, speed_table
from jenga_data.dataset.convert import convert
from jenga_data.dataset.rows import edge_forces
from jenga_data.dataset.sources import find_logs
from jenga_data.errors import JengaError
from jenga_data.graph import support_edges
from jenga_data.log import codec, profile
from jenga_data.log.gather import MESSAGES
from jenga_data.statistics import ratio_bootstrap
from jenga_models.bench.pyg import Data

RATIO = 5.0
"""How much faster converting is at least."""


def bench_convert(logs: Sequence[Path], rounds: int = 5) -> dict[str, Any]:
    """Measure converting logs of one kind. Times are CPU times, of one process each.

    Raises:
        JengaError: the logs make no dataset, or `rounds` is below 1.
    """
    if rounds < 1:
        raise JengaError(f"rounds is {rounds}; allowed: 1 and more")
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    paths = find_logs(logs)
    size = sum(path.stat().st_size for path in paths)
    with TemporaryDirectory(prefix="jenga-bench-") as folder:

        def ours(number: int) -> int:
            return convert(logs, Path(folder) / str(number), "bench", "1.0.0").counts.rows

        def theirs(_: int) -> int:
            return sum(len(data_objects(path)) for path in paths)

        rows, objects = ours(-1), theirs(-1)  # what is loaded only once is loaded before
        times = np.array([(_timed(ours, k), _timed(theirs, k)) for k in range(rounds)])
    mean = times.mean(0)
    speed = Speed(
        "logs made into a dataset, beside reading them message by message into Data objects",
        value=len(paths) / float(mean[0]),
        unit="logs/s",
        reference=len(paths) / float(mean[1]),
        n=rounds,
        ratio_ci95=ratio_bootstrap(times[:, 1], times[:, 0], np.arange(rounds)),
        limit=RATIO,
        at_least=True,
        more={
            "logs": len(paths),
            "bytes": size,
            "rows": rows,
            "objects": objects,
            "megabytes_a_second": size / 1e6 / float(mean[0]),
        },
    )
    report = {"convert": speed.as_dict(), "rounds": rounds, "cores": os.cpu_count(), "load_before": load}
    head = f"CPU time of one process, {rounds} rounds, {len(paths)} logs of {size / 1e6:.0f} MB, {rows} rows.\n\n"
    return report | {"text": head + speed_table({"convert": speed})}


def data_objects(path: Path) -> list[Data]:
    """The rows of one log as objects, in the obvious way."""
    found: dict[str, list[Any]] = {topic: [] for topic in MESSAGES}
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            kind: type[Message] | None = MESSAGES.get(channel.topic)
            if kind is not None:
                found[channel.topic].append(kind.FromString(message.data))
    tower, outcome = found[profile.TOWER][0], found[profile.OUTCOME][0]
    states = {state.frame: state for state in found[profile.STATE]}
    contacts = {contact.frame: contact for contact in found[profile.CONTACTS]}
    selection = not found[profile.GRIPPER]
    frames = [0] if selection else [action.frame for action in found[profile.ACTION]]
    size, mass = np.array(tower.size).reshape(-1, 3), np.array(tower.mass)
    objects = []
    for i, frame in enumerate(frames):
        pose, twist = _arrays(states[frame])
        edges = support_edges(pose, size)
        _, contact = codec.read_contacts(contacts[frame].SerializeToString())
        more: dict[str, Any] = {"y": outcome.label, "moved": outcome.moved}
        if not selection:
            after, after_twist = _arrays(states[frame + 1])
            action = found[profile.ACTION][i]
            more = {
                "action": torch.tensor(list(action.displacement)),
                "reached": torch.tensor(list(action.reached)),
                "next_pose": torch.tensor(after, dtype=torch.float32),
                "next_twist": torch.tensor(after_twist, dtype=torch.float32),
            }
        objects.append(
            Data(
                x=torch.tensor(np.c_[size, mass, tower.level, tower.slot], dtype=torch.float32),
                pose=torch.tensor(pose, dtype=torch.float32),
                twist=torch.tensor(twist, dtype=torch.float32),
                edge_index=torch.tensor(edges),
                edge_attr=torch.tensor(edge_forces(contact, edges, len(mass)), dtype=torch.float32),
                target=tower.target,
                **more,
            )
        )
    return objects


def _arrays(state: Any) -> tuple[np.ndarray, np.ndarray]:
    return np.array(state.pose).reshape(-1, 7), np.array(state.twist).reshape(-1, 6)


def _timed(work: Callable[[int], int], number: int) -> float:
    start = time.process_time()
    work(number)
    return time.process_time() - start
