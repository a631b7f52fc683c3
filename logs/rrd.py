"""Export of a flight for Rerun: vehicle, track and plots (``rerun-sdk``).

Rerun opens a log as it is, but draws no `foxglove.SceneUpdate`. Frames are those of `logs.scene`: ENU and FLU.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.extras import load_extra
from logs.info import vehicle
from logs.poses import Quaternion, Vector, tail_in_body, wing_in_body
from logs.reader import Log
from logs.scene import Shape, outlines
from logs.view.motion import Body, Motion, Wings, motion_of
from logs.view.page import shape_in
from logs.view.panels import PANELS, ROWS, WING_ANGLE, Panel, plotted
from logs.view.tables import Tables, read_tables
from logs.view.thinning import Envelope, thinned
from wingbeat.errors import InputError
from wingbeat.message import Event, Severity

Array = NDArray[np.float64]
Show = Callable[[float, float, str], None]
"""(done, total, what) for a progress bar"""
PLACE, TRACK, EVENTS = "/world/place", "/world/track", "/events"
BIRD = f"{PLACE}/bird"
"""frame of the vehicle's position without its rotation, which the camera follows"""
TIMELINE = "flight"
"""s since boot"""
COLORS = {
    "estimate": (25, 115, 190),
    "setpoint": (230, 160, 20),
    "truth": (60, 60, 65),
    "left": (215, 85, 25),
    "right": (25, 115, 190),
}
"""colors of the lines of a plot, by style"""
_PARTS = {"left_wing": (215, 85, 25), "right_wing": (25, 115, 190), "tail": (230, 180, 25)}
_LEVELS = {Severity.DEBUG: "DEBUG", Severity.NOTICE: "INFO", Severity.INFO: "INFO", Severity.WARNING: "WARN"}
EYE = (-2.0, -2.0, 1.0)
"""m; camera position relative to the vehicle in ENU"""
UPPER_PLOTS = 6
"""number of plots in the first of two tabs"""


class _Stream(NamedTuple):
    """Rerun recording stream in memory."""

    sdk: Any
    recording: Any

    def log_static(self, entity: str, what: Any) -> None:
        """Log data that are valid at all times."""
        self.recording.log(entity, what, static=True, strict=True)

    def moving(self, entity: str, time: Array, columns: Any) -> None:
        """Log rows at times (s since boot)."""
        if len(time):
            stamps = np.rint(time * 1e9).astype("timedelta64[ns]")
            self.recording.send_columns(
                entity, [self.sdk.TimeColumn(TIMELINE, duration=stamps)], columns, strict=True
            )


def encode_rrd(log: Log, show: Show = lambda done, total, what: None) -> bytes:
    """Encode a flight as a Rerun file with its own layout.

    Raises:
        InputError: rerun-sdk is not installed, or a part of the log is damaged or has nothing to show.
    """
    sdk = load_extra("rerun", "rerun-sdk", "a recording of Rerun's")
    tables = read_tables(log, lambda done, note: show(0.5 * done, 1.0, note))
    events = log.events()
    if not tables and not events:
        raise InputError(f"{log.path} has no topics to show, such as /attitude/ahrs")
    recording = sdk.RecordingStream("wingbeat", recording_id=f"{log.path.stem}-{log.start_ns}")
    kept = recording.memory_recording()
    recording.send_recording_name(f"{vehicle(log) or 'unknown vehicle'}, {log.path.name}")
    show(0.5, 1.0, "drawing")
    stream, motion = _Stream(sdk, recording), motion_of(tables)
    _draw(stream, motion, shape_in(log)[0])
    titles = [panel.title for panel in PANELS if _plot(stream, panel, tables, motion)]
    _log_events(stream, events)
    recording.send_blueprint(_layout(sdk, titles, motion.body is not None))
    return bytes(kept.drain_as_bytes())


# --- the bird -------------------------------------------------------------------------------------------------


def _draw(stream: _Stream, motion: Motion, shape: Shape) -> None:
    stream.log_static("/world", stream.sdk.ViewCoordinates.RIGHT_HAND_Z_UP)
    body = motion.body
    if body is None:
        return
    _draw_track(stream, TRACK, body.place, (50, 180, 80))
    if motion.estimated is not None:
        _draw_track(stream, f"{TRACK}/estimated", motion.estimated[1], (150, 150, 150))
    stream.moving(PLACE, body.time, stream.sdk.Transform3D.columns(translation=body.place.T))
    _move(stream, BIRD, body.time, (0.0, 0.0, 0.0), body.quaternion.T)
    _draw_parts(stream, shape)
    tail = [tail_in_body(*angles) for angles in body.tail.T.tolist()]
    _move(stream, f"{BIRD}/tail", body.time, shape.tail, tail)
    _draw_wings(stream, motion.wings or _at_rest(body), shape)


def _at_rest(body: Body) -> Wings:
    return Wings(body.time[:1], np.zeros((2, 1)), np.zeros((2, 1)))


def _draw_wings(stream: _Stream, wings: Wings, shape: Shape) -> None:
    x, y, z = shape.hinge
    for row, (name, side) in enumerate((("left_wing", 1), ("right_wing", -1))):
        angles = zip(wings.flap[row].tolist(), wings.twist[row].tolist(), strict=True)
        turned = [wing_in_body(flap, twist, side) for flap, twist in angles]
        _move(stream, f"{BIRD}/{name}", wings.time, (x, side * y, z), turned)


def _draw_track(stream: _Stream, entity: str, place: Array, color: Vector) -> None:
    stream.log_static(entity, stream.sdk.LineStrips3D([place.T], colors=[color]))


def _draw_parts(stream: _Stream, shape: Shape) -> None:
    length = shape.nose - shape.tail[0]
    middle, half = (
        (0.5 * (shape.nose + shape.tail[0]), 0.0, 0.0),
        (0.5 * length, 0.8 * shape.body_radius, shape.body_radius),
    )
    fuselage = stream.sdk.Boxes3D(centers=[middle], half_sizes=[half], colors=[(65, 65, 70)], fill_mode="solid")
    stream.log_static(f"{BIRD}/fuselage", fuselage)
    for name, plates in outlines(shape).items():
        corners = np.array(plates).reshape(-1, 3)
        triangles = [[4 * n, 4 * n + i, 4 * n + i + 1] for n in range(len(plates)) for i in (1, 2)]
        colors = [_PARTS[name]] * len(corners)
        mesh = stream.sdk.Mesh3D(vertex_positions=corners, triangle_indices=triangles, vertex_colors=colors)
        stream.log_static(f"{BIRD}/{name}", mesh)


def _move(
    stream: _Stream, entity: str, time: Array, place: Vector, quaternions: Array | Iterable[Quaternion]
) -> None:
    """Log a rotating frame at a position (m): quaternions (w, x, y, z) at times (s), converted to xyzw."""
    turned = np.asarray(list(quaternions))[:, [1, 2, 3, 0]]
    # Both in every row: a value that is omitted is not kept from the previous row.
    places = np.tile(place, (len(time), 1))
    stream.moving(entity, time, stream.sdk.Transform3D.columns(translation=places, quaternion=turned))


# --- plots and events -----------------------------------------------------------------------------------------


def _plot(stream: _Stream, panel: Panel, tables: Tables, motion: Motion) -> bool:
    """Log the lines of a panel; return whether it has any."""
    lines = list(_wing_lines(motion) if panel.title == WING_ANGLE else _panel_lines(panel, tables))
    for name, style, time, values in lines:
        entity = f"{_entity(panel.title)}/{name.replace(' ', '_')}"
        stream.log_static(entity, stream.sdk.SeriesLines(colors=[COLORS[style]], names=[name]))
        stream.moving(entity, time, stream.sdk.Scalars.columns(scalars=panel.factor * values))
    return bool(lines)


def _panel_lines(panel: Panel, tables: Tables) -> Iterator[tuple[str, str, Array, Array]]:
    """Yield name, style, times (s) and values of each line that the log has."""
    for line in panel.lines:
        table = plotted(tables, line.topic.name)
        if table is not None and line.field in table.fields:
            envelope = thinned(table.time, {line.field: table.fields[line.field]}, ROWS)
            yield line.name, line.style, *_both_sides(envelope, line.field)


def _both_sides(envelope: Envelope, field: str) -> tuple[Array, Array]:
    """Return times and values; a row that stands for several samples yields their minimum and maximum."""
    if envelope.high is None:
        return envelope.time, envelope.low[field]
    sides = np.column_stack((envelope.low[field], envelope.high[field]))
    return np.repeat(envelope.time, 2), sides.ravel()


def _wing_lines(motion: Motion) -> Iterator[tuple[str, str, Array, Array]]:
    if motion.wings is not None:
        for side, flap in zip(("left", "right"), motion.wings.flap, strict=True):
            yield side, side, motion.wings.time, flap


def _log_events(stream: _Stream, events: list[Event]) -> None:
    levels = [_LEVELS.get(Severity(event.severity), "ERROR") for event in events]
    texts = [f"{event.source}: {event.text}" for event in events]
    time = np.array([event.time_us * 1e-6 for event in events])
    if events:
        stream.moving(EVENTS, time, stream.sdk.TextLog.columns(text=texts, level=levels))


# --- the window ---------------------------------------------------------------------------------------------


def _entity(title: str) -> str:
    return f"/{title.lower().replace(' ', '_')}"


def _layout(sdk: Any, titles: list[str], bird: bool) -> Any:
    """Return the layout: vehicle above events, plots beside them in two tabs."""
    part = sdk.blueprint
    units = {panel.title: panel.unit for panel in PANELS}
    plots = [part.TimeSeriesView(origin=_entity(title), name=f"{title} [{units[title]}]") for title in titles]
    halves = (plots[:UPPER_PLOTS], "Plots"), (plots[UPPER_PLOTS:], "More plots")
    tabs = [part.Vertical(*some, name=name) for some, name in halves if some]
    said = part.TextLogView(origin=EVENTS, name="Events")
    left = part.Vertical(part.Tabs(*_spaces(part)), said, row_shares=[4, 1]) if bird else said
    whole = part.Horizontal(left, part.Tabs(*tabs), column_shares=[3, 2]) if tabs else left
    return part.Blueprint(whole, collapse_panels=True)


def _spaces(part: Any) -> list[Any]:
    """Return the view of the vehicle from nearby and the view of the whole track."""
    eye = part.EyeControls3D(position=EYE, look_target=(0.0, 0.0, 0.0), eye_up=(0.0, 0.0, 1.0))
    near = part.Spatial3DView(origin=PLACE, contents="/world/**", name="Bird", eye_controls=eye)
    return [near, part.Spatial3DView(origin="/world", name="Track")]
