"""Good and bad pushes (paper, figure bad_push_cases): the tower before the stick touches it, and after."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from jenga_data.episode import Episode
from jenga_data.figures.choose import Logged, first_of
from jenga_data.figures.scenes import Row, Scene, rows_figure
from jenga_data.palette import block_colours
from jenga_data.replay.measures import MM, displacement, others
from jenga_data.replay.summary import target_words
from jenga_data.tower import turn_poses

CASES = {
    "": "a good push",
    "push_dragged_layer": "a bad push: it drags layers along",
    "push_stuck": "a bad push: the block does not move",
    "push_toppled": "a bad push: the tower falls",
}
"""By the cause that a log names, "" for none."""
_PUSH, _AFTER = "push", "turn_back"


def chosen_pushes(logs: Sequence[Logged]) -> dict[str, Logged]:
    """The first log of each case that there is, by cause."""
    found = {cause: first_of((log for log in logs if log.has_robot), cause=cause) for cause in CASES}
    return {cause: log for cause, log in found.items() if log is not None}


def pushes_figure(episodes: dict[str, Episode]) -> Figure | None:
    """A row a case: before, when the stick stops, and at the end. None where no episode has a push."""
    rows = [row for cause, episode in episodes.items() if (row := _row(cause, episode)) is not None]
    return rows_figure(rows) if rows else None


def _row(cause: str, episode: Episode) -> Row | None:
    begun = {phase.name: phase.frame for phase in episode.phases}
    if _PUSH not in begun:
        return None
    last = len(episode.time_ns) - 1
    before = begun[_PUSH]
    later = [phase.frame for phase in episode.phases if phase.frame > before]
    after = begun.get(_AFTER, later[0] if later else last)
    moved = displacement(episode) * MM
    colours = block_colours(episode.header.layout.level, episode.header.target)

    def scene(frame: int, words: str) -> Scene:
        target = float(moved[frame, episode.header.target])
        rest = float(np.max(moved[frame, others(episode)]))
        caption = f"{words}\ntarget {target:.0f} mm, others {rest:.0f} mm"
        # What is pushed comes out at +x; the picture looks from -x, where the light is.
        return Scene(turn_poses(episode.pose[frame], np.pi), colours, caption)

    title = f"{CASES[cause]}; {target_words(episode.header)}, round {episode.header.round}"
    ended = episode.result.verdict.outcome if episode.result else "unknown"
    scenes = [scene(before, "before"), scene(after, "after the push"), scene(last, f"end: {ended}")]
    return Row(title, episode.header.blocks.size, scenes)
