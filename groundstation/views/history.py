"""History of telemetry for plots with a bounded number of points."""

from __future__ import annotations

import math
from typing import NamedTuple

from groundstation.link.vehicle_state import VehicleState

POINTS = 400


class History(NamedTuple):
    """Altitude and track, oldest first."""

    altitude: tuple[tuple[float, float], ...] = ()
    """(s, m); time of the vehicle and altitude above home"""
    track: tuple[tuple[float, float], ...] = ()
    """(m, m); east and north of home"""
    spacing: float = 0.2
    """s; between points"""


def remember(history: History, state: VehicleState) -> History:
    """Add a point after each `History.spacing`; at `POINTS` every second point is removed."""
    if state.time is None or state.altitude is None or not math.isfinite(state.time + state.altitude):
        return history
    if history.altitude and state.time < history.altitude[-1][0]:
        history = History()  # the vehicle was restarted
    if history.altitude and state.time - history.altitude[-1][0] < history.spacing:
        return history
    altitude = (*history.altitude, (state.time, state.altitude))
    track = history.track
    if state.east is not None and state.north is not None and math.isfinite(state.east + state.north):
        track = (*track, (state.east, state.north))
    if len(altitude) > POINTS:
        return History(altitude[::2], track[::2], 2.0 * history.spacing)
    return history._replace(altitude=altitude, track=track)
