"""Metrics of one flight with unit and meaning."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from logs.campaigns.outcome import farthest
from logs.columns import Columns
from logs.summary import FlightSummary
from sim_bridge.topics import STATE
from wingbeat.rotation_arrays import euler_from_quaternions

Tables = Mapping[str, Columns]


class Metric(NamedTuple):
    """Row of the table of metrics."""

    unit: str
    text: str
    of: Callable[[FlightSummary, Tables], float | None]
    bad: int = 0
    """-; sign of the worse direction: 1 more, -1 less, 0 neither"""


def _member(*names: str) -> Callable[[FlightSummary, Tables], float | None]:
    """Return a getter of a number of the summary; None if its section is missing."""

    def look(summary: FlightSummary, tables: Tables) -> float | None:
        found: Any = summary
        for name in names:
            found = None if found is None else getattr(found, name)
        return None if found is None else float(found)

    return look


def _away(summary: FlightSummary, tables: Tables) -> float | None:
    return None if summary.launch is None else farthest(tables[STATE.name])


def _bank(summary: FlightSummary, tables: Tables) -> float | None:
    """Return the largest bank angle of either sign from launch to touchdown."""
    if summary.launch is None or summary.airtime is None:
        return None
    truth = tables[STATE.name]
    inside = (truth.time >= summary.launch) & (truth.time <= summary.launch + summary.airtime)
    roll, _, _ = euler_from_quaternions(*(truth[f"quaternion_{axis}"][inside] for axis in "wxyz"))
    return float(np.max(np.abs(roll)))


def _bank_at_touchdown(summary: FlightSummary, tables: Tables) -> float | None:
    return None if summary.touchdown is None else abs(summary.touchdown.bank)


METRICS: dict[str, Metric] = {
    "launch": Metric("s", "since boot, when the launcher let go", _member("launch")),
    "airtime": Metric("s", "from the launch to the touchdown, or to the end", _member("airtime")),
    "distance": Metric("m", "flown over ground", _member("distance")),
    "highest": Metric("m", "above the altitude at boot", _member("highest")),
    "away": Metric("m", "greatest distance from the launch place", _away),
    "airspeed": Metric("m/s", "mean in the air", _member("airspeed")),
    "frequency": Metric("Hz", "mean flapping frequency", _member("frequency")),
    "power": Metric("W", "mean in the air", _member("power"), 1),
    "energy": Metric("J", "drawn in the air", _member("energy")),
    "bank": Metric("rad", "greatest in the air, either way", _bank, 1),
    "hold_altitude_rms": Metric("m", "error of the altitude in the longest hold", _member("hold", "altitude_rms"), 1),
    "hold_heading_rms": Metric("rad", "error of the heading in the longest hold", _member("hold", "heading_rms"), 1),
    "hold_settling": Metric("s", "until the longest hold was captured", _member("hold", "settling"), 1),
    "estimate_roll_rms": Metric("rad", "of the estimate against the truth", _member("estimate", "roll"), 1),
    "estimate_pitch_rms": Metric("rad", "of the estimate against the truth", _member("estimate", "pitch"), 1),
    "estimate_yaw_rms": Metric("rad", "of the estimate against the truth", _member("estimate", "yaw"), 1),
    "estimate_altitude_rms": Metric("m", "of the estimate against the truth", _member("estimate", "altitude"), 1),
    "estimate_airspeed_rms": Metric("m/s", "of the estimate against the truth", _member("estimate", "airspeed"), 1),
    "touchdown_sink": Metric("m/s", "at the first contact, positive down", _member("touchdown", "sink"), 1),
    "touchdown_bank": Metric("rad", "at the first contact, either way", _bank_at_touchdown, 1),
    "touchdown_speed": Metric("m/s", "over ground at the first contact", _member("touchdown", "speed"), 1),
}


def measured(summary: FlightSummary, tables: Tables) -> dict[str, float | None]:
    """Compute every metric of a flight; None if the data are missing or not finite."""
    return {name: _finite(metric.of(summary, tables)) for name, metric in METRICS.items()}


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)
