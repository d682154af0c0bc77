"""An episode, and what models say of it, as a rerun recording with its layout: the only module that imports rerun.

rerun changes every few weeks, so its range is pinned and a smoke test reads back what is written here. A recording
is never the source of truth: it is made from the log, and can be made again. Everything goes in as columns, one
call an entity, because a call a block or a frame takes a hundred times as long.
"""

import time as clock
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float
from rerun.experimental import Timeline, ViewerClient

from jenga_data import palette
from jenga_data.episode import Episode, Link, Prediction, RobotModel, RobotTrack
from jenga_data.errors import JengaError
from jenga_data.geometry import rotation_matrices
from jenga_data.replay import hand
from jenga_data.replay.contact_points import contact_points, graph_nodes
from jenga_data.replay.measures import (
    error_scale,
    frame_at,
    frames_without,
    has_chances,
    metres_per_newton,
    model_labels,
    others,
    position_error,
    seconds,
)
from jenga_data.replay.meshes import Mesh
from jenga_data.replay.series import Series, episode_series, model_path
from jenga_data.replay.summary import outcome_words, summary
from jenga_data.replay.viewer import headless_viewer, open_steerable_viewer
from jenga_data.scenery import (
    COLUMN_HEIGHT,
    COLUMN_RADIUS,
    TABLE_CENTRE,
    TABLE_SIZE,
    TABLE_TOP,
    TURNTABLE_HEIGHT,
    TURNTABLE_RADIUS,
)

TIME, FRAME = "time", "frame"
"""The two timelines: seconds since the first frame, and the frame's number."""
_NOTES = 4.0
"""How long a new viewer shows notes over its panels [s]."""
_PATIENCE = 60.0
"""How long a viewer without a window may take to load and to draw [s]."""
_FAINTEST = 0.02
"""Contacts weaker than this are not drawn [N]."""
_GHOST_MARGIN = 3e-4
"""Ghosts are larger than their blocks by so much [m], so that they do not flicker where they agree with the truth."""
_STEP_BACK = 1.25
"""From how far a view looks at a robot and its tower, in diagonals of the box around them."""
_TABLE = (0.20, 0.21, 0.22)
"""Darker than the turntable: on a black ground a pale table would be the brightest thing of all."""
_NODE = (70.0, -40.0)
"""A step to the right and a level up in the contact graph."""
_SOLID, _WIRES = rr.components.FillMode.Solid, rr.components.FillMode.MajorWireframe
_TRANSLUCENT = rr.components.FillMode.TransparentFillMajorWireframe


def write_rrd(
    episode: Episode, predictions: Sequence[Prediction], out: Path, meshes: Mapping[str, Mesh] | None = None
) -> None:
    """Write an episode with the predictions over it as an .rrd file that brings its own layout.

    Args:
        meshes: of the robot's links, by their names, in place of our own shapes.

    Raises:
        JengaError: `out` cannot be written.
    """
    # A layout belongs to an application in rerun, and every episode has its own panels: so each is one.
    application = f"jenga {episode.header.kind} {episode.header.key[:12]}"
    stream = rr.RecordingStream(application, recording_id=episode.header.key)
    partial = out.with_name(out.name + ".partial")
    try:
        partial.touch()
        stream.save(partial, default_blueprint=_blueprint(episode, predictions))
        _log(_Recorder(stream, episode), predictions, meshes or {})
        stream.flush()
        stream.disconnect()
        partial.replace(out)
    except OSError as error:
        raise JengaError(f"cannot write {out}: {error.strerror or error}; choose another path for --save") from error


def screenshot(recording: Path, out: Path, time: float, window: tuple[int, int] = (1920, 1200)) -> None:
    """Write a PNG of the viewer on an .rrd or .mcap file at `time` seconds after its start, without a window.

    Raises:
        JengaError: there is no such file, no Vulkan driver, or the file holds nothing to show.
    """
    if not recording.exists():
        raise JengaError(f"{recording} does not exist; jenga replay EPISODE.mcap --save OUT.rrd writes a recording")
    with headless_viewer(recording, window) as url:
        viewer = _viewer_at(url, recording, time)
        viewer.run_command("ui.toggle_top_panel")  # it names the graphics driver
        started, before, picture = clock.monotonic(), None, b""
        while picture != before or clock.monotonic() < started + _NOTES:  # the graph takes a while to settle
            if clock.monotonic() > started + _PATIENCE:
                break
            clock.sleep(0.3)
            before, picture = picture, viewer.take_screenshot()
    try:
        out.write_bytes(picture)
    except OSError as error:
        raise JengaError(f"cannot write {out}: {error.strerror or error}; choose another path for --png") from error


def open_at(recording: Path, time: float) -> None:
    """Open the native viewer on an .rrd or .mcap file at `time` seconds after its start. It stays open.

    Raises:
        JengaError: the viewer did not start, or the file holds nothing to show.
    """
    _viewer_at(open_steerable_viewer(recording), recording, time)


def _viewer_at(url: str, recording: Path, time: float) -> ViewerClient:
    """Wait until the viewer behind a URL has loaded the recording, and go to that moment."""
    viewer = ViewerClient.connect(url)
    started = clock.monotonic()
    while (state := viewer.get_state()).loading or not any(r.timelines for r in state.recordings):
        if clock.monotonic() > started + (_PATIENCE if state.loading else _PATIENCE / 6):
            raise JengaError(f"rerun found nothing to show in {recording}; it opens .rrd and .mcap files")
        clock.sleep(0.1)
    _set_time(viewer, {t.name: t for r in state.recordings for t in r.timelines}, time)
    return viewer


def _set_time(viewer: ViewerClient, timelines: dict[str, Timeline], time: float) -> None:
    """Go to `time` seconds on this project's timeline, or on the first clock of a log that rerun read by itself."""
    stamped = next((t for t in timelines.values() if t.time_type == "timestamp"), None)
    if TIME in timelines:
        viewer.set_time(TIME, duration=time, play_state="paused")
    elif stamped is not None:
        at = np.datetime64((stamped.start or 0) + round(time * 1e9), "ns")
        viewer.set_time(stamped.name, timestamp=at, play_state="paused")


class _Recorder:
    """Writes columns of one episode to a stream."""

    def __init__(self, stream: rr.RecordingStream, episode: Episode) -> None:
        self.stream, self.episode = stream, episode

    def static(self, path: str, value: rr.AsComponents) -> None:
        self.stream.log(path, value, static=True)

    def columns(self, path: str, time_ns: np.ndarray, columns: rr.ComponentColumnList) -> None:
        since = (time_ns - self.episode.time_ns[0]).astype("timedelta64[ns]")
        frame = frame_at(self.episode, time_ns)
        times = [rr.TimeColumn(TIME, duration=since), rr.TimeColumn(FRAME, sequence=frame)]
        self.stream.send_columns(path, times, columns)

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


def _log(to: _Recorder, predictions: Sequence[Prediction], meshes: Mapping[str, Mesh]) -> None:
    to.stream.send_recording_name(f"{to.episode.header.kind} {to.episode.header.number}: {outcome_words(to.episode)}")
    to.static("/episode", rr.TextDocument(summary(to.episode, predictions), media_type=rr.MediaType.MARKDOWN))
    _log_scene(to, meshes)
    _log_contacts(to)
    for series in episode_series(to.episode, predictions):
        to.curves(series)
    for number, (label, prediction) in enumerate(zip(model_labels(predictions), predictions, strict=True)):
        _log_model(to, number, label, prediction)


def _log_scene(to: _Recorder, meshes: Mapping[str, Mesh]) -> None:
    episode, header = to.episode, to.episode.header
    to.static("/world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    _log_stand(to)
    colours = palette.rgba8(palette.block_colours(header.layout.level, header.target))
    edges = rr.Boxes3D(sizes=header.blocks.size, colors=[palette.rgba8(palette.INK)], radii=rr.Radius.ui_points(0.6))
    to.static("/world/edges", edges)
    to.boxes("/world/edges", episode.time_ns, episode.pose)
    names = [f"block {i}" for i in range(len(header.blocks))]
    tower = rr.Boxes3D(sizes=header.blocks.size, colors=colours, labels=names, show_labels=False, fill_mode=_SOLID)
    to.static("/world/tower", tower)
    to.boxes("/world/tower", episode.time_ns, episode.pose)
    track = episode.gripper
    if header.robot is not None and episode.robot is not None:
        _log_robot(to, header.robot, episode.robot, meshes)
    elif len(track.time_ns):
        to.static("/world/gripper", rr.Boxes3D(sizes=hand.SIZE, colors=palette.rgba8(hand.COLOUR), fill_mode=_SOLID))
        to.boxes("/world/gripper", track.time_ns, hand.hand_poses(track.pose, track.width))
    if episode.phases:
        names = list(dict.fromkeys(phase.name for phase in episode.phases))
        colours = [palette.rgba8(palette.PHASES[i % len(palette.PHASES)]) for i in range(len(names))]
        to.static("/phase", rr.StateConfiguration(values=names, colors=colours))
        starts = np.array([phase.time_ns for phase in episode.phases])
        to.columns("/phase", starts, rr.StateChange.columns(state=[phase.name for phase in episode.phases]))


def _log_stand(to: _Recorder) -> None:
    """Turntable, column and table."""
    stand = rr.Cylinders3D(
        lengths=[TURNTABLE_HEIGHT, COLUMN_HEIGHT],
        radii=[TURNTABLE_RADIUS, COLUMN_RADIUS],
        centers=[(0.0, 0.0, -TURNTABLE_HEIGHT / 2), (0.0, 0.0, TABLE_TOP + COLUMN_HEIGHT / 2)],
        colors=palette.rgba8(np.array([palette.TABLE, palette.STEEL])),
        fill_mode=_SOLID,
    )
    to.static("/world/turntable", stand)
    colour = [palette.rgba8(_TABLE)]
    to.static("/world/table", rr.Boxes3D(sizes=[TABLE_SIZE], centers=[TABLE_CENTRE], colors=colour, fill_mode=_SOLID))


def _log_robot(to: _Recorder, model: RobotModel, track: RobotTrack, meshes: Mapping[str, Mesh]) -> None:
    """A transform a link over time, and below it its mesh, or what it is made of: an entity a kind of solid."""
    for number, link in enumerate(model.links):
        path = _link_path(link)
        pose = track.link_pose[:, number].astype(np.float32)
        moves = rr.Transform3D.columns(translation=pose[:, :3], quaternion=pose[:, [4, 5, 6, 3]])
        to.columns(path, to.episode.time_ns, moves)
        if mesh := meshes.get(link.name):
            to.static(f"{path}/mesh", _mesh(mesh))
            continue
        for shape in _shapes(link):
            to.static(f"{path}/{shape}", _solids(link, shape))


def _mesh(mesh: Mesh) -> rr.Mesh3D:
    colors = np.round(255 * mesh.color).astype(np.uint8)
    return rr.Mesh3D(vertex_positions=mesh.vertex, triangle_indices=mesh.triangle, vertex_colors=colors)


def _link_path(link: Link) -> str:
    return "/world/robot/" + rr.escape_entity_path_part(link.name)


def _shapes(link: Link) -> list[str]:
    """Every shape of its solids once."""
    return list(dict.fromkeys(solid.shape for solid in link.solids))


def _solids(link: Link, shape: str) -> rr.AsComponents:
    """All of a link's solids of one shape."""
    solids = [solid for solid in link.solids if solid.shape == shape]
    size, pose = np.array([solid.size for solid in solids]), np.array([solid.pose for solid in solids])
    colour = np.round(255 * np.array([solid.color for solid in solids])).astype(np.uint8)
    centre, turn = pose[:, :3], pose[:, [4, 5, 6, 3]]
    radii, lengths = size[:, 0], size[:, 1]
    match shape:
        case "box":
            return rr.Boxes3D(sizes=size, centers=centre, quaternions=turn, colors=colour, fill_mode=_SOLID)
        case "sphere":
            return rr.Ellipsoids3D(radii=radii, centers=centre, colors=colour, fill_mode=_SOLID)
        case "cylinder":
            return rr.Cylinders3D(
                radii=radii, lengths=lengths, centers=centre, quaternions=turn, colors=colour, fill_mode=_SOLID
            )
        case "capsule":
            # Here a capsule's origin is the middle of its lower cap, not its own middle.
            low = centre - rotation_matrices(pose[:, 3:])[..., 2] * lengths[:, None] / 2
            return rr.Capsules3D(
                radii=radii, lengths=lengths, translations=low, quaternions=turn, colors=colour, fill_mode=_SOLID
            )
        case other:
            raise ValueError(f"no solid has the shape {other!r}")


def _log_contacts(to: _Recorder) -> None:
    """Forces as arrows, and who touches whom as a graph that is laid out like the tower."""
    episode, target = to.episode, to.episode.header.target
    contacts, at, frames = contact_points(episode), episode.time_ns, len(episode.time_ns)
    strong = np.linalg.norm(contacts.force, axis=1) > _FAINTEST
    on_target = (contacts.first == target) | (contacts.second == target)
    arrows = rr.Arrows3D.columns(
        origins=contacts.point[strong].astype(np.float32),
        vectors=(contacts.force[strong] * metres_per_newton(contacts.force)).astype(np.float32),
        colors=palette.rgba8(np.where(on_target[strong, None], palette.VERMILLION, palette.FORCE)),
    )
    to.static("/world/contacts", rr.Arrows3D.from_fields(radii=[0.0014]))
    to.columns("/world/contacts", at, arrows.partition(np.bincount(contacts.frame[strong], minlength=frames)))

    nodes = graph_nodes(episode, contacts)
    colours = np.tile(palette.UNKNOWN, (len(nodes.name), 1))
    colours[: len(episode.header.blocks)] = palette.wood(episode.header.layout.level)
    colours[target] = palette.SKY_BLUE  # the target's own blue is too dark for letters on black
    rgba, where = palette.rgba8(colours), nodes.position * _NODE
    to.static("/graph", rr.GraphNodes(nodes.name, positions=where, colors=rgba, labels=nodes.name))
    ends = np.array(nodes.name)[nodes.row[np.stack([contacts.first, contacts.second], axis=1)]]
    to.columns("/graph", at, rr.GraphEdges.columns(edges=ends).partition(contacts.counts(frames)))


def _log_model(to: _Recorder, number: int, label: str, prediction: Prediction) -> None:
    """One model's ghost, and the tower coloured by its error and by its chance of failure."""
    episode, path, size = to.episode, model_path(label), to.episode.header.blocks.size
    if len(prediction.frame):
        at, gone = episode.time_ns[prediction.frame], episode.time_ns[frames_without(episode, prediction)]
        colour = palette.rgba8(palette.model_colour(number))
        nowhere = np.array([np.nan, np.nan, np.nan, 1.0, 0.0, 0.0, 0.0])
        parts = (("ghost", others(episode), _WIRES), ("ghost/target", np.array([episode.header.target]), _TRANSLUCENT))
        for part, which, mode in parts:
            to.static(f"{path}/{part}", rr.Boxes3D(sizes=size[which] + _GHOST_MARGIN, colors=[colour], fill_mode=mode))
            to.boxes(f"{path}/{part}", at, prediction.pose[:, which])
            to.boxes(f"{path}/{part}", gone, np.tile(nowhere, (len(gone), len(which), 1)))
        error = position_error(episode, prediction)
        shown = palette.rgba8(palette.error_colours(error, error_scale(episode, prediction)))
        unknown = np.tile(palette.rgba8(palette.UNKNOWN), (len(gone), len(size), 1))
        to.static(f"{path}/error", rr.Boxes3D(sizes=size, fill_mode=_SOLID))
        to.boxes(f"{path}/error", episode.time_ns, episode.pose)
        for times, rgba in ((at, shown), (gone, unknown)):
            colours = rr.Boxes3D.columns(colors=rgba.reshape(-1, 4))
            to.columns(f"{path}/error", times, colours.partition(np.full(len(times), len(size))))
    if has_chances(prediction):
        chance = palette.rgba8(palette.probability_colours(prediction.failure_probability))
        to.static(f"{path}/chance", rr.Boxes3D(sizes=size, colors=chance, fill_mode=_SOLID))
        to.boxes(f"{path}/chance", episode.time_ns, episode.pose)


def _blueprint(episode: Episode, predictions: Sequence[Prediction]) -> rrb.Blueprint:
    """The layout: towers, graph and text above; phases and curves over one time axis below. No panel is empty."""
    stand, contacts = ["/world/turntable", "/world/table"], "/world/contacts"
    base = [*stand, "/world/edges"]
    tower = ["/world/tower", "/world/gripper", "/world/robot/**"]
    eye = _eye(episode)
    ghosts: list[str] = []
    coloured: list[rrb.Spatial3DView] = []
    for label, prediction in zip(model_labels(predictions), predictions, strict=True):
        if len(prediction.frame):
            ghosts.append(f"{model_path(label)}/ghost/**")
            coloured.append(_spatial(f"error, {label}", [*base, f"{model_path(label)}/error"], eye))
        if has_chances(prediction):
            coloured.append(_spatial(f"chance to fail, {prediction.name}", [*base, f"{model_path(label)}/chance"], eye))
    title = "tower, with ghosts of the models" if ghosts else "tower"
    above: list[rrb.Container | rrb.View] = [_spatial(title, [*base, *tower, *ghosts], eye)]
    if coloured:
        above.append(rrb.Tabs(contents=coloured))
    if any(len(touching.first) for touching in episode.contacts):
        above.append(_spatial("contact forces", [*stand, *tower, contacts], eye, _wires(episode)))
        highest = len(episode.header.layout.grid) - 0.3
        x, y = (-2.5 * _NODE[0], 2.5 * _NODE[0]), (highest * _NODE[1], -1.9 * _NODE[1])
        bounds = rrb.VisualBounds2D(x_range=x, y_range=y)
        above.append(rrb.GraphView(origin="/graph", name="contacts", visual_bounds=bounds))
    shares = [1.3 if isinstance(view, rrb.GraphView) else 2.5 for view in above]
    words = rrb.TextDocumentView(origin="/episode", name="episode")
    start, end = (rr.TimeRangeBoundary.absolute(seconds=s) for s in (0.0, float(seconds(episode)[-1])))
    whole = rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))
    rows: list[rrb.Container | rrb.View] = [rrb.Horizontal(*above, words, column_shares=[*shares, 1.9])]
    if episode.phases:
        rows.append(rrb.StateTimelineView(origin="/phase", name="phases", time_view=whole))
    rows.append(rrb.Horizontal(*_plots(episode_series(episode, predictions), whole)))
    return rrb.Blueprint(
        rrb.Vertical(*rows, row_shares=[5.4, *([0.85] if episode.phases else []), 3.6]),
        rrb.TimePanel(timeline=TIME, state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def _spatial(
    name: str, contents: list[str], eye: rrb.EyeControls3D, overrides: dict[Any, Any] | None = None
) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin="/", contents=contents, name=name, eye_controls=eye, line_grid=False, overrides=overrides or {}
    )


def _wires(episode: Episode) -> dict[Any, Any]:
    """What draws tower and robot by their edges only, so that arrows show."""
    kinds = {"box": rr.Boxes3D, "sphere": rr.Ellipsoids3D, "cylinder": rr.Cylinders3D, "capsule": rr.Capsules3D}
    colors = [palette.rgba8(palette.OUTLINE)]
    wires: dict[Any, Any] = {
        path: rr.Boxes3D.from_fields(fill_mode=_WIRES, colors=colors) for path in ("/world/tower", "/world/gripper")
    }
    for link in episode.header.robot.links if episode.header.robot else ():
        for shape in _shapes(link):
            wires[f"{_link_path(link)}/{shape}"] = kinds[shape].from_fields(fill_mode=_WIRES, colors=colors)
    return wires


def _eye(episode: Episode) -> rrb.EyeControls3D:
    """From where a view looks at first: at the tower from the side it is pulled to, at a robot and its tower from
    across, so that neither hides the other."""
    at, position = np.array([-0.06, 0.0, 0.125]), np.array([-0.43, -0.33, 0.26])
    if episode.robot is not None and episode.robot.link_pose.size:
        links = episode.robot.link_pose[0, :, :3]
        both = np.concatenate([links, episode.pose[0, :, :3]])
        low, high = both.min(axis=0), both.max(axis=0)
        way = episode.pose[0, :, :2].mean(axis=0) - links[:, :2].mean(axis=0)
        across = np.array([way[1], -way[0]]) / max(float(np.hypot(*way)), 1e-6)
        across *= -1.0 if across @ position[:2] < 0 else 1.0
        distance = _STEP_BACK * float(np.linalg.norm(high - low))
        at = (low + high) / 2
        position = at + distance * np.array([*across, 0.4])
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital, position=tuple(position), look_target=tuple(at), eye_up=(0, 0, 1)
    )


def _plots(found: Sequence[Series], whole: rrb.TimeAxis) -> list[rrb.Container | rrb.View]:
    """A view a plot, side by side; those of one tab behind each other, last."""
    plots: dict[tuple[str, str], list[Series]] = {}
    for series in found:
        plots.setdefault((series.tab, series.plot), []).append(series)
    views: list[rrb.Container | rrb.View] = []
    tabs: dict[str, list[rrb.View]] = {}
    for (tab, name), lines in plots.items():
        view = _curves(name, lines, whole)
        if tab:
            tabs.setdefault(tab, []).append(view)
        else:
            views.append(view)
    return views + [rrb.Tabs(contents=contents, name=tab) for tab, contents in tabs.items()]


def _curves(name: str, lines: list[Series], whole: rrb.TimeAxis) -> rrb.TimeSeriesView:
    values = np.concatenate([series.value.ravel() for series in lines])
    low, high = float(min(0.0, np.nanmin(values))), float(max(0.0, np.nanmax(values)))
    room = (high - low) or 1.0  # above the lines, for the legend
    return rrb.TimeSeriesView(
        origin="/",
        contents=[series.path for series in lines],
        name=name,
        axis_x=whole,
        axis_y=rrb.ScalarAxis(range=(low - 0.05 * room, high + 0.3 * room)),
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop),
    )
