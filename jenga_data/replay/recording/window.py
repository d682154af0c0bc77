"""The viewer on a recording: opened at a moment, or pictured without a window."""

import time as clock
from pathlib import Path

import numpy as np
from rerun.experimental import Timeline, ViewerClient

from jenga_data.errors import JengaError
from jenga_data.replay.recording.recorder import TIME
from jenga_data.replay.viewer import headless_viewer, open_steerable_viewer

_NOTES = 4.0
"""How long a new viewer shows notes over its panels [s]."""
_PATIENCE = 60.0
"""How long a viewer without a window may take to load and to draw [s]."""


def screenshot(recording: Path, out: Path, time: float, window: tuple[int, int] = (1920, 1200)) -> None:
    """Write a PNG of the viewer on an .rrd or .mcap file at `time` seconds after its start, without a window.

    Raises:
        JengaError: there is no such file, no Vulkan driver, or the file holds nothing to show.
    """
    if not recording.exists():
        raise JengaError(f"{recording} does not exist; jenga replay EPISODE.mcap --save OUT.rrd writes a recording")
    with headless_viewer(recording, window) as url:
        viewer = _viewer_at(url, recording, time)
        viewer.run_command("ui.toggle_top_panel")  # it names the graphics driver
        started, before, picture = clock.monotonic(), None, b""
        while picture != before or clock.monotonic() < started + _NOTES:  # the graph takes a while to settle
            if clock.monotonic() > started + _PATIENCE:
                break
            clock.sleep(0.3)
            before, picture = picture, viewer.take_screenshot()
    try:
        out.write_bytes(picture)
    except OSError as error:
        raise JengaError(f"cannot write {out}: {error.strerror or error}; choose another path for --png") from error


def open_at(recording: Path, time: float) -> None:
    """Open the native viewer on an .rrd or .mcap file at `time` seconds after its start. It stays open.

    Raises:
        JengaError: the viewer did not start, or the file holds nothing to show.
    """
    _viewer_at(open_steerable_viewer(recording), recording, time)


def _viewer_at(url: str, recording: Path, time: float) -> ViewerClient:
    """Wait until the viewer behind a URL has loaded the recording, and go to that moment."""
    viewer = ViewerClient.connect(url)
    started = clock.monotonic()
    while (state := viewer.get_state()).loading or not any(r.timelines for r in state.recordings):
        if clock.monotonic() > started + (_PATIENCE if state.loading else _PATIENCE / 6):
            raise JengaError(f"rerun found nothing to show in {recording}; it opens .rrd and .mcap files")
        clock.sleep(0.1)
    _set_time(viewer, {t.name: t for r in state.recordings for t in r.timelines}, time)
    return viewer


def _set_time(viewer: ViewerClient, timelines: dict[str, Timeline], time: float) -> None:
    """Go to `time` seconds on this project's timeline, or on the first clock of a log that rerun read by itself."""
    stamped = next((t for t in timelines.values() if t.time_type == "timestamp"), None)
    if TIME in timelines:
        viewer.set_time(TIME, duration=time, play_state="paused")
    elif stamped is not None:
        at = np.datetime64((stamped.start or 0) + round(time * 1e9), "ns")
        viewer.set_time(stamped.name, timestamp=at, play_state="paused")
