"""Starting rerun's viewer as a process of its own, with its usage reports switched off."""

import importlib.util
import os
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from jenga_data.errors import JengaError

_START_SECONDS = 30.0
_NO_GRAPHICS = ("No graphics adapter", "Failed to get render context", "Failed to create headless")


def _viewer_command(arguments: Sequence[str]) -> list[str]:
    """The viewer that came with the installed rerun-sdk, whatever PATH says.

    Raises:
        JengaError: the package has no viewer for this platform.
    """
    spec = importlib.util.find_spec("rerun_cli")
    program = Path(spec.origin).parent / "rerun" if spec and spec.origin else None
    if program is None or not program.exists():
        raise JengaError(
            "rerun-sdk has no viewer on this platform; write the recording with --save and open it elsewhere"
        )
    return [str(program), *arguments]


def _quiet_environment() -> dict[str, str]:
    """The environment in which the viewer sends no usage reports: it never does in continuous integration."""
    return {**os.environ, "CI": "1"}


@contextmanager
def headless_viewer(recording: Path, window: tuple[int, int]) -> Iterator[str]:
    """Run a viewer without a window on a recording or a log while the body runs, and give its URL.

    Raises:
        JengaError: the machine has no Vulkan driver, or the viewer did not start.
    """
    port = _free_port()
    arguments = ["--headless", "--window-size", f"{window[0]}x{window[1]}", "--hide-welcome-screen"]
    arguments += ["--bind", "127.0.0.1", "--port", str(port), str(recording)]
    with tempfile.TemporaryFile("w+") as said:
        process = subprocess.Popen(
            _viewer_command(arguments), env=_quiet_environment(), stdout=said, stderr=subprocess.STDOUT, text=True
        )
        try:
            deadline = time.monotonic() + _START_SECONDS
            while not _listens(port):
                if process.poll() is not None or time.monotonic() > deadline:
                    raise _did_not_start(_all_of(said))
                time.sleep(0.05)
            yield f"rerun+http://127.0.0.1:{port}/proxy"
        except (ConnectionError, RuntimeError) as error:
            if process.poll() is None:
                raise
            raise _did_not_start(_all_of(said)) from error
        finally:
            process.terminate()
            try:
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def open_viewer(recordings: Sequence[Path]) -> None:
    """Show recordings in the native viewer, which stays open after this program ends."""
    _start(["--hide-welcome-screen", *map(str, recordings)])


def open_steerable_viewer(recording: Path) -> str:
    """The same in a window of its own, which can be told what to show. Returns its URL.

    Raises:
        JengaError: the viewer did not start.
    """
    port = _free_port()
    process = _start(["--hide-welcome-screen", "--bind", "127.0.0.1", "--port", str(port), str(recording)])
    deadline = time.monotonic() + _START_SECONDS
    while not _listens(port):
        if process.poll() is not None or time.monotonic() > deadline:
            raise JengaError(
                "rerun's viewer did not start, which needs a screen; write the recording with --save and open it there"
            )
        time.sleep(0.05)
    return f"rerun+http://127.0.0.1:{port}/proxy"


def _start(arguments: Sequence[str]) -> subprocess.Popen[bytes]:
    """A viewer that outlives this program."""
    quiet = subprocess.DEVNULL
    command = _viewer_command(arguments)
    return subprocess.Popen(command, env=_quiet_environment(), stdout=quiet, stderr=quiet, start_new_session=True)


def serve_web(recordings: Sequence[Path], port: int = 9090) -> int:
    """Serve recordings to a browser on this machine until the user stops it, and return the server's exit code.

    The page that the browser loads has a switch of its own for usage reports, in its settings.
    """
    command = _viewer_command(["--web-viewer", "--web-viewer-port", str(port), "--bind", "127.0.0.1"])
    return subprocess.run([*command, *map(str, recordings)], env=_quiet_environment(), check=False).returncode


def _did_not_start(said: str) -> JengaError:
    """The error for a viewer that ended by itself, from what it printed."""
    if any(sign in said for sign in _NO_GRAPHICS):
        return JengaError(
            "rerun found no Vulkan driver to make a picture with; install one "
            "(Debian: apt-get install mesa-vulkan-drivers), or write the recording with --save and open it elsewhere"
        )
    last = said.strip().splitlines()[-1] if said.strip() else "it said nothing"
    return JengaError(f"rerun's viewer did not start: {last}")


def _all_of(said: TextIO) -> str:
    said.seek(0)
    return said.read()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(0.2)
        return probe.connect_ex(("127.0.0.1", port)) == 0
