"""Episodes in rerun, with the predictions of any number of models over them."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import mkdtemp

from jenga_data.episode import Episode, Prediction
from jenga_data.errors import JengaError
from jenga_data.log.reader import read_episode
from jenga_data.replay.measures import moment, seconds
from jenga_data.replay.shown import Shown

MOST = 6
"""So many episodes fit side by side on a screen."""


def replay(
    episodes: Sequence[Path],
    models: Sequence[Path] = (),
    *,
    from_frame: int | None = None,
    save: Path | None = None,
    web: bool = False,
    png: Path | None = None,
    time: float | None = None,
    frame: int | None = None,
    strip: Path | None = None,
    film: Path | None = None,
    meshes: str = "",
) -> list[Path]:
    """Write a recording, a screenshot, a film or a film strip, or open a viewer. Returns the files asked for.

    A film and a film strip need no rerun: that is imported only for what it is to show. Several episodes stand side
    by side.

    Args:
        from_frame: every dynamics model predicts in an open loop from this frame on as well.
        time: moment at which the viewer opens or that the screenshot shows, since the first frame [s]...
        frame: ...or the number of its frame.
        meshes: see `jenga_data.replay.meshes.link_meshes`; none by default.

    Raises:
        JengaError: a log or a checkpoint cannot be read, or there is no viewer to open.
    """
    written = [path for path in (save, png, strip, film) if path is not None]
    _refuse_contradictions(episodes, models, from_frame, save, web, png, (time, frame), strip, film)
    logged = [read_episode(episode) for episode in episodes]
    at = moment(max(logged, key=lambda episode: float(seconds(episode)[-1])), time, frame)
    if strip:
        _write_strip(logged[0], strip)
    if film:
        from jenga_data.replay.film import write_film

        predictions = shown_with(episodes[0], logged[0], models, from_frame).predictions
        write_film(film, logged[0], [p for p in predictions if from_frame is None or p.kind == "open_loop"])
    if (strip or film) and not (save or png):
        return written
    from jenga_data.replay.meshes import link_meshes
    from jenga_data.replay.rerun_adapter import open_at, screenshot, write_shown
    from jenga_data.replay.viewer import open_viewer, serve_web

    shown = [shown_with(path, episode, models, from_frame) for path, episode in zip(episodes, logged, strict=True)]
    # The native viewer reads its file after this program has ended: the folder stays until the system clears it.
    recording = save or Path(mkdtemp(prefix="jenga-replay-")) / f"{logged[0].header.key}.rrd"
    write_shown(shown, recording, link_meshes(meshes) if meshes else None)
    if png:
        screenshot(recording, png, at)
    elif web:
        serve_web([recording])
    elif not save and at:
        open_at(recording, at)
    elif not save:
        open_viewer([recording])
    return written


def shown_with(path: Path, episode: Episode, models: Sequence[Path], from_frame: int | None = None) -> Shown:
    """An episode with what models say of it, and with the plans of the controller that acted.

    A model's predictions are kept in sidecar files beside the log; see `jenga_models.overlay.overlay`.

    Raises:
        JengaError: as `overlay`.
        CheckFailed: as `overlay`.
    """
    sampling = "search" in (episode.header.config.get("controller") or {})
    if not models and not sampling:  # nothing here needs torch, which takes seconds to import
        return Shown(episode)
    from jenga_control.planning.plans import sampled_plans
    from jenga_models.checkpoint import load
    from jenga_models.overlay import OPEN_LOOP, overlay

    predictions: list[Prediction] = []
    notes: list[str] = []
    checkpoints = [load(model) for model in models]
    for checkpoint in checkpoints:
        if checkpoint.kind == "dynamics" and not len(episode.action):
            notes.append(f"{checkpoint.name} predicts nothing here: the episode has no action")
            continue
        predictions.append(overlay(checkpoint, path))
        if from_frame is not None and checkpoint.kind == "dynamics":
            predictions.append(overlay(checkpoint, path, OPEN_LOOP, from_frame))
    return Shown(episode, predictions, sampled_plans(episode, checkpoints), notes)


def _refuse_contradictions(
    episodes: Sequence[Path],
    models: Sequence[Path],
    from_frame: int | None,
    save: Path | None,
    web: bool,
    png: Path | None,
    moments: tuple[float | None, int | None],
    strip: Path | None,
    film: Path | None,
) -> None:
    if not episodes:
        raise JengaError("no log was given; name one or more: jenga replay EPISODE.mcap")
    if len(episodes) > MOST:
        raise JengaError(f"{len(episodes)} logs were given; at most {MOST} fit side by side")
    if web and (save or png or strip or film):
        raise JengaError("--web shows an episode, --save, --png, --strip and --film write files; choose one")
    if strip and models and not (save or png or film):
        raise JengaError("--strip shows no model; leave --model out, or add --save, --png or --film")
    if (strip or film) and len(episodes) > 1:
        name = "--strip" if strip else "--film"
        raise JengaError(f"{name} shows one episode, {len(episodes)} were given; run it once for each")
    if from_frame is not None and not models:
        raise JengaError("--from-frame is where models begin an open loop; add --model, or leave it out")
    if moments != (None, None) and not png and (web or save or strip or film):
        raise JengaError(
            "--time and --frame are for the viewer and for --png; leave them out, or what they cannot go with"
        )


def _write_strip(episode: Episode, path: Path) -> None:
    from jenga_data.replay import style
    from jenga_data.replay.side_by_side import film_strip

    if path.suffix.lower() != ".png":
        raise JengaError(f"--strip writes a PNG; {path} does not end in .png")
    with style.applied():
        style.save(film_strip(episode), path)
