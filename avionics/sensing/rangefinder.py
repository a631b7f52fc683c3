"""Terrain altitude below the vehicle, from a downward rangefinder.

The terrain altitude is the difference of altitude and height. A first-order filter with a rate limit follows it, so
that a false reading of some meters changes it by centimeters. Heights are relative to that at boot, as altitudes are.
"""

from __future__ import annotations

from math import cos, exp
from typing import Final, NamedTuple

from avionics.limits import clip
from avionics.sensing import plausibility
from wingbeat.samples import RangeSample

PLAUSIBLE_RANGE: Final = 200.0
"""m; maximum plausible range: no rangefinder of a small vehicle exceeds it"""
TIME_CONSTANT: Final = 0.2
"""s; time constant of the filter: ten samples at 50 Hz"""
MAX_RATE: Final = 4.0
"""m/s; rate limit of the terrain altitude: a slope of 27 degrees at 8 m/s"""
MAX_TILT: Final = 0.7
"""rad; maximum angle between beam and vertical for a valid reading"""
HOLD_TIME: Final = 1.0
"""s; for which the terrain altitude holds without a reading, after that it is that of home: 8 m of way"""
CONFIRMING: Final = 5
"""readings that agree after a gap before the terrain altitude is used: 0.1 s at 50 Hz"""
AGREEMENT: Final = 1.0
"""m; maximum difference of such readings from their filtered terrain altitude"""
MAX_STEP: Final = 0.1
"""s; maximum time step of the filter"""


class State(NamedTuple):
    """State of the filter."""

    reference: float = 0.0
    """m; height at boot, of the vehicle in the hand or on the ground"""
    terrain: float = 0.0
    """m; altitude of the ground below the vehicle"""
    time_us: int = -1
    """us; since boot, of the last reading that was used; -1 before the first"""
    readings: int = 0
    """-; agreeing readings since the last gap, at most `CONFIRMING`"""


def is_plausible(gains: plausibility.Gains, state: plausibility.State, sample: RangeSample) -> bool:
    """Return whether distance and limits are finite and in order."""
    return (
        0.0 <= sample.distance <= PLAUSIBLE_RANGE
        and 0.0 <= sample.min_distance < sample.max_distance <= PLAUSIBLE_RANGE
    )


def step(state: State, sample: RangeSample, vertical: float, altitude: float, at_rest: bool) -> State:
    """Update the terrain altitude with one reading.

    Args:
        state: result of the last step.
        sample: reading.
        vertical: cosine of the angle between beam and vertical.
        altitude: m; estimated, above home.
        at_rest: True if the vehicle is not in flight: the height becomes the reference.
    """
    # A distance below the minimum is that of a vehicle on the ground.
    distance = max(sample.distance, sample.min_distance)
    if distance > sample.max_distance or sample.quality == 0 or vertical < cos(MAX_TILT):
        return state
    height = distance * vertical
    if at_rest:
        return State(height, 0.0, sample.time_us, CONFIRMING)
    dt = (sample.time_us - state.time_us) * 1e-6
    measured = altitude - (height - state.reference)
    error = measured - state.terrain
    confirmed = state.readings == CONFIRMING
    if dt > HOLD_TIME or (not confirmed and abs(error) > AGREEMENT):
        return State(state.reference, measured, sample.time_us, 1)
    dt = min(dt, MAX_STEP)
    change = clip((1.0 - exp(-dt / TIME_CONSTANT)) * error, -MAX_RATE * dt, MAX_RATE * dt)
    return State(state.reference, state.terrain + change, sample.time_us, min(state.readings + 1, CONFIRMING))


def terrain(state: State, time_us: int) -> float:
    """Return the altitude (m) of the ground below the vehicle above that at boot; 0 without recent readings."""
    return state.terrain if _is_recent(state, time_us) else 0.0


def launch_height(state: State, time_us: int, default: float) -> float:
    """Return the height (m) above the ground at boot, ``default`` without recent readings."""
    return state.reference if _is_recent(state, time_us) else default


def _is_recent(state: State, time_us: int) -> bool:
    return state.readings == CONFIRMING and time_us - state.time_us <= HOLD_TIME * 1e6
