"""Work for several processes: everything is done once, a death is heard of, and nothing is left behind."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest

from jenga_data.errors import JengaError
from jenga_data.pool import Lost, run_all


def process_of(item: int) -> tuple[int, int]:
    return item**2, os.getpid()


def process_that_dies_at_three(item: int) -> int:
    if item == 3:
        os._exit(9)
    return os.getpid()


def dies_once(marker: Path) -> str:
    """The file says that this was tried before."""
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def hangs_until_tried_again(marker: Path) -> str:
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGSTOP)  # hears nothing but SIGKILL, and no thread of it runs
    return "done"


def hangs(item: int) -> int:
    time.sleep(60.0)
    return item


def refuses_three(item: int) -> int:
    if item == 3:
        raise JengaError("three is refused")
    return item


def lingers(item: int) -> int:
    time.sleep(60.0 if item else 0.0)
    return item


def kills_itself(item: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return item


def blocked_signals(_: int) -> list[int]:
    return sorted(signal.pthread_sigmask(signal.SIG_BLOCK, []))


def counted(items: int, drawn: list[int]) -> Iterator[int]:
    for item in range(items):
        drawn.append(item)
        yield item


def nothing_is_left() -> bool:
    """Whether every worker is gone; who was the last to see one die may still be writing that down."""
    end = time.monotonic() + 10.0
    while multiprocessing.active_children() and time.monotonic() < end:
        time.sleep(0.01)
    return not multiprocessing.active_children()


@pytest.mark.parametrize("workers", [1, 2])
def test_every_item_comes_once_with_what_was_made_of_it(workers: int):
    found = list(run_all(process_of, range(7), workers))
    assert sorted(item for item, _ in found) == list(range(7))
    made = {item: made for item, made in found if not isinstance(made, Lost)}
    assert {item: square for item, (square, _) in made.items()} == {item: item**2 for item in range(7)}
    assert (os.getpid() in {pid for _, pid in made.values()}) == (workers == 1)


@pytest.mark.parametrize("workers", [1, 2])
def test_nothing_to_do_is_done_at_once(workers: int):
    assert list(run_all(process_of, [], workers)) == []


def test_one_worker_works_only_when_it_is_asked():
    drawn: list[int] = []
    working = run_all(process_of, counted(100, drawn), 1)
    next(working)
    assert drawn == [0]


def test_two_workers_have_one_item_each():
    """So that nobody waits behind one that hangs."""
    drawn: list[int] = []
    working = run_all(process_of, counted(100, drawn), 2)
    assert isinstance(working, Generator)
    next(working)
    assert len(drawn) == 2
    working.close()


def test_a_worker_that_dies_costs_only_what_it_was_at():
    found = dict(run_all(process_that_dies_at_three, range(20), 2))
    assert sorted(found) == list(range(20))
    lost = found.pop(3)
    assert isinstance(lost, Lost)
    assert [failure.reason for failure in lost.tries] == ["its worker process died (exit code 9)"] * 2
    # Two to begin with, one for the first of them that died; the second death is the end.
    assert len(set(found.values())) == 3
    assert nothing_is_left()


def test_a_death_that_does_not_come_again_costs_nothing(tmp_path: Path):
    markers = [tmp_path / str(i) for i in range(3)]
    assert sorted(run_all(dies_once, markers, 2)) == [(marker, "done") for marker in markers]


def test_a_death_by_a_signal_is_told_with_its_name(tmp_path: Path):
    ((_, lost),) = run_all(kills_itself, [0], 2)
    assert isinstance(lost, Lost)
    assert {f.reason for f in lost.tries} == {"its worker process died (SIGKILL: out of memory, or killed)"}


def test_a_worker_that_hangs_is_ended_and_replaced(tmp_path: Path):
    """A worker has to start within the timeout, also on a machine that does much else."""
    markers = [tmp_path / str(i) for i in range(2)]
    assert sorted(run_all(hangs_until_tried_again, markers, 2, timeout=15.0)) == [(m, "done") for m in markers]
    assert nothing_is_left()


def test_what_hangs_twice_is_given_up():
    ((_, lost),) = run_all(hangs, [1], 2, timeout=0.5)
    assert isinstance(lost, Lost)
    assert [failure.reason for failure in lost.tries] == ["no end after 0.5 s"] * 2
    assert all(failure.seconds >= 0.5 for failure in lost.tries)
    assert nothing_is_left()


@pytest.mark.parametrize("workers", [1, 2])
def test_what_a_worker_raises_comes_here(workers: int):
    with pytest.raises(JengaError, match="three is refused"):
        list(run_all(refuses_three, range(20), workers))
    assert nothing_is_left()


def test_who_stops_early_does_not_wait_for_work_that_goes_on():
    working = run_all(lingers, range(4), 2)
    assert isinstance(working, Generator)
    assert next(working) == (0, 0)
    began = time.monotonic()
    working.close()
    assert time.monotonic() - began < 20.0
    assert nothing_is_left()


def test_workers_are_deaf_to_ctrl_c_and_the_parent_is_not():
    ((_, blocked),) = run_all(blocked_signals, [0], 2)
    assert isinstance(blocked, list)
    assert signal.SIGINT in blocked
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def announces_itself(folder: str) -> None:
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(60.0)


PARENT = """
import sys
from test_pool import announces_itself
from jenga_data.pool import run_all

if __name__ == "__main__":
    list(run_all(announces_itself, [sys.argv[1]] * 2, 2))
"""


def is_alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_workers_end_with_their_parent_however_it_ends(tmp_path: Path, how: signal.Signals):
    """An orphan would write the same episode as the run that takes over."""
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    folder = tmp_path / "workers"
    folder.mkdir()
    paths = {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    with subprocess.Popen([sys.executable, str(script), str(folder)], env=os.environ | paths) as parent:
        end = time.monotonic() + 60.0
        while len(list(folder.iterdir())) < 2 and time.monotonic() < end:
            time.sleep(0.05)
        workers = [int(path.name) for path in folder.iterdir()]
        assert len(workers) == 2
        if sys.platform == "linux":  # where the system itself ends a worker that can do nothing
            os.kill(workers[0], signal.SIGSTOP)
        parent.send_signal(how)
        parent.wait(10.0)
        while any(map(is_alive, workers)) and time.monotonic() < end:
            time.sleep(0.05)
    assert not any(map(is_alive, workers))
