"""Pitot calibration: zero at rest, and scale in flight from GPS and wind.

Over a circle or in opposite directions, ground velocity = scale * airspeed * heading + wind has the scale and the
wind as unknowns. A constant error of the heading (declination, the delay of the fixes in a steady turn) is also
estimated, as the angle of a complex scale, so that it does not reduce the scale.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from avionics.calibration.result import NOTHING_NEW, Result, Setting, Took
from avionics.sensing.air_data import Gains

AT_REST = 100
"""samples of a zero: two seconds"""
MOST_SCATTER = 10.0
"""Pa; maximum standard deviation at rest: more indicates wind in the tube"""
GREATEST_ZERO = 50.0
"""Pa; maximum plausible zero; a larger one indicates a defect"""
LEAST, MOST = 60, 400
"""fixes; minimum and maximum for a scale"""
SPREAD = 0.3
"""-; maximum length of the mean unit vector of the headings: 0 for a full circle or two opposite directions"""
SLOWEST = 3.0
"""m/s; minimum airspeed, because the relative error is large below it"""
SCALES = (0.7, 1.4)
"""-; range of plausible airspeed scales"""
GREATEST_ERROR = 0.03
"""-; maximum standard error of the scale"""

Sample = tuple[float, float, float, float]
"""heading (rad), horizontal airspeed (m/s), ground velocity north and east (m/s)"""


class State(NamedTuple):
    """Collected samples."""

    pressures: tuple[float, ...] = ()
    """Pa; differential pressures at rest"""
    samples: tuple[Sample, ...] = ()
    """samples in flight"""


def step_zero(state: State, pressure: float) -> tuple[State, Took]:
    """Add a differential pressure (Pa) at rest, without zero and scale."""
    state = state._replace(pressures=(*state.pressures, pressure))
    return state, Took(complete=len(state.pressures) >= AT_REST)


def step_scale(state: State, sample: Sample) -> tuple[State, Took]:
    """Add a fix in flight; the calibration ends with sufficient headings."""
    if sample[1] < SLOWEST:
        return state, NOTHING_NEW
    state = state._replace(samples=(*state.samples, sample)[-MOST:])
    count = len(state.samples)
    note = f"{count} fixes, headings {100.0 * (1.0 - spread(state)):.0f} % spread" if count % 25 == 0 else ""
    return state, Took(note, complete=count >= LEAST and spread(state) <= SPREAD)


def spread(state: State) -> float:
    """Return the length of the mean unit vector of the headings.

    It is 1 on one heading, and 0 over a circle or in opposite directions.
    """
    count = max(len(state.samples), 1)
    north = sum(math.cos(sample[0]) for sample in state.samples) / count
    east = sum(math.sin(sample[0]) for sample in state.samples) / count
    return math.hypot(north, east) if state.samples else 1.0


def progress_zero(state: State) -> float:
    """Return the completed fraction, 0 to 1."""
    return len(state.pressures) / AT_REST


def progress_scale(state: State) -> float:
    """Return the completed fraction, 0 to 1."""
    share = len(state.samples) / LEAST
    return min(share, (1.0 - spread(state)) / (1.0 - SPREAD), 1.0)


def finish_zero(state: State) -> tuple[Result, str]:
    """Return the pressure at rest, and an error text (empty on success)."""
    pressures = np.array(state.pressures)
    zero, scatter = float(np.mean(pressures)), float(np.std(pressures))
    result = Result((Setting("air_data", "differential_zero", -1, zero),), scatter, "Pa", len(pressures))
    if scatter > MOST_SCATTER:
        return result, "wind in the pitot: cover it"
    return result, "" if abs(zero) <= GREATEST_ZERO else "zero out of range: check the sensor"


def finish_scale(state: State, gains: Gains) -> tuple[Result, str]:
    """Return the pressure scale, and an error text (empty on success).

    The pressure scale is the square of the airspeed scale.
    """
    count = len(state.samples)
    nothing = Result((), 0.0, "m/s", count)
    if count < LEAST or spread(state) > SPREAD:
        return nothing, "too few headings: fly a circle, or both directions"
    heading, airspeed, north, east = np.array(state.samples).T
    c, s = airspeed * np.cos(heading), airspeed * np.sin(heading)
    one, none = np.ones(count), np.zeros(count)
    design = np.vstack((np.column_stack((c, -s, one, none)), np.column_stack((s, c, none, one))))
    measured = np.concatenate((north, east))
    solution = np.linalg.lstsq(design, measured, rcond=None)[0]
    left = measured - design @ solution
    residual = math.sqrt(float(np.mean(left**2)))
    # Residuals of gusts are correlated over several fixes: a tenth of them counts as independent.
    error = residual / math.sqrt(0.1 * count) / float(np.mean(airspeed))
    scale = math.hypot(solution[0], solution[1])
    value = gains.differential_scale * scale * scale
    result = Result((Setting("air_data", "differential_scale", -1, value),), residual, "m/s", count)
    if not SCALES[0] <= scale <= SCALES[1]:
        return result, f"scale {scale:.2f} out of range: check the pitot"
    return (
        result,
        "" if error <= GREATEST_ERROR else f"scale uncertain by {100.0 * error:.0f} %: repeat in calm air",
    )
