"""Altitude of the ground below the vehicle, from a downward rangefinder.

The difference of altitude and height is the altitude of the terrain; a first-order filter with a limited rate follows
it, so that a false reading of some meters moves it by centimeters. Heights count from that at boot, as altitudes do.
"""

from __future__ import annotations

from math import cos, exp
from typing import NamedTuple

from avionics.limits import clip
from avionics.sensing import plausibility
from wingbeat.samples import RangeSample

LONGEST = 200.0
"""m; no rangefinder of a small vehicle reads further"""


TIME_CONSTANT = 0.2
"""s; of the filter: ten samples at 50 Hz"""
MAX_RATE = 4.0
"""m/s; of the terrain altitude: a slope of 27 degrees at 8 m/s"""
MAX_TILT = 0.7
"""rad; greatest angle between beam and vertical at which a reading is used"""
HOLD_TIME = 1.0
"""s; for which the terrain altitude holds without a reading, after that it is that of home: 8 m of way"""


class State(NamedTuple):
    """Memory of the filter."""

    reference: float = 0.0
    """m; height at boot, of the vehicle in the hand or on the ground"""
    terrain: float = 0.0
    """m; altitude of the ground below the vehicle"""
    time_us: int = -1
    """us; since boot, of the last reading that was used; -1 before the first"""


def is_plausible(gains: plausibility.Gains, state: plausibility.State, sample: RangeSample) -> bool:
    """Whether distance and limits are finite and in order."""
    return 0.0 <= sample.distance <= LONGEST and 0.0 <= sample.min_distance < sample.max_distance <= LONGEST


def step(state: State, sample: RangeSample, vertical: float, altitude: float, at_rest: bool) -> State:
    """Take one reading.

    Args:
        state: memory.
        sample: the reading.
        vertical: cosine of the angle between beam and vertical.
        altitude: m; estimated, above home.
        at_rest: the vehicle is not in flight: the height is the reference.
    """
    in_range = sample.min_distance <= sample.distance <= sample.max_distance and sample.quality > 0
    if not in_range or vertical < cos(MAX_TILT):
        return state
    height = sample.distance * vertical
    if at_rest:
        return State(reference=height, terrain=0.0, time_us=sample.time_us)
    dt = (sample.time_us - state.time_us) * 1e-6
    if dt > HOLD_TIME:
        return state._replace(terrain=altitude - (height - state.reference), time_us=sample.time_us)
    error = altitude - (height - state.reference) - state.terrain
    change = clip((1.0 - exp(-dt / TIME_CONSTANT)) * error, -MAX_RATE * dt, MAX_RATE * dt)
    return state._replace(terrain=state.terrain + change, time_us=sample.time_us)


def terrain(state: State, time_us: int) -> float:
    """Return the altitude (m) of the ground below the vehicle; 0, that of home, without a recent reading."""
    return state.terrain if state.time_us >= 0 and time_us - state.time_us <= HOLD_TIME * 1e6 else 0.0
