"""An episode, and what models say of it, as a rerun recording with its layout: the one door to rerun.

Nothing outside this module and the folder `recording`, which belongs to it, imports rerun. rerun changes every few
weeks, so its range is pinned and a smoke test reads back what is written here. A recording is never the source of
truth: it is made from the log, and can be made again.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from jenga_data.episode import Episode, Prediction
from jenga_data.errors import JengaError
from jenga_data.replay.measures import model_labels
from jenga_data.replay.meshes import Mesh
from jenga_data.replay.recording.columns import columns_blueprint, heading, root_of
from jenga_data.replay.recording.contacts import log_contacts
from jenga_data.replay.recording.layout import blueprint
from jenga_data.replay.recording.models import log_model
from jenga_data.replay.recording.plans import log_plans
from jenga_data.replay.recording.recorder import FRAME, TIME, Recorder
from jenga_data.replay.recording.scene import log_scene
from jenga_data.replay.recording.window import open_at, screenshot
from jenga_data.replay.series import episode_series
from jenga_data.replay.shown import Shown
from jenga_data.replay.summary import outcome_words, summary

__all__ = ["FRAME", "TIME", "open_at", "screenshot", "write_rrd", "write_shown"]


def write_rrd(
    episode: Episode, predictions: Sequence[Prediction], out: Path, meshes: Mapping[str, Mesh] | None = None
) -> None:
    """Write an episode with the predictions over it as an .rrd file that brings its own layout.

    Args:
        meshes: of the robot's links, by their names, in place of our own shapes.

    Raises:
        JengaError: `out` cannot be written.
    """
    write_shown([Shown(episode, predictions)], out, meshes)


def write_shown(all_shown: Sequence[Shown], out: Path, meshes: Mapping[str, Mesh] | None = None) -> None:
    """The same for an episode with all that is drawn over it, or for several of them side by side.

    Raises:
        JengaError: `out` cannot be written, or there is no episode.
    """
    if not all_shown:
        raise JengaError("there is no episode to show; give at least one log")
    if len(all_shown) == 1:
        (shown,) = all_shown
        header = shown.episode.header
        # A layout belongs to an application in rerun, and every episode has its own panels: so each is one.
        name, views = f"jenga {header.kind} {header.key[:12]}", blueprint(shown)
        _write(name, header.key, out, views, lambda stream: _log(Recorder(stream, shown.episode), shown, meshes or {}))
        return

    def log(stream: rr.RecordingStream) -> None:
        stream.send_recording_name(f"{len(all_shown)} episodes")
        for number, shown in enumerate(all_shown):
            _log_column(Recorder(stream, shown.episode, root_of(number)), shown, number, meshes or {})

    key = "-".join(shown.episode.header.key[:8] for shown in all_shown)
    _write(f"jenga {key}", key, out, columns_blueprint(all_shown), log)


def _write(
    application: str, key: str, out: Path, views: rrb.Blueprint, log: Callable[[rr.RecordingStream], None]
) -> None:
    stream = rr.RecordingStream(application, recording_id=key)
    partial = out.with_name(out.name + ".partial")
    try:
        partial.touch()
        stream.save(partial, default_blueprint=views)
        log(stream)
        stream.flush()
        stream.disconnect()
        partial.replace(out)
    except OSError as error:
        raise JengaError(f"cannot write {out}: {error.strerror or error}; choose another path for --save") from error


def _log(to: Recorder, shown: Shown, meshes: Mapping[str, Mesh]) -> None:
    episode, predictions = shown.episode, shown.predictions
    to.stream.send_recording_name(f"{episode.header.kind} {episode.header.number}: {outcome_words(episode)}")
    words = summary(episode, predictions, shown.plans, shown.notes)
    to.static("/episode", rr.TextDocument(words, media_type=rr.MediaType.MARKDOWN))
    log_scene(to, meshes)
    log_contacts(to)
    _log_models(to, predictions)
    if shown.plans is not None and len(shown.plans.frame):
        log_plans(to, shown.plans)


def _log_column(to: Recorder, shown: Shown, number: int, meshes: Mapping[str, Mesh]) -> None:
    """Of one episode among several: what its column shows."""
    to.static("/words", rr.TextDocument(heading(shown, number), media_type=rr.MediaType.MARKDOWN))
    log_scene(to, meshes)
    _log_models(to, shown.predictions)


def _log_models(to: Recorder, predictions: Sequence[Prediction]) -> None:
    for series in episode_series(to.episode, predictions):
        to.curves(series)
    for number, (label, prediction) in enumerate(zip(model_labels(predictions), predictions, strict=True)):
        log_model(to, number, label, prediction)
