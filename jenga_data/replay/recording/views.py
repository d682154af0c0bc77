"""Views of a layout: towers from where they are best seen, and curves."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float

from jenga_data import palette
from jenga_data.episode import Episode
from jenga_data.replay.recording.models import WIRES
from jenga_data.replay.recording.robot import link_path, shapes_of
from jenga_data.replay.series import Series

_NEAR_AT, _NEAR_FROM = np.array([-0.06, 0.0, 0.125]), np.array([-0.43, -0.33, 0.26])
_STEP_BACK = 1.25
"""From how far a view looks at a robot and its tower, in diagonals of the box around them."""


def spatial(
    name: str, contents: list[str], eye: rrb.EyeControls3D, overrides: dict[Any, Any] | None = None
) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin="/", contents=contents, name=name, eye_controls=eye, line_grid=False, overrides=overrides or {}
    )


def wires(episode: Episode) -> dict[Any, Any]:
    """What draws tower and robot by their edges only, so that arrows show."""
    kinds = {"box": rr.Boxes3D, "sphere": rr.Ellipsoids3D, "cylinder": rr.Cylinders3D, "capsule": rr.Capsules3D}
    colors = [palette.rgba8(palette.OUTLINE)]
    wires: dict[Any, Any] = {
        path: rr.Boxes3D.from_fields(fill_mode=WIRES, colors=colors) for path in ("/world/tower", "/world/gripper")
    }
    for link in episode.header.robot.links if episode.header.robot else ():
        for shape in shapes_of(link):
            wires[f"{link_path(link)}/{shape}"] = kinds[shape].from_fields(fill_mode=WIRES, colors=colors)
    return wires


def near_eye() -> rrb.EyeControls3D:
    """From where a view looks at the tower alone: from the side it is pulled to."""
    return _orbit(_NEAR_AT, _NEAR_FROM)


def eye_of(episode: Episode) -> rrb.EyeControls3D:
    """From where a view looks at first: at the tower, or at a robot and its tower from across, so that neither hides
    the other."""
    if episode.robot is None or not episode.robot.link_pose.size:
        return near_eye()
    links = episode.robot.link_pose[0, :, :3]
    both = np.concatenate([links, episode.pose[0, :, :3]])
    low, high = both.min(axis=0), both.max(axis=0)
    way = episode.pose[0, :, :2].mean(axis=0) - links[:, :2].mean(axis=0)
    across = np.array([way[1], -way[0]]) / max(float(np.hypot(*way)), 1e-6)
    across *= -1.0 if across @ _NEAR_FROM[:2] < 0 else 1.0
    at = (low + high) / 2
    return _orbit(at, at + _STEP_BACK * float(np.linalg.norm(high - low)) * np.array([*across, 0.4]))


def close_to(points: Float[np.ndarray, "*batch 3"]) -> rrb.EyeControls3D:
    """From where a view looks at a few centimetres of the air, from above and beside."""
    flat = points.reshape(-1, 3)
    low, high = flat.min(axis=0), flat.max(axis=0)
    distance = 0.02 + 0.6 * float(np.linalg.norm(high - low))
    return _orbit((low + high) / 2, (low + high) / 2 + distance * np.array([-0.35, -0.75, 0.55]))


def _orbit(at: np.ndarray, position: np.ndarray) -> rrb.EyeControls3D:
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital, position=tuple(position), look_target=tuple(at), eye_up=(0, 0, 1)
    )


def plots(found: Sequence[Series], whole: rrb.TimeAxis) -> list[rrb.Container | rrb.View]:
    """A view a plot, side by side; those of one tab behind each other, last."""
    plots: dict[tuple[str, str], list[Series]] = {}
    for series in found:
        plots.setdefault((series.tab, series.plot), []).append(series)
    views: list[rrb.Container | rrb.View] = []
    tabs: dict[str, list[rrb.View]] = {}
    for (tab, name), lines in plots.items():
        view = curves(name, lines, whole, corner=_free_corner(lines, found))
        if tab:
            tabs.setdefault(tab, []).append(view)
        else:
            views.append(view)
    return views + [rrb.Tabs(contents=contents, name=tab) for tab, contents in tabs.items()]


def _free_corner(lines: Sequence[Series], found: Sequence[Series]) -> rrb.Corner2D:
    """Where the legend hides least: on the right where the lines end before half of the time that is shown."""
    begin, end = min(s.time_ns[0] for s in found), max(s.time_ns[-1] for s in found)
    early = max(s.time_ns[-1] for s in lines) - begin < (end - begin) / 2
    return rrb.Corner2D.RightTop if early else rrb.Corner2D.LeftTop


def curves(
    name: str,
    lines: list[Series],
    time: rrb.TimeAxis,
    root: str = "",
    top: float | None = None,
    corner: rrb.Corner2D = rrb.Corner2D.LeftTop,
) -> rrb.TimeSeriesView:
    """Lines in one plot; `top` is the end of its axis where several plots share one scale."""
    values = np.concatenate([series.value.ravel() for series in lines])
    low, high = float(min(0.0, np.nanmin(values))), float(max(0.0, np.nanmax(values)))
    high = high if top is None else top
    room = (high - low) or 1.0  # above the lines, for the legend
    return rrb.TimeSeriesView(
        origin="/",
        contents=[root + series.path for series in lines],
        name=name,
        axis_x=time,
        axis_y=rrb.ScalarAxis(range=(low - 0.05 * room, high + 0.3 * room)),
        plot_legend=rrb.PlotLegend(corner=corner),
    )
