"""An episode as an animated picture, for a page or a slide: drawn as the film strip, the pull in slow motion."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont

from jenga_data.episode import Episode, Prediction
from jenga_data.errors import JengaError
from jenga_data.palette import INK, PAPER, block_colours, model_colour
from jenga_data.progress import progress
from jenga_data.replay.measures import phase_name, seconds
from jenga_data.replay.moments import telling_moments
from jenga_data.replay.picture import free_azimuth, render_tower, robot_parts, tower_camera
from jenga_data.replay.raster import Camera
from jenga_data.replay.solids import Boxes

KINDS = {".gif": {"optimize": True, "disposal": 1}, ".webp": {"quality": 80, "method": 4}}
"""What may be written, by its suffix, and how Pillow writes it."""
FRAMES_A_SECOND = 10
SLOWED = 5
"""A pull lasts a quarter of a second: it is shown so many times slower, with all of its frames."""
_LAST_SECONDS = 2.0
"""So long the last picture stays before the film begins again."""
_LETTER = 0.05
"""Height of the type, of the picture's."""


def write_film(path: Path, episode: Episode, predictions: Sequence[Prediction] = (), height: int = 400) -> Path:
    """Write the episode as a GIF or an animated WebP that repeats for ever, ten pictures a second of real time.

    While somebody acts, every frame is shown, `SLOWED` times as long. Below the tower stand the phase and the time
    since the first frame. What simulators predict are ghosts where they differ from the truth, in the colours that a
    replay gives them; frames that a model says nothing of have none.

    Args:
        predictions: of simulators; those without frames, as selectors', show nothing.
        height: of the picture [pixels], its caption included.

    Raises:
        JengaError: the suffix names another format, or the file cannot be written.
    """
    if path.suffix.lower() not in KINDS:
        raise JengaError(f"--film writes {' or '.join(KINDS)}; {path} ends in neither")
    shown, lasts = film_frames(episode)
    try:
        with progress("film", len(shown)) as bar:
            pictures = _pictures(episode, predictions, shown, height)

            def counted() -> Iterator[Image.Image]:
                for picture in pictures:
                    bar.advance()
                    yield picture

            first, *others = counted()
            first.save(
                path, save_all=True, append_images=others, loop=0,
                duration=[round(1e3 * each) for each in lasts], **KINDS[path.suffix.lower()],
            )  # fmt: skip
    except OSError as error:
        raise JengaError(f"cannot write {path}: {error.strerror or error}; choose another path") from error
    return path


def film_frames(episode: Episode) -> tuple[list[int], list[float]]:
    """The frames that are shown, up to the last in which every number is finite, and how long each [s]."""
    finite = np.asarray(np.isfinite(episode.pose).all(axis=(1, 2)))
    time = seconds(episode)[: len(finite) if finite.all() else max(int(np.argmin(finite)), 1)]
    wanted = np.searchsorted(time, np.arange(0.0, time[-1], 1 / FRAMES_A_SECOND))
    acted = episode.action_frame[episode.action_frame < len(time)]
    shown = np.unique([*wanted, *acted, *np.minimum(acted + 1, len(time) - 1), len(time) - 1])
    lasts = np.append(np.diff(time[shown]), _LAST_SECONDS)
    return shown.tolist(), np.where(np.isin(shown, acted), SLOWED * lasts, lasts).tolist()


def _pictures(
    episode: Episode, predictions: Sequence[Prediction], frames: Sequence[int], height: int
) -> Iterator[Image.Image]:
    size = episode.header.blocks.size
    colours = block_colours(episode.header.layout.level, episode.header.target)
    camera = _camera(episode, frames)
    time = seconds(episode)
    letter = round(_LETTER * height)
    font = ImageFont.truetype(font_manager.findfont("DejaVu Sans"), letter)
    tall = height - 2 * letter
    for frame in frames:
        # Where tower and ghost agree to the last bit a ghost's faces are hidden, see `paint`.
        ghosts = [
            Boxes(p.pose[at], size, np.tile(model_colour(number), (len(size), 1)))
            for number, p in enumerate(p for p in predictions if len(p.frame))
            for at in np.flatnonzero(p.frame == frame)[:1]
        ]
        drawn = render_tower(
            None, episode.pose[frame], size, colours=colours, others=robot_parts(episode, frame), ghosts=ghosts,
            camera=camera, height=tall,
        )  # fmt: skip
        picture = Image.new("RGB", (drawn.shape[1], height), _rgb(PAPER))
        picture.paste(Image.fromarray(np.round(drawn * 255).astype(np.uint8)))
        words = f"{phase_name(episode, frame).replace('_', ' ')}   {time[frame]:.2f} s"
        words += f"   {SLOWED} times slower" if frame in episode.action_frame else ""
        ImageDraw.Draw(picture).text((picture.width / 2, tall + letter / 2), words, _rgb(INK), font, anchor="mt")
        yield picture


def _camera(episode: Episode, frames: Sequence[int]) -> Camera:
    """One for the whole film: it sees what the moments show that tell the story."""
    size, colours = episode.header.blocks.size, block_colours(episode.header.layout.level)
    telling = [moment.frame for moment in telling_moments(episode) if moment.frame <= frames[-1]]
    towers = [Boxes(episode.pose[frame], size, colours) for frame in telling]
    robots = [part for frame in telling for part in robot_parts(episode, frame)]
    return tower_camera([*towers, *robots], azimuth=free_azimuth(episode))


def _rgb(colour: Sequence[float]) -> tuple[int, int, int]:
    red, green, blue = (round(255 * part) for part in colour)
    return red, green, blue
