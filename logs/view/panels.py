"""Panels of the page: plots, bands of modes, events."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics import topics
from avionics.messages import Mode, Stage
from logs.view.packing import Packer
from logs.view.tables import QUATERNION, Table, Tables, true_state
from logs.view.thinning import Envelope, thinned
from sim_bridge import topics as truth_topics
from wingbeat.rotation_arrays import euler_from_quaternions
from wingbeat.topic import Topic

Array = NDArray[np.float64]
DEGREES = 180.0 / np.pi
ROWS = 60_000
"""limit of the rows of a topic; for an hour at 200 Hz, minimum and maximum of every twelve samples"""


class Line(NamedTuple):
    """Line of a panel."""

    name: str
    style: str
    """``estimate``, ``setpoint``, ``truth``, ``left`` or ``right``: determines color and line style"""
    topic: Topic[Any]
    field: str
    """of the topic, or ``roll``, ``pitch``, ``yaw``, ``altitude`` of the truth"""
    averaged: bool = False
    """whether it is the mean since the previous message, which within a stroke depends on the interval"""


class Panel(NamedTuple):
    """Diagram."""

    title: str
    unit: str
    factor: float
    """from the log's unit to the panel's unit"""
    span: float
    """in the panel's unit; minimum range of the panel, so that noise at rest is not magnified"""
    lines: tuple[Line, ...]
    wraps: bool = False
    """whether the values wrap: no line is drawn across a wrap"""


NAV, TRUTH = topics.NAVIGATION, truth_topics.STATE
PANELS: tuple[Panel, ...] = (
    Panel("Roll", "°", DEGREES, 2.0, (
        Line("truth", "truth", TRUTH, "roll"),
        Line("setpoint", "setpoint", topics.ROLL_LOOP, "roll_setpoint"),
        Line("estimate", "estimate", topics.ATTITUDE, "roll"),
    )),
    Panel("Pitch", "°", DEGREES, 2.0, (
        Line("truth", "truth", TRUTH, "pitch"),
        Line("setpoint", "setpoint", topics.PITCH_LOOP, "pitch_setpoint"),
        Line("estimate", "estimate", topics.ATTITUDE, "pitch"),
    )),
    Panel("Yaw", "°", DEGREES, 360.0, (
        Line("truth", "truth", TRUTH, "yaw"),
        Line("course setpoint", "setpoint", NAV, "heading_setpoint"),
        Line("estimate", "estimate", topics.ATTITUDE, "yaw"),
    ), wraps=True),
    Panel("Altitude above the place of boot", "m", 1.0, 1.0, (
        Line("truth", "truth", TRUTH, "altitude"),
        Line("setpoint", "setpoint", NAV, "altitude_setpoint"),
        Line("estimate", "estimate", topics.ALTITUDE, "altitude"),
    )),
    Panel("Airspeed", "m/s", 1.0, 1.0, (
        Line("truth", "truth", TRUTH, "airspeed"),
        Line("estimate", "estimate", topics.AIR_DATA, "airspeed"),
    )),
    Panel("Wing angle", "°", DEGREES, 5.0, ()),
    Panel("Flapping", "Hz", 1.0, 1.0, (
        Line("command", "setpoint", topics.FLAP, "frequency"),
        Line("measured", "estimate", topics.WING, "frequency"),
    )),
    Panel("Power", "W", 1.0, 1.0, (
        Line("truth", "truth", truth_topics.WING, "electrical_power", True),
        Line("measured", "estimate", topics.POWER, "power", True),
    )),
    Panel("Voltage", "V", 1.0, 0.2, (Line("measured", "estimate", topics.POWER, "voltage"),)),
    Panel("Battery", "%", 100.0, 2.0, (Line("remaining", "estimate", topics.POWER, "battery_remaining"),)),
)  # fmt: skip
"""Panels in their order on the page; wing angles are those of the drawn vehicle."""
WING_ANGLE = "Wing angle"


def _true_angles(table: Table) -> Mapping[str, Array]:
    roll, pitch, yaw = euler_from_quaternions(*(table.fields[name] for name in QUATERNION))
    down = table.fields["down"]
    return {"roll": roll, "pitch": pitch, "yaw": yaw, "altitude": down[0] - down}


def plotted(tables: Tables, topic: str) -> Table | None:
    """Return a topic with every field that a `Line` can name; None if the log has none of it."""
    table = tables.get(topic)
    if table is None or table is not true_state(tables):
        return table
    return table._replace(fields={**table.fields, **_true_angles(table)})


class Series:
    """Decimated and packed columns, each topic once."""

    def __init__(self, tables: Tables, packer: Packer) -> None:
        self._tables = tables
        self._packer = packer
        self._thin: dict[str, tuple[Envelope, dict[str, float]]] = {}

    def panels(self) -> list[dict[str, Any]]:
        """Return every panel that has a line; see `panel`."""
        return [shown for panel in PANELS if (shown := self.panel(panel))["lines"] or panel.title == WING_ANGLE]

    def panel(self, panel: Panel) -> dict[str, Any]:
        """Return ``panel`` with its ``lines``, each with ``name``, ``style``, ``time``, ``low`` and ``high``."""
        lines = [found for line in panel.lines if (found := self._line(line, panel.factor)) is not None]
        return panel._asdict() | {"lines": lines}

    def _line(self, line: Line, factor: float) -> dict[str, Any] | None:
        found = self._thinned(line.topic.name)
        if found is None or line.field not in found[0].low:
            return None
        envelope, time = found
        low = self._packer.add(factor * envelope.low[line.field])
        high = None if envelope.high is None else self._packer.add(factor * envelope.high[line.field])
        return {"name": self._named(line), "style": line.style, "time": time, "low": low, "high": high}

    def _named(self, line: Line) -> str:
        """With the time of the mean, where a simulated flight has two of them beside each other."""
        periods = np.diff(self._tables[line.topic.name].time)
        if not line.averaged or truth_topics.WING.name not in self._tables or not len(periods):
            return line.name
        return f"{line.name}, mean of {1e3 * float(np.median(periods)):.0f} ms"

    def _thinned(self, topic: str) -> tuple[Envelope, dict[str, float]] | None:
        table = plotted(self._tables, topic) if topic not in self._thin else None
        if table is not None:
            envelope = thinned(table.time, table.fields, ROWS)
            self._thin[topic] = envelope, self._packer.add(envelope.time, TIME_STEP)
        return self._thin.get(topic)


TIME_STEP = 1e-4
"""s; resolution of packed times"""


class Band(NamedTuple):
    """Interval with a constant state."""

    start: float
    """s; since boot"""
    end: float
    """s; since boot"""
    label: str


def bands(tables: Tables, field: str, end: float) -> list[Band]:
    """Return the intervals of constant ``mode`` or ``stage``, the last until ``end`` (s); empty without data."""
    table = tables.get(NAV.name)
    if table is None or field not in table.fields:
        return []
    own: type[Mode] | type[Stage] = Mode if field == "mode" else Stage
    names = {int(member): member.name for member in own} | dict(table.labels.get(field, {}))
    return [
        Band(a, b, names.get(value, f"{field} {value}").lower().replace("_", " "))
        for a, b, value in _runs(table.time, table.fields[field], end)
    ]


def _runs(time: Array, values: Array, end: float) -> Iterator[tuple[float, float, int]]:
    known = np.isfinite(values)
    time, values = time[known], values[known]
    edges = [0, *(np.flatnonzero(np.diff(values)) + 1).tolist()]
    for first, after in zip(edges, [*edges[1:], None], strict=True):
        yield float(time[first]), end if after is None else float(time[after]), int(values[first])
