"""Joystick deflections as bars, line or JSON object."""

from __future__ import annotations

from typing import Any

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from groundstation.joystick.control import ControlStatus, DeviceState
from groundstation.joystick.device import DeviceInfo
from groundstation.link import modes
from groundstation.link.station import Picture, Station, new_notes
from groundstation.views.json_document import print_line
from groundstation.views.monitor import LINE_EVERY, link_note
from groundstation.views.panels import BAD, CAUTION, FAINT, GOOD, LABEL, SILENT_AFTER, VALUE
from groundstation.views.terminal import open_console

STATE_TEXTS = {
    DeviceState.ACTIVE: "sticks are sent",
    DeviceState.WAITING: "move the throttle to start: nothing is sent yet",
    DeviceState.DISCONNECTED: "disconnected: no sticks are sent",
}
STATE_STYLES = {DeviceState.ACTIVE: GOOD, DeviceState.WAITING: CAUTION, DeviceState.DISCONNECTED: BAD}
MIN_BAR = 5
"""characters; shortest bar"""


def stick_bars(status: ControlStatus, picture: Picture, columns: int) -> RenderableType:
    """Draw device and link on one line, and the sticks below in two rows of two bars."""
    head = Text(f"{STATE_TEXTS[status.state]}  ", style=STATE_STYLES[status.state], no_wrap=True, end="")
    head.append(status.device, style=VALUE)
    link = Text(f"  {_link_text(picture)}", style=LABEL)
    head.truncate(max(columns - link.cell_len, 1), overflow="ellipsis", pad=True)
    head.append_text(link)
    table = Table.grid(padding=(0, 1))
    table.add_row(head)
    sticks = status.sticks
    cells = max(columns // 2 - 19, MIN_BAR)
    for pair in (("yaw", "throttle"), ("roll", "pitch")):
        row = Text(no_wrap=True, end="")
        for name in pair:
            value = None if sticks is None else float(getattr(sticks, name))
            row.append(f"{name:<9}", style=LABEL)
            row.append(centered_bar(value, cells) if name != "throttle" else _bar(value, cells), style=GOOD)
            row.append(f"{_percent(value):>7}  ", style=VALUE if value is not None else FAINT)
        table.add_row(row)
    return table


def _link_text(picture: Picture) -> str:
    if picture.silence is None:
        return "no vehicle"
    if picture.silence > SILENT_AFTER:
        return f"no telemetry for {picture.silence:.0f} s"
    return link_note(picture.quality)


def centered_bar(value: float | None, cells: int) -> str:
    """Draw a deflection from -1 to 1 as a bar from the center, with an odd number of cells up to ``cells``."""
    half = max(cells - 1, 0) // 2
    filled = 0 if value is None else round(min(abs(value), 1.0) * half)
    full, rest = "━" * filled, "╌" * (half - filled)
    negative = value is not None and value < 0.0
    left, right = (rest + full, "╌" * half) if negative else ("╌" * half, full + rest)
    return f"{left}┼{right}"


def _bar(value: float | None, cells: int) -> str:
    width = 2 * (max(cells - 1, 0) // 2) + 1
    filled = 0 if value is None else round(min(max(value, 0.0), 1.0) * width)
    return "━" * filled + "╌" * (width - filled)


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100.0 * value:.0f} %"


def control_line(status: ControlStatus, station: Station) -> str:
    """Describe sticks, mode and link in one line."""
    state, silence = station.connection.state, station.picture().silence
    armed = "" if state.armed is None else "armed" if state.armed else "disarmed"
    link = "no vehicle" if silence is None else f"link {silence:.1f} s ago"
    vehicle = f"{modes.mode_name(state)} {armed}".strip()
    if status.sticks is None:
        return f"{vehicle}  {link}  joystick {STATE_TEXTS[status.state]}"
    values = "  ".join(f"{name} {_percent(value)}" for name, value in status.sticks._asdict().items())
    return f"{vehicle}  {link}  {values}"


def control_record(status: ControlStatus, station: Station) -> dict[str, Any]:
    """Return sticks, mode and link as a JSON object."""
    state = station.connection.state
    sticks = None if status.sticks is None else status.sticks._asdict()
    return {
        "time": state.time,
        "device": status.device,
        "state": str(status.state),
        "sticks": sticks,
        "sent": status.sent,
        "mode": modes.mode_key(state),
        "armed": state.armed,
        "silence": station.picture().silence,
    }


class ControlLines:
    """Printer of a line or JSON object a second, and of new notices."""

    def __init__(self, station: Station, as_json: bool, now: float) -> None:
        self._station, self._as_json = station, as_json
        self._due = now
        self._printed = 0

    def show(self, status: ControlStatus, now: float) -> None:
        """Print the lines due at ``now`` (s)."""
        picture = self._station.picture()
        if not self._as_json:
            for note in new_notes(picture, self._printed):
                print(note.text, flush=True)
        self._printed = picture.note_count
        if now < self._due:
            return
        self._due = now + LINE_EVERY
        if self._as_json:
            print_line(control_record(status, self._station))
        else:
            print(control_line(status, self._station), flush=True)


def print_devices(devices: tuple[DeviceInfo, ...], configured: tuple[bool, ...]) -> None:
    """Print the connected devices as a table."""
    table = Table(box=None, pad_edge=False)
    for heading in ("number", "name", "guid", "axes", "buttons", "settings"):
        table.add_column(heading, justify="right" if heading in ("number", "axes", "buttons") else "left")
    for number, (info, known) in enumerate(zip(devices, configured, strict=True)):
        cells = (str(number), info.name, info.guid, str(info.axes), str(info.buttons), "yes" if known else "none")
        table.add_row(*map(Text, cells))
    open_console().print(table)
