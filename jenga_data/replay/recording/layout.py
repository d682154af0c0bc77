"""The layout of an episode's recording: which views stand where."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from jenga_data.episode import Episode, Prediction
from jenga_data.replay.measures import has_chances, model_labels, seconds
from jenga_data.replay.recording.contacts import NODE
from jenga_data.replay.recording.recorder import TIME
from jenga_data.replay.recording.views import close_to, eye_of, near_eye, plots, spatial, wires
from jenga_data.replay.series import episode_series, model_path
from jenga_data.replay.shown import Shown

STAND = ("/world/turntable", "/world/table")
TOWER = ("/world/tower", "/world/gripper", "/world/robot/**")
_BASE = (*STAND, "/world/edges")


def blueprint(shown: Shown) -> rrb.Blueprint:
    """Towers, graph and text above; phases and curves over one time axis below. No panel is empty."""
    episode, predictions = shown.episode, shown.predictions
    above = [*_towers(episode, predictions), *_coloured(predictions)]
    if forces := _forces(episode):
        above.append(forces)
    if shown.plans is not None and len(shown.plans.frame):
        eye = close_to(shown.plans.path)
        plans = spatial("sampled plans", [*STAND, *TOWER, "/plans/**"], eye, wires(episode))
        above[-1:] = [rrb.Vertical(above[-1], plans)]
    shares = [2.5] * len(above)
    if forces:
        above.append(_graph(episode))
        shares.append(1.3)
    words = rrb.TextDocumentView(origin="/episode", name="episode")
    rows: list[rrb.Container | rrb.View] = [rrb.Horizontal(*above, words, column_shares=[*shares, 2.2])]
    time = whole([episode])
    if episode.phases:
        rows.append(rrb.StateTimelineView(origin="/phase", name="phases", time_view=time))
    rows.append(rrb.Horizontal(*plots(episode_series(episode, predictions), time)))
    return panels(rrb.Vertical(*rows, row_shares=[5.4, *([0.85] if episode.phases else []), 3.6]))


def panels(views: rrb.Container) -> rrb.Blueprint:
    """The views alone, with the time below: the viewer's own panels are folded away."""
    return rrb.Blueprint(
        views,
        rrb.TimePanel(timeline=TIME, state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def whole(episodes: Sequence[Episode]) -> rrb.TimeAxis:
    """One time axis for the longest of some episodes."""
    last = max(float(seconds(episode)[-1]) for episode in episodes)
    start, end = (rr.TimeRangeBoundary.absolute(seconds=s) for s in (0.0, last))
    return rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))


def ghosts(predictions: Sequence[Prediction]) -> list[str]:
    """Paths of all ghosts."""
    labelled = zip(model_labels(predictions), predictions, strict=True)
    return [f"{model_path(label)}/ghost/**" for label, prediction in labelled if len(prediction.frame)]


def _towers(episode: Episode, predictions: Sequence[Prediction]) -> list[rrb.Container | rrb.View]:
    drawn = ghosts(predictions)
    title = "tower, with ghosts of the models" if drawn else "tower"
    return [spatial(title, [*_BASE, *TOWER, *drawn], eye_of(episode))]


def coloured_towers(
    predictions: Sequence[Prediction], eye: rrb.EyeControls3D, root: str = ""
) -> list[rrb.Spatial3DView]:
    """Towers in the colours of each model's errors, then in those of each selector's chances."""
    errors, chances = [], []
    for label, prediction in zip(model_labels(predictions), predictions, strict=True):
        base = [root + path for path in _BASE]
        if len(prediction.frame):
            errors.append(spatial(f"error, {label}", [*base, f"{root}{model_path(label)}/error"], eye))
        if has_chances(prediction):
            of = f"chance to fail, {prediction.name}"
            chances.append(spatial(of, [*base, f"{root}{model_path(label)}/chance"], eye))
    return [*errors, *chances]


def _coloured(predictions: Sequence[Prediction]) -> list[rrb.Container | rrb.View]:
    """Errors of models behind each other, and beside them the chances."""
    views = coloured_towers(predictions, near_eye())
    errors = sum(len(prediction.frame) > 0 for prediction in predictions)
    groups = (views[:errors], views[errors:])
    return [group[0] if len(group) == 1 else rrb.Tabs(contents=group) for group in groups if group]


def _forces(episode: Episode) -> rrb.View | None:
    if not any(len(touching.first) for touching in episode.contacts):
        return None
    return spatial("contact forces", [*STAND, *TOWER, "/world/contacts"], near_eye(), wires(episode))


def _graph(episode: Episode) -> rrb.View:
    highest = len(episode.header.layout.grid) - 0.3
    x, y = (-2.5 * NODE[0], 2.5 * NODE[0]), (highest * NODE[1], -1.9 * NODE[1])
    bounds = rrb.VisualBounds2D(x_range=np.array(x), y_range=np.array(y))
    return rrb.GraphView(origin="/graph", name="contacts", visual_bounds=bounds)
