"""The flight view on a link, live."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rich.console import Console
from rich.live import Live

from groundstation.link import mode_change, modes
from groundstation.link.connection import Connection
from groundstation.link.vehicle_state import VehicleState, new_events
from groundstation.views.flight_view import FlightView, Header, event_line, progress_line
from groundstation.views.history import History, remember
from groundstation.views.json_document import print_line
from groundstation.views.terminal import open_console

REFRESH = 0.1
"""s; between two pictures"""
SILENT_AFTER = 3.0
"""s; without a message before the view says so"""
LINE_EVERY = 1.0
"""s; between two lines where there is no terminal"""


def header(url: str, state: VehicleState, now: float) -> Header:
    """What stands above the state: the link, the mode, and how long the link is silent."""
    if state.heard_at is None:
        return Header(url, note="waiting for a vehicle")
    silence = now - state.heard_at
    if silence > SILENT_AFTER:
        return Header(url, modes.mode_name(state), f"silent for {silence:.0f} s", alarm=True)
    return Header(url, modes.mode_name(state))


def watch(connection: Connection, as_json: bool = False, clock: Callable[[], float] = time.monotonic) -> int:
    """Show the link until Ctrl-C: a picture on a terminal, lines elsewhere, one JSON object a second if asked."""
    console = open_console()
    if console.is_terminal and not as_json:
        _watch_picture(connection, console, clock)
    else:
        _watch_lines(connection, as_json)
    return 0


def _listen(connection: Connection, duration: float, asked: bool) -> bool:
    """Listen, and ask for the names of the modes once there is a vehicle to ask."""
    connection.listen(duration)
    if not asked and connection.state.system is not None:
        connection.begin(mode_change.request_mode_names(connection.target))
        return True
    return asked


def _watch_picture(connection: Connection, console: Console, clock: Callable[[], float]) -> None:
    history = History()
    asked = False
    with Live(console=console, auto_refresh=False) as live:
        while True:
            asked = _listen(connection, REFRESH, asked)
            history = remember(history, connection.state)
            top = header(connection.url, connection.state, clock())
            live.update(FlightView(top, connection.state, history), refresh=True)


def _watch_lines(connection: Connection, as_json: bool) -> None:
    said = 0
    asked = False
    while True:
        asked = _listen(connection, LINE_EVERY, asked)
        state = connection.state
        if state.heard_at is None:
            continue
        if as_json:
            print_line(state_record(state))
            continue
        for heard in new_events(state, said):
            print(event_line(heard))
        said = state.said
        print(progress_line(state, modes.mode_name(state)), flush=True)


def state_record(state: VehicleState) -> dict[str, Any]:
    """The telemetry as a JSON object: SI and radians, null where nothing was heard."""
    hidden = ("sentence", "mode_names", "heard_at", "events", "stage", "home", "stamp")
    record = {key: value for key, value in state._asdict().items() if key not in hidden}
    return {
        "mode": modes.mode_key(state),
        "modes": sorted(modes.known_modes(state)),
        "stage": None if state.stage is None else state.stage.name,
        **record,
        "events": [
            {"time": heard.time, "severity": heard.severity.name, "text": heard.text} for heard in state.events
        ],
    }


def print_once(url: str, state: VehicleState) -> None:
    """Print the picture once, without the plots."""
    open_console().print(FlightView(Header(url, modes.mode_name(state)), state, None))
