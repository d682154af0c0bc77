"""Opening an episode at one of its moments, without any model."""

from pathlib import Path
from tempfile import mkdtemp

from jenga_data.log.reader import read_episode
from jenga_data.replay.measures import moment
from jenga_data.replay.rerun_adapter import open_at, write_rrd


def show_frame(log: Path, frame: int) -> None:
    """Open the viewer on a log at a frame. It stays open after this program ends.

    Raises:
        JengaError: the log cannot be read or has no such frame, or there is no viewer to open.
    """
    episode = read_episode(log)
    time = moment(episode, None, frame)
    recording = Path(mkdtemp(prefix="jenga-replay-")) / f"{log.stem}.rrd"  # the viewer reads it when we are gone
    write_rrd(episode, [], recording)
    open_at(recording, time)
