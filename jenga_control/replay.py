"""An episode in rerun, with the predictions of any number of models over it."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import mkdtemp

from jenga_data.episode import Episode
from jenga_data.errors import JengaError
from jenga_data.log.reader import read_episode
from jenga_data.replay.measures import moment


def replay(
    episode: Path,
    models: Sequence[Path] = (),
    *,
    save: Path | None = None,
    web: bool = False,
    png: Path | None = None,
    time: float | None = None,
    frame: int | None = None,
    strip: Path | None = None,
    meshes: str = "",
) -> list[Path]:
    """Write a recording, a screenshot or a film strip, or open a viewer. Returns the files that were asked for.

    A film strip alone needs no rerun: that is imported only for what it is to show.

    Args:
        time: moment at which the viewer opens or that the screenshot shows, since the first frame [s]...
        frame: ...or the number of its frame.
        meshes: see `jenga_data.replay.meshes.link_meshes`; none by default.

    Raises:
        JengaError: the log or a checkpoint cannot be read, or there is no viewer to open.
    """
    if web and (save or png or strip):
        raise JengaError("--web shows an episode, --save, --png and --strip write files; choose one")
    if strip and models and not (save or png):
        raise JengaError("--strip shows no model; leave --model out, or add --save or --png")
    if (time, frame) != (None, None) and not png and (web or save or strip):
        raise JengaError(
            "--time and --frame are for the viewer and for --png; leave them out, or what they cannot go with"
        )
    logged = read_episode(episode)
    at = moment(logged, time, frame)
    if strip:
        _write_strip(logged, strip)
        if not (save or png):
            return [strip]
    from jenga_data.replay.meshes import link_meshes
    from jenga_data.replay.rerun_adapter import open_at, screenshot, write_rrd
    from jenga_data.replay.viewer import open_viewer, serve_web

    predictions = []
    if models:
        from jenga_models.overlay import overlay

        predictions = [overlay(model, episode) for model in models]
    # The native viewer reads its file after this program has ended: the folder stays until the system clears it.
    recording = save or Path(mkdtemp(prefix="jenga-replay-")) / f"{logged.header.key}.rrd"
    write_rrd(logged, predictions, recording, link_meshes(meshes) if meshes else None)
    if png:
        screenshot(recording, png, at)
    elif web:
        serve_web([recording])
    elif not save and at:
        open_at(recording, at)
    elif not save:
        open_viewer([recording])
    return [path for path in (save, png, strip) if path is not None]


def _write_strip(episode: Episode, path: Path) -> None:
    from jenga_data.replay import style
    from jenga_data.replay.side_by_side import film_strip

    if path.suffix.lower() != ".png":
        raise JengaError(f"--strip writes a PNG; {path} does not end in .png")
    with style.applied():
        style.save(film_strip(episode), path)
