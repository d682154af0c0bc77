"""Columns of one episode into a stream: one call an entity, because a call a block or a frame takes a hundred times as
long."""

import numpy as np
import rerun as rr
from jaxtyping import Float

from jenga_data import palette
from jenga_data.episode import Episode
from jenga_data.replay.measures import frame_at
from jenga_data.replay.series import Series

TIME, FRAME = "time", "frame"
"""The two timelines: seconds since the first frame, and the frame's number."""


class Recorder:
    """Writes columns of one episode to a stream; `root` stands before every path, where a recording has several."""

    def __init__(self, stream: rr.RecordingStream, episode: Episode, root: str = "") -> None:
        self.stream, self.episode, self.root = stream, episode, root

    def static(self, path: str, value: rr.AsComponents) -> None:
        self.stream.log(self.root + path, value, static=True)

    def columns(self, path: str, time_ns: np.ndarray, columns: rr.ComponentColumnList) -> None:
        since = (time_ns - self.episode.time_ns[0]).astype("timedelta64[ns]")
        frame = frame_at(self.episode, time_ns)
        times = [rr.TimeColumn(TIME, duration=since), rr.TimeColumn(FRAME, sequence=frame)]
        self.stream.send_columns(self.root + path, times, columns)

    def boxes(self, path: str, time_ns: np.ndarray, pose: Float[np.ndarray, "row box 7"]) -> None:
        """Where boxes are over time; what they look like is static and logged apart."""
        flat = pose.reshape(-1, 7).astype(np.float32)
        poses = rr.InstancePoses3D.columns(translations=flat[:, :3], quaternions=flat[:, [4, 5, 6, 3]])
        self.columns(path, time_ns, poses.partition(np.full(len(pose), pose.shape[1])))

    def curves(self, series: Series) -> None:
        """One line a column, under its name in the legend."""
        count = len(series.names)
        colours = [palette.rgba8(colour) for colour in series.colours]
        self.static(series.path, rr.SeriesLines(names=series.names, colors=colours, widths=[series.width] * count))
        scalars = rr.Scalars.columns(scalars=series.value.ravel())
        self.columns(series.path, series.time_ns, scalars.partition(np.full(len(series.value), count)))
