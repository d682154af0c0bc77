"""Running the program: in this process, where it imports torch once for all tests, or as one of its own."""

import io
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cli

PATIENCE = 240.0
"""Longest wait for a process on a machine that does much else [s]."""

CHEAP = ("--physics.timestep-ns", "4000000", "--physics.sleep-tolerance", "0.1", "--physics.impratio", "1")
CHEAP += ("--spawn.settle", "0.064", "--rounds", "1")
"""Physics that is good enough for the command line."""
COLLECT = {
    "selection": ("collect", "selection", *CHEAP, "--speed", "0.3", "--pull-seconds", "0.3"),
    "extraction": ("collect", "extraction", "--gripper", *CHEAP, "--slowest", "0.008"),
}
CHEAP_CLOSED_LOOP = """
import jenga_control.extraction.evaluate as module
from jenga_data.collect.config import ExtractionConfig, SpawnConfig
from jenga_data.sim.physics import PhysicsConfig

def cheap():
    physics = PhysicsConfig(timestep_ns=4_000_000, sleep_tolerance=0.1, impratio=1.0)
    spawn = SpawnConfig(last_round=1, settle=0.064)
    return ExtractionConfig(body="gripper", spawn=spawn, physics=physics)

module.ExtractionConfig = cheap
"""
"""Code that gives `jenga eval extraction` the same physics; it has no options for them."""


@contextmanager
def cheap_closed_loop() -> Iterator[None]:
    """The same in this process."""
    import jenga_control.extraction.evaluate as module

    with patch.object(module, "ExtractionConfig", module.ExtractionConfig):  # puts back what the next line replaces
        exec(CHEAP_CLOSED_LOOP, {})
        yield


@dataclass(frozen=True)
class Ran:
    """What a run left in the terminal."""

    code: int
    out: str
    err: str

    def object(self) -> dict[str, Any]:
        """What --json printed: one object, and nothing else anywhere."""
        assert self.err == ""
        assert self.out.endswith("}\n")
        assert self.out.count("\n") == 1
        return json.loads(self.out)

    def line(self, code: int = 2) -> str:
        """The one line that a refusal prints, with that exit code."""
        assert self.code == code, self
        assert self.out == ""
        assert self.err.startswith("jenga: ")
        assert self.err.endswith("\n")
        assert self.err.count("\n") == 1, self.err
        return self.err[:-1]


@dataclass(frozen=True)
class Made:
    """A folder that a command line made, and what that said."""

    path: Path
    ran: Ran


def jenga(*args: object) -> Ran:
    """Run a command line in this process. An exception that would be a traceback is one here too."""
    out, err = io.StringIO(), io.StringIO()
    with patch.object(sys, "argv", ["jenga", *map(str, args)]), redirect_stdout(out), redirect_stderr(err):
        try:
            cli.main()
        except SystemExit as stop:
            return Ran(int(stop.code or 0), out.getvalue(), err.getvalue())
    raise AssertionError("main() always exits")


@contextmanager
def started(*args: object, before: str = "", **options: Any) -> Iterator[subprocess.Popen[str]]:
    """The program as the leader of a process group of its own, after the code `before` if there is any."""
    program = [sys.executable, "-c", f"{before}\nimport cli\ncli.main()"]
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, **options}
    process = subprocess.Popen([*program, *map(str, args)], start_new_session=True, **options)
    try:
        yield process
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def finish(process: subprocess.Popen[str]) -> Ran:
    out, err = process.communicate(timeout=PATIENCE)
    return Ran(process.returncode, out or "", err)


def run_apart(*args: object, before: str = "", **options: Any) -> Ran:
    """Run a command line in a process of its own."""
    with started(*args, before=before, **options) as process:
        return finish(process)


def interrupted_when(ready: Callable[[], bool], *args: object, before: str = "", **options: Any) -> Ran:
    """Start a command line, press Ctrl-C (a SIGINT to every process of the group) once `ready`, and wait for its end
    and that of all its workers."""
    with started(*args, before=before, **options) as process:
        wait_until(lambda: ready() or process.poll() is not None)
        assert process.poll() is None, finish(process)
        os.killpg(process.pid, signal.SIGINT)
        ran = finish(process)
        wait_until(lambda: not _alive(process.pid), 10.0)
    return ran


def wait_until(true: Callable[[], bool], seconds: float = PATIENCE) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, f"nothing came in {seconds} s"
        time.sleep(0.01)


def _alive(group: int) -> list[str]:
    """Processes of a group that still run; what has ended and waits for its parent to look counts as gone."""
    listed = subprocess.run(["ps", "-A", "-o", "pgid=,stat=,args="], capture_output=True, text=True, check=True)
    rows = (line.split(None, 2) for line in listed.stdout.splitlines())
    return [" ".join(row) for row in rows if row[0] == str(group) and not row[1].startswith("Z")]


def contents(folder: Path, pattern: str = "*") -> dict[str, bytes]:
    """Bytes of every file below a folder, by path."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob(pattern)) if p.is_file()}
