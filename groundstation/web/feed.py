"""Data of the web view: what each browser has not received yet, as JSON documents.

The thread of the link updates the feed, and the thread of the server reads it.
"""

from __future__ import annotations

import math
import threading
from itertools import islice
from typing import Any, NamedTuple

from avionics.link.mission_codec import to_metres
from groundstation.link import modes
from groundstation.link.missions import Item
from groundstation.link.station import Picture, new_notes
from groundstation.link.traffic import quality_record
from groundstation.link.vehicle_state import VehicleState, new_events
from groundstation.link.waypoints import convention_of
from groundstation.views.json_document import encode
from groundstation.views.mission import item_view, mission_rows
from groundstation.views.monitor import state_record
from groundstation.views.panels import FIXES, SILENT_AFTER, vehicle_name
from groundstation.views.printable import printable

COLUMNS = (
    "time", "north", "east", "altitude", "altitude_setpoint", "airspeed", "roll", "pitch", "flap_frequency", "power",
)  # fmt: skip
"""fields of `VehicleState` in the track and the plots, in SI and radians"""
SPACING = 0.2
"""s of vehicle time between samples"""
SAMPLES = 6000
"""samples kept: 20 minutes"""

Row = tuple[float | None, ...]


class Cursor(NamedTuple):
    """What one browser has received."""

    boot: int = -1
    """-; number of the vehicle's boot whose samples it has, -1 before the first message"""
    samples: int = 0
    texts: int = 0
    notes: int = 0
    mission: tuple[Item, ...] | None = None
    spectrum: dict[str, Any] | None = None


class Feed:
    """Latest picture and the samples since the vehicle's boot, at most `SAMPLES`."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._picture = Picture()
        self._rows: list[Row] = []
        self._count = 0
        self._boot = 0
        self._spectrum: dict[str, Any] | None = None

    def update_spectrum(self, document: dict[str, Any] | None) -> None:
        """Set the latest `ImuSpectrum.document`."""
        with self._lock:
            self._spectrum = document

    def update(self, picture: Picture) -> None:
        """Set the latest picture, and add a sample `SPACING` after the previous one."""
        picture = picture._replace(state=_located(picture.state))
        with self._lock:
            self._picture = picture
            time, last = picture.state.time, self._rows[-1][0] if self._rows else None
            if time is None:
                return
            if last is not None and time < last:
                self._rows, self._count, self._boot = [], 0, self._boot + 1
            elif last is not None and time - last < SPACING:
                return
            self._rows.append(tuple(getattr(picture.state, name) for name in COLUMNS))
            self._count += 1
            if len(self._rows) > SAMPLES + SAMPLES // 10:
                del self._rows[:-SAMPLES]

    def message(self, cursor: Cursor) -> tuple[str, Cursor]:
        """Return the JSON document of everything after ``cursor``, and the next cursor.

        Keys: those of `state_record` (SI, radians), and ``name``, ``link`` (`quality_record`, ``url``, ``silence`` in
        s, ``lost``), ``busy``, ``fix``; new ``samples`` (rows of `COLUMNS`), ``events`` and ``notes``; ``restart`` if
        earlier ones are void; ``mission`` and ``spectrum`` if they have changed.
        """
        with self._lock:
            picture, boot, count, spectrum = self._picture, self._boot, self._count, self._spectrum
            new = count if boot != cursor.boot else count - cursor.samples
            rows = list(islice(self._rows, max(len(self._rows) - new, 0), None))
        state = picture.state
        document = {
            **state_record(state),
            "name": vehicle_name(state),
            "modes": [printable(name) for name in sorted(modes.known_modes(state))],
            "link": _link(picture),
            "busy": picture.busy,
            "fix": "" if state.fix_type is None else FIXES.get(state.fix_type, "GPS fix"),
            "restart": boot != cursor.boot,
            "samples": rows,
            "events": [
                {"time": one.time, "severity": int(one.severity), "text": one.text}
                for one in new_events(state, cursor.texts)
            ],
            "notes": [one._replace(text=printable(one.text)) for one in new_notes(picture, cursor.notes)],
        }
        if picture.mission != cursor.mission:
            document["mission"] = mission(picture)
        if spectrum is not cursor.spectrum:
            document["spectrum"] = spectrum
        return encode(document), Cursor(boot, count, state.text_count, picture.note_count, picture.mission, spectrum)


def _located(state: VehicleState) -> VehicleState:
    """Return the state with north and east, for vehicles that send global positions only."""
    if state.north is not None or state.home is None or state.latitude is None or state.longitude is None:
        return state
    north, east = to_metres(state.home, math.degrees(state.latitude), math.degrees(state.longitude))
    return state._replace(north=north, east=east)


def _link(picture: Picture) -> dict[str, Any]:
    silence = picture.silence
    lost = silence is not None and silence > SILENT_AFTER
    return {**quality_record(picture.quality), "url": picture.url, "silence": silence, "lost": lost}


def mission(picture: Picture) -> list[dict[str, Any]]:
    """Return the items as text, with their positions in m from home; null for home and items without a position."""
    state, items = picture.state, picture.mission
    home_first = convention_of(state.autopilot).home_first
    rows = mission_rows(items, home_first)
    places = [(None, None) if home_first and n == 0 else _place(item, state) for n, item in enumerate(items)]
    return [
        {"does": printable(does), "place": printable(place), "altitude": altitude, "how": printable(how),
         "north": north, "east": east}
        for (does, place, altitude, how), (north, east) in zip(rows, places, strict=True)
    ]  # fmt: skip


def _place(item: Item, state: VehicleState) -> tuple[float | None, float | None]:
    view = item_view(item)
    if view.latitude is None or view.longitude is None:
        return view.north, view.east
    if state.home is None:
        return None, None
    return to_metres(state.home, 1e-7 * item.x, 1e-7 * item.y)
