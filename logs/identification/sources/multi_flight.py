"""Several flights of one aircraft as one, so that one set of derivatives is fitted to the manoeuvres of all."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from logs.identification.data.flight import FlightData, JoinedFlight
from logs.identification.results import Array
from wingbeat.errors import InputError
from wingbeat.text import pluralize

UNEVEN = 1e-3
"""-; of a sampling interval, by which those of two flights may differ"""

PAUSE = 4.0
"""s; of rest between joined flights"""


def joined_flights(flights: tuple[FlightData, ...], names: tuple[str, ...] = ()) -> FlightData:
    """The flights one behind the other, manoeuvres and strokes counted on; ``names`` are those of their logs.

    A manoeuvre that a flight's end cuts off ends a stroke before it, and one that its beginning cuts begins a stroke
    later, and a pause in which nothing moves is between two, so that nothing of one flight is in another's.

    Raises:
        InputError: their samples are not equally far apart.
    """
    steps = [float(np.median(np.diff(flight.time))) for flight in flights]
    if max(steps) - min(steps) > UNEVEN * steps[0]:
        raise InputError(f"the logs' IMUs sample every {min(steps):.4g} s and {max(steps):.4g} s: they must agree")
    pieces = [_with_pause(_apart(flight), steps[0]) for flight in flights]
    columns = {name: [getattr(one, name) for one in pieces] for name in FlightData.arrays()}
    before = [0, *np.cumsum([int(one.manoeuvre.max()) for one in pieces])]
    for name in ("strokes", "manoeuvre"):
        columns[name] = _counted_on(columns[name])
    count = sum(len(one.time) for one in pieces)
    columns["time"] = [pieces[0].time[0] + steps[0] * np.arange(count)]
    whole = {name: np.concatenate(parts) for name, parts in columns.items()}
    notes = dict.fromkeys(note for flight in flights for note in flight.notes)
    begins = whole["time"][np.cumsum([0, *(len(one.time) for one in pieces[:-1])])]
    named = names or tuple(f"flight {number}" for number in range(1, len(flights) + 1))
    places = tuple(
        JoinedFlight(name, float(begin), float(one.time[0]), int(count))
        for name, begin, one, count in zip(named, begins, pieces, before[:-1], strict=True)
    )
    return FlightData(**whole, notes=(f"together: {pluralize(len(flights), 'flight')}", *notes), flights=places)


def _apart(flight: FlightData) -> FlightData:
    """The flight without an input in its first and its last stroke."""
    inner = (flight.strokes > flight.strokes[0] + 1.0) & (flight.strokes < flight.strokes[-1] - 1.0)
    return flight._replace(active=np.where(inner, flight.active, 0.0))


def _with_pause(flight: FlightData, step: float) -> FlightData:
    """The flight, and behind it its last sample for longer than a stretch of strokes may be interrupted."""
    still = math.ceil((PAUSE) / step)
    names = FlightData.arrays()
    longer: dict[str, Any] = {name: np.pad(getattr(flight, name), (0, still), mode="edge") for name in names}
    return flight._replace(**longer)


def _counted_on(parts: list[Array]) -> list[Array]:
    """Counts of which each goes on where the one before ended."""
    found, last = [], 0.0
    for part in parts:
        found.append(part + last)
        last = float(found[-1].max())
    return found
