"""The layout of several episodes side by side: a column each, over one time axis."""

from collections.abc import Sequence

import numpy as np
import rerun.blueprint as rrb

from jenga_data.replay.measures import MM, largest_displacement_of_others
from jenga_data.replay.recording.layout import STAND, TOWER, coloured_towers, ghosts, panels, whole
from jenga_data.replay.recording.views import curves, near_eye, spatial
from jenga_data.replay.series import Series, episode_series
from jenga_data.replay.shown import Shown
from jenga_data.replay.summary import chances, outcome_words, target_words


def root_of(number: int) -> str:
    """Where a recording of several episodes keeps one of them."""
    return f"/episode_{number}"


def heading(shown: Shown, number: int) -> str:
    """What stands above an episode's tower, short enough for a narrow column."""
    header = shown.episode.header
    lines = [f"## {number + 1}: {outcome_words(shown.episode)}", ""]
    lines += [f"round {header.round}, {target_words(header)}", "", f"`{header.key}`"]
    lines += [f"\n{name}: **{chance}**" for name, chance in chances(header.target, shown.predictions)]
    return "\n".join(lines)


def columns_blueprint(all_shown: Sequence[Shown]) -> rrb.Blueprint:
    """For each episode its words, its tower with ghosts, its phases, and how far others moved, at one scale."""
    time = whole([shown.episode for shown in all_shown])
    most = max(float(largest_displacement_of_others(shown.episode).max()) for shown in all_shown) * MM
    columns = []
    for number, shown in enumerate(all_shown):
        root = root_of(number)
        drawn = [*STAND, "/world/edges", *TOWER, *ghosts(shown.predictions)]
        words = rrb.TextDocumentView(origin=f"{root}/words", name=f"episode {number + 1}")
        towers = [spatial(f"tower {number + 1}", [root + path for path in drawn], near_eye())]
        towers += coloured_towers(shown.predictions, near_eye(), root)
        views: list[rrb.Container | rrb.View] = [words, towers[0] if len(towers) == 1 else rrb.Tabs(contents=towers)]
        shares = [1.6, 5.0]
        if shown.episode.phases:
            views.append(rrb.StateTimelineView(origin=f"{root}/phase", name="phases", time_view=time))
            shares.append(1.0)
        shared = [series for series in episode_series(shown.episode, shown.predictions) if _compared(series)]
        for title in dict.fromkeys(series.plot for series in shared):
            lines = [series for series in shared if series.plot == title]
            top = most if title == _MOVED else None
            views.append(curves(title, lines, time, root, top))
            shares.append(2.2)
        columns.append(rrb.Vertical(*views, row_shares=shares))
    return panels(rrb.Horizontal(*columns, column_shares=np.ones(len(columns))))


_MOVED = "others moved [mm]"


def _compared(series: Series) -> bool:
    return series.plot == _MOVED or series.path.startswith("/model/")
