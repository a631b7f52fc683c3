"""Telemetry as lines or JSON objects."""

from __future__ import annotations

from typing import Any

from groundstation.link import modes
from groundstation.link.station import Station
from groundstation.link.traffic import Quality, quality_record
from groundstation.link.vehicle_state import VehicleState, new_events
from groundstation.views.flight_view import FlightView, Header, event_line, progress_line
from groundstation.views.json_document import print_line
from groundstation.views.terminal import open_console

LINE_EVERY = 1.0
"""s; between two lines"""


def watch_lines(station: Station, as_json: bool) -> None:
    """Print a line a second, or a JSON object, until Ctrl-C; messages of the vehicle are separate lines."""
    connection = station.connection
    said = 0
    due = connection.now() + LINE_EVERY
    while True:
        if not station.poll():
            connection.wait()
        if connection.now() < due:
            continue
        due += LINE_EVERY
        state = connection.state
        if state.received_at is None:
            continue
        if as_json:
            print_line({**state_record(state), "link": quality_record(station.picture().quality)})
            continue
        for heard in new_events(state, said):
            print(event_line(heard))
        said = state.text_count
        print(progress_line(state, modes.mode_name(state)), flush=True)


JSON_KEYS = {"text_count": "said"}
"""fields of `VehicleState` that have another key in JSON documents"""


def state_record(state: VehicleState) -> dict[str, Any]:
    """Return the telemetry as a JSON object: SI and radians, null for missing data."""
    hidden = ("sentence", "mode_names", "received_at", "events", "stage", "home", "stamp", "is_wingbeat", "beats")
    record = {JSON_KEYS.get(key, key): value for key, value in state._asdict().items() if key not in hidden}
    return {
        "mode": modes.mode_key(state),
        "modes": sorted(modes.known_modes(state)),
        "stage": None if state.stage is None else state.stage.name,
        **record,
        "events": [
            {"time": heard.time, "severity": heard.severity.name, "text": heard.text} for heard in state.events
        ],
    }


def print_once(url: str, state: VehicleState, quality: Quality) -> None:
    """Print the view once, without plots, and the link quality."""
    open_console().print(FlightView(Header(url, modes.mode_name(state), link_note(quality)), state, None))


def link_note(quality: Quality) -> str:
    """Format rate and loss of a link."""
    rate = f"{quality.bytes_per_s / 1e3:.1f} kB/s"
    return rate if quality.loss is None else f"{rate}, {100.0 * quality.loss:.1f} % lost"
