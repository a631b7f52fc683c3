"""The panels of the monitor: pure functions of a `Picture`, ``columns`` wide and, where it matters, ``rows`` high."""

from __future__ import annotations

import math

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from avionics.link.dialect import mavlink
from avionics.messages import Stage
from groundstation.link import modes
from groundstation.link.station import Picture
from groundstation.link.vehicle_state import VehicleState
from groundstation.views import braille, wording
from groundstation.views.flight_view import bar
from groundstation.views.mission import item_view
from wingbeat.message import Severity

LABEL = "#8794a2"
VALUE = "bold #e6ebf0"
FAINT = "#5b6672"
GOOD = "#6cc26c"
CAUTION = "#ffcc33"
BAD = "bold #ff6b5e"
TRACE = "#5fc8d8"
SILENT_AFTER = 3.0
"""s; without a message, after which a view shows a link loss"""
FIXES = {0: "no GPS", 1: "no fix", 2: "2D fix", 3: "3D fix", 4: "DGPS", 5: "RTK float", 6: "RTK fix"}


def status_line(picture: Picture, columns: int) -> Text:
    """Format vehicle, mode and flight stage on one line."""
    state = picture.state
    line = Text(no_wrap=True, end="", overflow="ellipsis")
    line.append(f" {vehicle_name(state) or picture.url} ", style="bold #0b0e12 on #5fc8d8")
    if state.armed is not None:
        text, style = (" ARMED ", "bold #ffffff on #c8372d") if state.armed else (" disarmed ", f"{VALUE} on #37414b")
        line.append(text, style=style)
    line.append(f"  {modes.mode_name(state)}", style="bold #5fc8d8")
    if state.stage is not None:
        line.append(f"  {wording.words(Stage(state.stage).name)}", style=VALUE)
    if state.exciting:
        line.append("  excitation", style="bold #d16ad1")
    note, style = _link_note(picture)
    if picture.busy:
        note, style = f"{picture.busy} …", CAUTION
    right = Text(note, style=style)
    right.append(f"   {wording.clock(state.time)} ", style=VALUE)
    line.truncate(max(columns - right.cell_len - 1, 1), overflow="ellipsis")
    line.append(" " * max(columns - line.cell_len - right.cell_len, 1))
    return line.append_text(right)


def _link_note(picture: Picture) -> tuple[str, str]:
    if picture.silence is None:
        return f"waiting for a vehicle on {picture.url}", CAUTION
    if picture.silence > SILENT_AFTER:
        return f"no telemetry for {picture.silence:.0f} s", BAD
    return _fix(picture.state), LABEL


def _fix(state: VehicleState) -> str:
    if state.fix_type is None:
        return ""
    satellites = "" if state.satellites is None else f" {state.satellites} sat"
    return FIXES.get(state.fix_type, "GPS fix") + satellites


def vehicle_name(state: VehicleState) -> str:
    """Return type and number of a vehicle, such as ``flapping wing 1``; empty before its heartbeat.

    A Wingbeat vehicle is one, also where its heartbeat reports a fixed wing for the sake of other stations.
    """
    if state.system is None:
        return ""
    kind = mavlink.MAV_TYPE_FLAPPING_WING if state.is_wingbeat else state.vehicle_type
    return f"{modes.type_name(kind)} {state.system}"


def _rows(columns: int, *rows: tuple[str, Text | str]) -> Table:
    table = Table.grid(padding=(0, 1), expand=True)
    table.add_column(style=LABEL, width=9, no_wrap=True)
    table.add_column(style=VALUE, no_wrap=True, overflow="ellipsis", width=max(columns - 10, 1))
    for label, value in rows:
        table.add_row(label, value)
    return table


def _pair(value: str, adjacent: str) -> Text:
    return Text(value, style=VALUE).append(f"  {adjacent}" if adjacent else "", style=FAINT)


def _fitting(columns: int, value: str, *besides: str) -> str:
    """Return the first of several texts that fits beside a value, else the last."""
    width = columns - 10 - len(value) - 2
    return next((adjacent for adjacent in besides if len(adjacent) <= width), besides[-1])


# --- flapping -------------------------------------------------------------------------------------------


def flapping(picture: Picture, columns: int, rows: int) -> RenderableType:
    """Draw the wings from behind, the phase of the stroke, and the flapping frequency."""
    state = picture.state
    amplitude = "" if not state.flap_amplitude else f"±{wording.angle(state.flap_amplitude, '.0f')}"
    table = _rows(
        columns,
        ("flapping", _pair(wording.number(state.flap_frequency, ".2f", "Hz"), amplitude)),
        ("phase", _phase(state, columns - 10)),
        ("throttle", _pair(f"{wording.percent(state.throttle):>5}", bar(state.throttle, max(columns - 19, 4)))),
    )
    height = rows - 3
    return Group(wings(state, columns, height), table) if height >= 3 else table


def _phase(state: VehicleState, columns: int) -> Text:
    """Draw one stroke from its middle, wing moving up, with a mark at the present phase."""
    if state.flap_phase is None or not math.isfinite(state.flap_phase) or not state.flap_frequency:
        return Text(wording.UNKNOWN)
    stroke = "⣀⡠⠔⠒⠊⠉⠉⠑⠒⠢⢄⣀"
    cells = min(columns - 6, 2 * len(stroke))
    share = state.flap_phase / math.tau % 1.0
    # The drawing begins a quarter of a stroke before the upward crossing, at the lowest point.
    place = int((share + 0.25) % 1.0 * cells)
    text = Text(no_wrap=True)
    for cell in range(cells):
        here = cell == place
        text.append("●" if here else stroke[cell * len(stroke) // cells], style=CAUTION if here else FAINT)
    return text.append(f" {math.degrees(state.flap_phase) % 360:3.0f}°", style=VALUE)


def wings(state: VehicleState, columns: int, rows: int) -> Text:
    """Draw both wings from behind at their angles."""
    text = Text(no_wrap=True, justify="center")
    if state.flap_left is None or state.flap_right is None:
        return text.append("\n" * (rows // 2) + "no wing angles" + "\n" * (rows - rows // 2 - 1), style=FAINT)
    width = min(columns, 6 * rows)
    half = 0.5 * width
    lines = [[(0.0, 0.0), _tip(-1.0, state.flap_left)], [(0.0, 0.0), _tip(1.0, state.flap_right)]]
    reach = 1.05
    window = braille.Window(-reach, reach, -reach * 2 * rows / width, reach * 2 * rows / width)
    for row, line in enumerate(braille.draw(lines, window, width, rows)):
        if row == rows // 2:
            line = line[: int(half)] + "◆" + line[int(half) + 1 :]
        text.append(line, style=TRACE).append("\n" if row < rows - 1 else "")
    return text


def _tip(side: float, angle: float) -> tuple[float, float]:
    return side * math.cos(angle), math.sin(angle)


# --- power ----------------------------------------------------------------------------------------------


def power(picture: Picture, columns: int, rows: int) -> RenderableType:
    """Show battery, supply and power of the wings."""
    state = picture.state
    share = state.battery_remaining
    style = GOOD if share is None or share > 0.4 else CAUTION if share > 0.2 else BAD
    battery = Text(f"{wording.percent(share):>5}", style=VALUE)
    battery.append(f"  {bar(share, max(columns - 19, 4))}", style=style)
    supply = _pair(wording.number(state.voltage, ".2f", "V"), wording.number(state.current, ".2f", "A"))
    watts = wording.number(state.power, ".1f", "W")
    return _rows(
        columns,
        ("battery", battery),
        ("supply", supply),
        ("power", _pair(watts, _kind(columns, watts, state.energy, state.mean_supply))),
    )


def _kind(columns: int, watts: str, energy: float | None, means: bool) -> str:
    """Return the text beside the power: whether power, current and voltage are means, and the energy (J)."""
    if energy is None:
        return ""
    hours = f"{energy / 3600.0:.2f} Wh"
    if not means:
        return _fitting(columns, watts, f"{hours} drawn", hours, "")
    return _fitting(columns, watts, f"mean  {hours} drawn", f"mean  {hours}", "mean")


# --- link -----------------------------------------------------------------------------------------------


def link(picture: Picture, columns: int, rows: int) -> RenderableType:
    """Show loss, rate and latency of the link, and the path of the recording."""
    quality = picture.quality
    loss = quality.loss
    style = VALUE if loss is None else GOOD if loss < 0.02 else CAUTION if loss < 0.1 else BAD
    share = wording.UNKNOWN if loss is None else f"{100.0 * loss:.1f} %"
    counts = (f"{quality.lost} of {quality.lost + quality.received} lost", f"{quality.lost} lost")
    lost = Text(share, style=style).append(f"  {_fitting(columns, share, *counts)}", style=FAINT)
    rate, frames = _rate(quality.bytes_per_s), f"{quality.messages_per_s:.0f}"
    latency = None if quality.latency is None else 1e3 * quality.latency
    kept = "not recorded" if picture.recording is None else f"● {_end(picture.recording.name, columns - 13)}"
    return _rows(
        columns,
        ("loss", lost),
        ("rate", _pair(rate, _fitting(columns, rate, f"{frames} messages/s", f"{frames} /s"))),
        ("latency", _pair(wording.number(latency, ".0f" if (latency or 0.0) >= 10.0 else ".1f", "ms"), "")),
        ("log", Text(kept, style=FAINT if picture.recording is None else BAD)),
    )


def _end(name: str, columns: int) -> str:
    """Return the end of a file's name, which has its time."""
    return name if len(name) <= columns else f"…{name[-max(columns - 1, 1) :]}"


def _rate(bytes_per_s: float) -> str:
    return f"{bytes_per_s / 1e3:.1f} kB/s" if bytes_per_s >= 1e3 else f"{bytes_per_s:.0f} B/s"


# --- mission --------------------------------------------------------------------------------------------


def mission(picture: Picture, columns: int, rows: int) -> RenderableType:
    """Show the progress of the mission: present item, adjacent ones, and the distance to its position."""
    state = picture.state
    count = len(picture.mission) or state.items
    number = state.item
    done = None if number is None or not count else min((number + 1) / count, 1.0)
    # ArduPilot's list begins with home, and items are counted from it.
    title = wording.UNKNOWN if number is None else f"{number}" if not count else f"{number} of {count - 1}"
    item = _pair(f"{title:>7}", bar(done, max(columns - 21, 4)))
    to_go = wording.number(state.distance, ".0f", "m to go") if state.distance else ""
    height = wording.number(state.altitude_setpoint, ".0f", "m")
    bearing = wording.bearing(state.heading_setpoint)
    at_height = f"at {height}" if state.altitude_setpoint else ""
    both = "  ".join(part for part in (at_height, to_go) if part)
    away = None if state.north is None or state.east is None else math.hypot(state.north, state.east)
    home = wording.number(away, ".0f", "m")
    table = _rows(
        columns,
        ("item", item),
        # The altitude setpoint is on the altitude tape, too.
        ("course", _pair(bearing, _fitting(columns, bearing, both, to_go or at_height))),
        ("home", _pair(home, _over_ground(state, columns, home))),
    )
    lines = rows - 3
    return Group(table, _items(picture, columns, lines)) if lines > 0 and picture.mission else table


def _over_ground(state: VehicleState, columns: int, home: str) -> str:
    if state.groundspeed is None:
        return ""
    speed = f"{state.groundspeed:.1f} m/s"
    return _fitting(columns, home, f"{speed} over ground", f"GS {speed}")


def _items(picture: Picture, columns: int, rows: int) -> Text:
    """Show the items around the present one."""
    flown = picture.state.item or 0
    first = max(min(flown - 1, len(picture.mission) - rows), 0)
    text = Text(no_wrap=True, overflow="ellipsis")
    for number, item in list(enumerate(picture.mission))[first : first + rows]:
        here = number == picture.state.item
        said = item_view(item)
        height = "" if said.altitude is None else f"  {said.altitude:g} m"
        line = f"{'▶' if here else ' '} {number:2d} {said.does}{height}"
        text.append(f"{line[:columns]}\n", style=VALUE if here else FAINT)
    return text


# --- status texts ---------------------------------------------------------------------------------------

STYLES = {
    Severity.WARNING: CAUTION,
    Severity.NOTICE: "#e6ebf0",
    Severity.INFO: "#aab4c0",
    Severity.DEBUG: FAINT,
}


def sayings(picture: Picture, columns: int, rows: int) -> Text:
    """Show messages of the vehicle and results of commands, the newest below."""
    said = [
        (heard.time, _word(heard.severity), heard.text, STYLES.get(heard.severity, BAD))
        for heard in picture.state.events
    ]
    noted = [(note.time, "gcs", note.text, BAD if note.failed else GOOD) for note in picture.notes]
    lines = sorted(said + noted, key=lambda line: -math.inf if line[0] is None else line[0])
    text = Text(no_wrap=True, overflow="ellipsis", end="")
    for number, (at, who, words, style) in enumerate(lines[-rows:]):
        line = Text(f" {wording.clock(at):>7} ", style=FAINT)
        line.append(f"{who:<9} ", style=style).append(words, style=style)
        line.truncate(columns, overflow="ellipsis")
        text.append("\n" if number else "").append_text(line)
    return text if lines else text.append(" nothing was said yet", style=FAINT)


def _word(severity: Severity) -> str:
    return Severity(severity).name.lower()


# --- numbers under the horizon --------------------------------------------------------------------------


def heading(picture: Picture, columns: int) -> Text:
    """Show heading, roll, pitch and climb rate on one line."""
    state = picture.state
    climb = state.climb_rate
    arrow = "" if climb is None or not math.isfinite(climb) else "↑ " if climb > 0.1 else "↓ " if climb < -0.1 else ""
    line = Text(justify="center", no_wrap=True, end="")
    named = columns >= 56
    for label, value in (
        ("heading", f"{wording.bearing(state.yaw)} {wording.compass_point(state.yaw)}".rstrip()),
        ("roll", wording.angle(state.roll)),
        ("pitch", wording.angle(state.pitch)),
        ("climb", arrow + wording.number(climb, "+z.1f", "m/s")),
    ):
        line.append(f" {label} " if named or label in ("roll", "pitch") else " ", style=LABEL)
        line.append(f"{value} ", style=VALUE)
    return line
