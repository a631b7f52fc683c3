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
    """label of plots and tables"""
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
    "launch": Metric("s", "time of launch since boot", _member("launch")),
    "airtime": Metric("s", "flight time", _member("airtime")),
    "distance": Metric("m", "distance over ground", _member("distance")),
    "highest": Metric("m", "maximum altitude", _member("highest")),
    "away": Metric("m", "maximum distance from the launch", _away),
    "airspeed": Metric("m/s", "mean airspeed", _member("airspeed")),
    "frequency": Metric("Hz", "mean flapping frequency", _member("frequency")),
    "power": Metric("W", "mean electrical power", _member("power"), 1),
    "energy": Metric("J", "electrical energy", _member("energy")),
    "bank": Metric("rad", "maximum bank", _bank, 1),
    "hold_altitude_rms": Metric("m", "altitude error, RMS of the longest hold", _member("hold", "altitude_rms"), 1),
    "hold_heading_rms": Metric("rad", "heading error, RMS of the longest hold", _member("hold", "heading_rms"), 1),
    "hold_settling": Metric("s", "settling time of the longest hold", _member("hold", "settling"), 1),
    "estimate_roll_rms": Metric("rad", "roll estimation error, RMS", _member("estimate", "roll"), 1),
    "estimate_pitch_rms": Metric("rad", "pitch estimation error, RMS", _member("estimate", "pitch"), 1),
    "estimate_yaw_rms": Metric("rad", "yaw estimation error, RMS", _member("estimate", "yaw"), 1),
    "estimate_altitude_rms": Metric("m", "altitude estimation error, RMS", _member("estimate", "altitude"), 1),
    "estimate_airspeed_rms": Metric("m/s", "airspeed estimation error, RMS", _member("estimate", "airspeed"), 1),
    "touchdown_sink": Metric("m/s", "sink rate at touchdown", _member("touchdown", "sink"), 1),
    "touchdown_bank": Metric("rad", "bank at touchdown", _bank_at_touchdown, 1),
    "touchdown_speed": Metric("m/s", "ground speed at touchdown", _member("touchdown", "speed"), 1),
}


def measured(summary: FlightSummary, tables: Tables) -> dict[str, float | None]:
    """Compute every metric of a flight; None if the data are missing or not finite."""
    return {name: _finite(metric.of(summary, tables)) for name, metric in METRICS.items()}


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)
