"""Flight view on the terminal: state, altitude, track, messages.

`render` is a pure function of what is known; `fly` and `gcs monitor` show it with rich's Live.
"""

from __future__ import annotations

from typing import NamedTuple

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from avionics.messages import Stage
from groundstation.link.vehicle_state import StatusLine, VehicleState
from groundstation.views import braille, wording
from groundstation.views.history import History
from wingbeat.message import Severity

PLOT_ROWS = 7
"""minimum of the plots"""
EVENTS_SHOWN = 6
"""minimum of the messages"""
FIXED_ROWS = 10
"""title, rule, numbers, time axis, blank lines, and the line of the cursor"""
LABEL = "dim"
QUIET = "dim"
TRACE = "cyan"


class Header(NamedTuple):
    """Header line besides the telemetry."""

    title: str
    """-; the vehicle's name, or the link"""
    mode: str = ""
    """-; name of the mode"""
    note: str = ""
    """-; such as the speed factor or the duration of a link loss"""
    alarm: bool = False
    """-; True if the note is a warning"""


class FlightView(NamedTuple):
    """Data of the view; a rich renderable that fills the terminal."""

    header: Header
    state: VehicleState
    history: History | None
    """None omits the plots"""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield render(self, options.max_width, console.height)


def render(view: FlightView, width: int, height: int) -> RenderableType:
    """Render ``width`` characters and at most ``height`` lines; below a width of 60 the plots are omitted."""
    free = height - FIXED_ROWS
    event_rows = max(EVENTS_SHOWN, free // 4)
    parts: list[RenderableType] = [_title(view, width), Rule(style=QUIET), _numbers(view.state, width)]
    if width >= 60 and view.history is not None:
        parts += [Text(), _plots(view.history, width, max(free - event_rows, PLOT_ROWS))]
    if view.state.events:
        parts += [Text(), *(_event(status_texts, width) for status_texts in view.state.events[-event_rows:])]
    return Group(*parts)


def _title(view: FlightView, width: int) -> RenderableType:
    state = view.state
    line = Table.grid(expand=True)
    line.add_column()
    line.add_column(justify="right")
    left = Text(view.header.title, style="bold")
    if view.header.mode:
        left.append(f"   {view.header.mode}", style="bold cyan")
    if state.stage is not None:
        left.append(f"  {wording.words(Stage(state.stage).name)}")
    if state.armed is not None and width >= 90:
        left.append("   armed" if state.armed else "   disarmed", style="green" if state.armed else QUIET)
    if state.exciting:
        left.append("   excitation", style="magenta")
    right = Text(view.header.note, style="yellow" if view.header.alarm else QUIET)
    right.append(f"   {wording.clock(state.time)}", style="bold")
    line.add_row(left, right)
    return line


def _numbers(state: VehicleState, width: int) -> RenderableType:
    """Format three groups side by side, or stacked on a narrow terminal, with constant widths."""
    groups = (_position(state), _attitude(state), _drive(state))
    abreast = width >= 60
    room = min((width if abreast else 3 * width) // 3 - 20, 40)
    table = Table.grid(padding=(0, 1))
    for _ in groups if abreast else groups[:1]:
        table.add_column(style=LABEL, width=8)
        table.add_column(justify="right", width=9)
        table.add_column(style=QUIET, width=max(room, 1), no_wrap=True)
    for row in zip(*groups, strict=True) if abreast else ((line,) for group in groups for line in group):
        table.add_row(*(cell for line in row for cell in (line[0], line[1], line[2] if len(line[2]) <= room else "")))
    return table


Row = tuple[str, str, str]


def _position(state: VehicleState) -> list[Row]:
    wanted = "" if state.altitude_setpoint is None else f"→ {state.altitude_setpoint:.0f} m"
    home = ""
    if state.north is not None and state.east is not None:
        home = wording.number((state.north**2 + state.east**2) ** 0.5, ".0f", "m").replace(" ", "\u00a0")
        home = f"home {home}"
    return [
        ("altitude", wording.number(state.altitude, "z.1f", "m"), wanted),
        ("climb", wording.number(state.climb_rate, "+z.1f", "m/s"), ""),
        ("airspeed", wording.number(state.airspeed, ".1f", "m/s"), home),
        (
            "waypoint",
            wording.number(state.item, "d"),
            wording.number(state.distance, ".0f", "m to go") if state.distance else "",
        ),
    ]


def _attitude(state: VehicleState) -> list[Row]:
    course = "" if state.heading_setpoint is None else f"→ {wording.bearing(state.heading_setpoint)}"
    gps = "" if state.satellites is None else f"{state.satellites} satellites"
    return [
        ("roll", wording.angle(state.roll), ""),
        ("pitch", wording.angle(state.pitch), ""),
        ("heading", wording.bearing(state.yaw), course or wording.compass_point(state.yaw)),
        ("ground", wording.number(state.groundspeed, ".1f", "m/s"), gps),
    ]


def _drive(state: VehicleState) -> list[Row]:
    supply = ""
    if state.voltage is not None and state.current is not None:
        supply = f"{wording.number(state.voltage, '.2f', 'V')} {wording.number(state.current, '.2f', 'A')}"
    stroke = "" if not state.flap_amplitude else f"±{wording.angle(state.flap_amplitude, '.0f')}"
    return [
        ("flapping", wording.number(state.flap_frequency, ".2f", "Hz"), stroke),
        ("throttle", wording.percent(state.throttle), bar(state.throttle, 10)),
        ("power", wording.number(state.power, ".1f", "W"), supply),
        ("battery", wording.percent(state.battery_remaining), bar(state.battery_remaining, 10)),
    ]


def bar(share: float | None, cells: int) -> str:
    """Draw a fraction of 0 to 1 as a thin bar."""
    if share is None or share != share:
        return ""
    full = round(min(max(share, 0.0), 1.0) * cells)
    return "━" * full + "╌" * (cells - full)


def _plots(history: History, width: int, rows: int) -> RenderableType:
    track_columns = min(2 * rows, width // 2 - 10)
    table = Table.grid(padding=(0, 2))
    table.add_row(_altitude_plot(history, width - track_columns - 14, rows), track_plot(history, track_columns, rows))
    return table


def _altitude_plot(history: History, columns: int, rows: int) -> Text:
    points = history.altitude
    highest, lowest = (pick((altitude for _, altitude in points), default=0.0) for pick in (max, min))
    top, bottom = braille.round_up(max(1.05 * highest, 5.0)), -braille.round_up(-lowest) if lowest < -1.0 else 0.0
    start = points[0][0] if points else 0.0
    end = max(points[-1][0] if points else 0.0, start + 10.0)
    lines = braille.draw([points] if points else [], braille.Window(start, end, bottom, top), columns, rows)
    text = Text()
    for row, line in enumerate(lines):
        label = f"{top:.4g} m" if row == 0 else f"{bottom:.0f} m" if row == rows - 1 else ""
        text.append(f"{label:>7} ", style=LABEL).append("│", style=QUIET).append(line, style=TRACE).append("\n")
    left, right = f"{start:.0f} s", f"{end:.0f} s"
    text.append(f"{'':8}└{left}{'─' * max(columns - len(left) - len(right), 1)}{right}", style=QUIET)
    return text


def track_plot(history: History, columns: int, rows: int) -> Text:
    """Draw the track from above, north up, with equal scales; a mark shows home."""
    track = history.track
    east = [0.0, *(point[0] for point in track)]
    north = [0.0, *(point[1] for point in track)]
    # A cell is twice as high as wide.
    aspect = columns / (2 * rows)
    half = 0.55 * max((max(east) - min(east)) / aspect, max(north) - min(north), 20.0)
    middle = (0.5 * (max(east) + min(east)), 0.5 * (max(north) + min(north)))
    across = half * aspect
    window = braille.Window(middle[0] - across, middle[0] + across, middle[1] - half, middle[1] + half)
    lines = [list(line) for line in braille.draw([track] if track else [], window, columns, rows)]
    home_column = round((0.0 - window.left) / (2 * across) * (columns - 1))
    home_row = round((window.top - 0.0) / (2 * half) * (rows - 1))
    text = Text(no_wrap=True)
    for row, line in enumerate(lines):
        for column, cell in enumerate(line):
            home = (row, column) == (home_row, home_column)
            text.append("⌂" if home else cell, style="bold" if home else TRACE)
        text.append("\n")
    text.append(f"north up, {2 * half:.0f} m", style=QUIET)
    return text


SEVERITY_STYLE = {Severity.WARNING: "yellow", Severity.NOTICE: "", Severity.INFO: QUIET, Severity.DEBUG: QUIET}


def _event(status_texts: StatusLine, width: int) -> Text:
    style = SEVERITY_STYLE.get(status_texts.severity, "red")
    line = Text(f"  {wording.clock(status_texts.time)}  ", style=QUIET)
    line.append(status_texts.text, style=style)
    line.truncate(width, overflow="ellipsis")
    return line


def progress_line(state: VehicleState, mode: str) -> str:
    """Format the flight state on one plain line, without a terminal."""
    stage = "" if state.stage is None else wording.words(Stage(state.stage).name)
    item = "" if state.item is None else f"waypoint {state.item}"
    parts = (
        f"{wording.number(state.time, '6.1f', 's')}",
        f"{mode:<13} {stage:<10}",
        f"altitude {wording.number(state.altitude, 'z5.1f', 'm')}",
        f"airspeed {wording.number(state.airspeed, '4.1f', 'm/s')}",
        f"heading {wording.bearing(state.yaw)}",
        f"flapping {wording.number(state.flap_frequency, '4.2f', 'Hz')}",
        f"power {wording.number(state.power, '4.1f', 'W')}",
        item,
    )
    return "  ".join(part for part in parts if part.strip()).rstrip()


def event_line(status_texts: StatusLine) -> str:
    """Format a STATUSTEXT on one plain line."""
    return f"{wording.number(status_texts.time, '6.1f', 's')}  {wording.one_line(status_texts.text)}"
