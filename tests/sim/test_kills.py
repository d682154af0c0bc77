"""SIGKILL at any moment, to a worker, several, the parent or all: the same command takes up where it was."""

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from collects_short_towers import EPISODES, run

from jenga_data.collect.workers import RECIPE
from jenga_data.dataset.convert import convert

VICTIMS = ("a worker", "several workers", "the parent", "everything")
KILLS = 20
"""As many of each victim; every other one at any time, its start-up included, the rest once a log has been begun."""
ANY_TIME, IN_A_LOG = 4.0, 0.5
"""Latest moment of each [s]."""


@pytest.fixture(scope="module", autouse=True)
def one_commit(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Logs name no commit: a checkout that changes while tests run must not make two episodes differ."""
    from jenga_data.collect.rollout import provenance

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GIT_DIR", str(tmp_path_factory.getbasetemp() / "no-repository"))
        provenance.cache_clear()
        yield
    provenance.cache_clear()


@contextmanager
def collecting(out: Path) -> Iterator[subprocess.Popen[bytes]]:
    program = Path(__file__).with_name("collects_short_towers.py")
    path = os.pathsep.join([str(program.parent), *sys.path])
    with subprocess.Popen(
        [sys.executable, str(program), str(out)], env=os.environ | {"PYTHONPATH": path}, start_new_session=True
    ) as parent:
        try:
            yield parent
        finally:
            if parent.poll() is None:
                os.killpg(parent.pid, signal.SIGKILL)


def workers_of(parent: int) -> list[int]:
    every = ["ps", "-ww", "-A", "-o", "pid=,ppid=,args="]  # -ww: $COLUMNS would cut the arguments off
    listed = subprocess.run(every, capture_output=True, text=True, check=True).stdout
    rows = [line.split(None, 2) for line in listed.splitlines()]
    return [int(pid) for pid, of, what in rows if int(of) == parent and "spawn_main" in what]


def kill(victim: str, parent: int, rng: random.Random) -> bool:
    """Whether there was somebody to kill."""
    if victim == "everything":
        os.killpg(parent, signal.SIGKILL)
    elif victim == "the parent":
        os.kill(parent, signal.SIGKILL)
    else:
        workers = workers_of(parent)
        for pid in rng.sample(workers, min(len(workers), 1 if victim == "a worker" else 2)):
            os.kill(pid, signal.SIGKILL)
        return bool(workers)
    return True


def finished(folder: Path) -> dict[str, tuple[int, int, int]]:
    """Which file lies under each name, and when and how long it was written."""
    found = {path.name: path.stat() for path in folder.glob("*.mcap")}
    return {name: (stat.st_ino, stat.st_mtime_ns, stat.st_size) for name, stat in found.items()}


def collect_under_fire(out: Path, rng: random.Random, victims: list[str], haste: int) -> int:
    """Give the same command until it is through, and kill `victims` one by one. How many meanwhile wrote a log.

    `haste` divides how long the killer waits at most: a fast machine is through before a slow killer comes."""
    in_a_log = 0
    for _ in range(200):
        with collecting(out) as parent:
            while victims and parent.poll() is None:
                if begun := not len(victims) % 2:
                    wait_while(lambda: parent.poll() is None and not unfinished(out), 60.0)
                wait_while(lambda: parent.poll() is None, rng.uniform(0.0, IN_A_LOG if begun else ANY_TIME) / haste)
                before = finished(out)
                if parent.poll() is None and kill(victims[-1], parent.pid, rng):
                    in_a_log += unfinished(out)
                    if victims.pop() in ("the parent", "everything"):
                        parent.wait()  # its workers are not waited for: the next command may meet them
                assert finished(out).items() >= before.items()
            parent.wait()
        if parent.returncode == 0:
            return in_a_log
        assert parent.returncode in (-signal.SIGKILL, 1), "a kill, or an episode that was set aside after two of them"
    raise AssertionError("never through")


def unfinished(out: Path) -> bool:
    return any(out.glob("*.mcap.partial"))


def wait_while(true: Callable[[], bool], seconds: float) -> None:
    end = time.monotonic() + seconds
    while true() and time.monotonic() < end:
        time.sleep(0.01)


@pytest.mark.skipif(sys.platform != "linux", reason="finds the workers with ps as Linux has it")
def test_twenty_kills_cost_no_finished_episode_and_leave_no_trace(tmp_path):
    undisturbed = tmp_path / "undisturbed"
    assert run(undisturbed, workers=1).episodes == EPISODES
    wanted = {path.name: path.read_bytes() for path in undisturbed.glob("*.mcap")}
    dataset = convert([undisturbed], tmp_path / "dataset", "pulls", "1.0.0").hash

    rng = random.Random(0)
    victims: list[str] = rng.sample([*VICTIMS] * (KILLS // len(VICTIMS)), KILLS)
    in_a_log, times, haste = 0, 0, 1
    while victims:
        out, left = tmp_path / f"out-{(times := times + 1)}", len(victims)
        in_a_log += collect_under_fire(out, rng, victims, haste)
        haste = 1 if len(victims) < left else 2 * haste
        assert haste < 2**10, "ten collections in a row went by without a kill"
        assert {path.name for path in out.iterdir()} - {".lock"} == wanted.keys() | {RECIPE}
        assert {path.name: path.read_bytes() for path in out.glob("*.mcap")} == wanted
        assert convert([out], tmp_path / f"dataset-{times}", "pulls", "1.0.0").hash == dataset
    assert in_a_log >= KILLS // 4
