"""An episode in rerun, with the predictions of any number of models over it."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import mkdtemp

from jenga_data.errors import JengaError
from jenga_data.log.reader import read_episode
from jenga_data.replay.rerun_adapter import screenshot, write_rrd
from jenga_data.replay.viewer import open_viewer, serve_web


def replay(
    episode: Path,
    models: Sequence[Path] = (),
    *,
    save: Path | None = None,
    web: bool = False,
    png: Path | None = None,
    time: float = 0.0,
) -> list[Path]:
    """Write a recording, take a screenshot, or open a viewer. Returns the files that were asked for.

    Raises:
        JengaError: the log or a checkpoint cannot be read, or there is no viewer to open.
    """
    if web and (save or png):
        raise JengaError("--web shows an episode, --save and --png write files; choose one")
    logged = read_episode(episode)
    predictions = []
    if models:
        from jenga_models.overlay import overlay

        predictions = [overlay(model, episode) for model in models]
    # The native viewer reads its file after this program has ended: the folder stays until the system clears it.
    recording = save or Path(mkdtemp(prefix="jenga-replay-")) / f"{logged.header.key}.rrd"
    write_rrd(logged, predictions, recording)
    if png:
        screenshot(recording, png, time)
    elif web:
        serve_web([recording])
    elif not save:
        open_viewer([recording])
    return [path for path in (save, png) if path is not None]
