"""The pitot: its zero at rest, and its scale in flight against the ground speed of the GPS, the wind solved with it.

Over a circle, or flown both ways, ground velocity = scale * airspeed * heading + wind has the scale and the wind as
its unknowns; an error of the heading that stays the same (declination, the delay of the fixes in a steady turn) is
solved too, as the angle of a complex scale, so that it does not shorten the airspeed.
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
"""Pa; standard deviation at rest: more is wind in the tube"""
GREATEST_ZERO = 50.0
"""Pa; beyond it the sensor is broken"""
LEAST, MOST = 60, 400
"""fixes for a scale"""
SPREAD = 0.3
"""-; length of the mean of the headings' unit vectors, 0 for a full circle or two opposite ways"""
SLOWEST = 3.0
"""m/s; airspeed below which the tube says too little"""
SCALES = (0.7, 1.4)
"""-; of the airspeed; beyond it something else is wrong"""
GREATEST_ERROR = 0.03
"""-; standard error of the scale"""

Sample = tuple[float, float, float, float]
"""heading (rad), horizontal airspeed (m/s), ground velocity north and east (m/s)"""


class State(NamedTuple):
    """What was gathered."""

    pressures: tuple[float, ...] = ()
    """Pa; differential, at rest"""
    samples: tuple[Sample, ...] = ()
    """in flight"""


def step_zero(state: State, pressure: float) -> tuple[State, Took]:
    """One differential pressure (Pa) at rest, without zero and scale."""
    state = state._replace(pressures=(*state.pressures, pressure))
    return state, Took(complete=len(state.pressures) >= AT_REST)


def step_scale(state: State, sample: Sample) -> tuple[State, Took]:
    """One fix in flight; it ends once enough headings were flown."""
    if sample[1] < SLOWEST:
        return state, NOTHING_NEW
    state = state._replace(samples=(*state.samples, sample)[-MOST:])
    count = len(state.samples)
    note = f"{count} fixes, headings {100.0 * (1.0 - spread(state)):.0f} % spread" if count % 25 == 0 else ""
    return state, Took(note, complete=count >= LEAST and spread(state) <= SPREAD)


def spread(state: State) -> float:
    """Length of the mean of the headings' unit vectors: 1 on one heading, 0 over a circle or both ways."""
    count = max(len(state.samples), 1)
    north = sum(math.cos(sample[0]) for sample in state.samples) / count
    east = sum(math.sin(sample[0]) for sample in state.samples) / count
    return math.hypot(north, east) if state.samples else 1.0


def progress_zero(state: State) -> float:
    """Share that has been gathered, 0 to 1."""
    return len(state.pressures) / AT_REST


def progress_scale(state: State) -> float:
    """Share that has been gathered, 0 to 1."""
    share = len(state.samples) / LEAST
    return min(share, (1.0 - spread(state)) / (1.0 - SPREAD), 1.0)


def finish_zero(state: State) -> tuple[Result, str]:
    """The pressure at rest, and why it is none (or "")."""
    pressures = np.array(state.pressures)
    zero, scatter = float(np.mean(pressures)), float(np.std(pressures))
    result = Result((Setting("air_data", "differential_zero", -1, zero),), scatter, "Pa", len(pressures))
    if scatter > MOST_SCATTER:
        return result, "wind in the pitot: cover it"
    return result, "" if abs(zero) <= GREATEST_ZERO else "zero out of range: check the sensor"


def finish_scale(state: State, gains: Gains) -> tuple[Result, str]:
    """The scale of the pressure (the square of the airspeed's), and why it is none (or "")."""
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
    # The residuals of gusts last for some fixes: a tenth of them counts as independent.
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
