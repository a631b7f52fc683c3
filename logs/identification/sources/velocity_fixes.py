"""From a log's topics to what its IMU and its GPS receiver tell of one stretch of flight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from avionics import topics
from logs.identification.data.contiguous_runs import longest_run
from logs.identification.data.experiment import Experiment
from logs.identification.data.flight import Aircraft
from logs.identification.data.resampling import bridged
from logs.identification.estimators.gps_aided import AidedFlight, ned_from_frd
from logs.identification.models.rigid_body import INPUTS
from logs.identification.results import Array
from logs.identification.sources.full_flight import LONGEST_GAP
from logs.identification.sources.topic_table import ColumnSource, TopicTable
from wingbeat.errors import InputError

ANGLES = ("phi", "theta", "psi")
FLYING = 0.5
"""-; of the airspeed or the speed over ground in flight, below which it stands or lands"""
IN_FLIGHT = 0.9
"""-; of the samples, that are slower than what counts as the speed in flight: the wait before a launch may be long"""
LEAD = 5.0
"""s; behind a launch, left out"""
LONGEST_PAUSE = 2.0
"""s; without a fix, at which the stretch ends"""
LEAST, LONGEST = 10.0, 180.0
"""s; of a stretch that is used"""
LATEST = 0.4
"""s; largest age of a fix that is looked for"""


def aided_flight(source: ColumnSource, flight: Experiment, aircraft: Aircraft) -> AidedFlight:
    """The longest stretch of a ``flight`` with fixes all along, behind a launch.

    A fix tells of some time before it arrives; that age is where the integrated specific force follows it best.

    Raises:
        InputError: the log has no ground velocities of a receiver, no attitude to begin with, or no such stretch.
    """
    fixes = TopicTable(source, topics.GPS, "v_north", "v_east", "v_down")
    missing = [name for name in (*INPUTS, *ANGLES) if name not in flight.signals]
    if missing:
        raise InputError(f"the log does not tell {', '.join(missing)}")
    whole = bridged(flight, (*INPUTS, *ANGLES), int(LONGEST_GAP / flight.step + 1e-6))
    span = _longest(_usable(whole, fixes), flight.step)
    time = whole.time[span]
    inputs, attitude = (np.column_stack([whole.signals[n][span] for n in names]) for names in (INPUTS, ANGLES))
    velocity = np.column_stack([fixes[name] for name in ("v_north", "v_east", "v_down")])
    age = _age(time, inputs, attitude, fixes.time, velocity)
    places = np.rint((fixes.time - age - time[0]) / flight.step).astype(np.int64)
    inside = (places >= 0) & (places < len(time)) & np.append(True, np.diff(places) > 0)
    arm = (aircraft.imu_x, 0.0, aircraft.imu_z)
    return AidedFlight(time, inputs, attitude, places[inside], velocity[inside], arm)


def _usable(flight: Experiment, fixes: TopicTable) -> NDArray[np.bool_]:
    """Samples at which it flies, the IMU tells something, and fixes are not far."""
    known = np.all([np.isfinite(flight.signals[name]) for name in (*INPUTS, *ANGLES)], axis=0)
    ground = np.hypot(fixes.linear("v_north", flight.time), fixes.linear("v_east", flight.time))
    # The larger: a blocked pitot hides the one, a headwind the other.
    speed = np.fmax(flight.signals.get("airspeed", ground), ground)
    after = np.searchsorted(fixes.time, flight.time).clip(1, len(fixes.time) - 1)
    near = fixes.time[after] - fixes.time[after - 1] < LONGEST_PAUSE
    near &= (flight.time >= fixes.time[0]) & (flight.time <= fixes.time[-1])
    usable: NDArray[np.bool_] = known & near & (speed > FLYING * float(np.quantile(speed, IN_FLIGHT)))
    return usable


def _longest(usable: NDArray[np.bool_], step: float) -> slice:
    whole = longest_run(usable)
    first = whole.start + int(LEAD / step)
    if (whole.stop - first) * step < LEAST:
        raise InputError(f"no {LEAST:g} s of flight with fixes of the GPS all along, {LEAD:g} s behind a launch")
    return slice(first, int(min(whole.stop, first + LONGEST / step)))


def _age(time: Array, inputs: Array, attitude: Array, arrived: Array, velocity: Array) -> float:
    """How old a fix is when it arrives, in s: what is left of the change from fix to fix scatters least.

    The attitude that was told serves for that: over the time between two fixes its error is a constant force.
    """
    step = float(time[1] - time[0])
    gained = np.cumsum(np.einsum("nij,nj->ni", ned_from_frd(attitude), inputs[:, 3:]), axis=0) * step
    inside = (arrived > time[0] + LATEST) & (arrived < time[-1])
    ages = step * np.arange(int(LATEST / step) + 1)
    return float(ages[np.argmin([_scatter(time, gained, arrived[inside] - age, velocity[inside]) for age in ages])])


def _scatter(time: Array, gained: Array, at: Array, velocity: Array) -> float:
    left = velocity - np.column_stack([np.interp(at, time, column) for column in gained.T])
    return float(np.sum(np.var(np.diff(left, axis=0), axis=0)))
