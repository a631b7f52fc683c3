"""One set of values for drive and membrane fitted to the flights of several wings, and to all but one in turn.

What is fitted to: mean power, greatest plunge speed and stroke amplitude of each flight; that the flight was steady
(the wings' mean thrust is the fuselage's drag, as their lift is the weight); and that a slow stroke is followed. A
weak prior, the same in every fit, holds the values near where the search begins: without it a fit to three wings
would run to the bounds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from sim_bridge.flight_mechanics.wind_tunnel import (
    DENSITY,
    Measures,
    Stream,
    Tunnel,
    fly,
    levelled,
    measure,
    rate_error,
)
from sim_bridge.flight_mechanics.wing_twist import scaled_stiffness
from sim_bridge.mechanism import total_mass
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle
from sim_bridge.vehicles.sections import AsMeasured
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

REFERENCE_CHORD = 0.311
"""m; chord of wing A, whose twist stiffness is a parameter of the fit: the stiffness decreases with its cube"""
POWER_SIGMA, SPEED_SIGMA, AMPLITUDE_SIGMA, LIFT_SIGMA = 0.08, 0.04, 0.12, 0.05
"""-; relative errors of weight 1 in the fit: the first two are its targets"""
THRUST_SIGMA = 0.6
"""N; error of weight 1 in the fit"""
SLOW_SIGMA = 0.05
"""-; `rate_error` of weight 1 in the slow stroke"""
PRIOR_SIGMA = 3.0
"""-; deviation of a parameter from its initial value, as a fraction of its range, of weight 1"""
SLOW_ANGLE = 0.1
"""rad; angle of attack of the slow stroke"""
STEP, ROUNDS, TOLERANCE = 0.02, 25, 1e-3
"""-; of the differences, as fractions of the ranges; of the search"""


class MeasuredFlight(NamedTuple):
    """Steady flight with its measured data."""

    stream: Stream
    power: float
    """W; mean mechanical power of both drives"""
    plunge_speed: float
    """rad/s; maximum"""
    amplitude: float
    """rad; peak to peak"""
    slow: Stream | None = None
    """stroke that the drives follow, None if there is none"""


class Range(NamedTuple):
    """Range and initial value of a parameter of the fit."""

    low: float
    start: float
    high: float
    logarithmic: bool = False


RANGES = {
    "stall_torque": Range(1.5, 3.0, 6.0, True),
    "no_load_speed": Range(13.0, 17.0, 24.0),
    "position_gain": Range(1.5, 4.0, 15.0, True),
    "rate_gain": Range(0.05, 0.6, 2.0, True),
    "twist_stiffness": Range(0.05, 0.2, 0.4, True),
    "washout": Range(-0.5, 0.27, 0.6),
    "stall_angle": Range(0.09, 0.16, 0.5),
}
"""by the fields of `AsMeasured`"""


class WingFit(NamedTuple):
    """Result of a fit."""

    values: AsMeasured
    """of the wing of `REFERENCE_CHORD`"""
    cost: float
    """half the sum of squares"""
    at_bounds: tuple[str, ...]
    """parameters at an end of their range"""


def with_values(vehicle: SimulatedVehicle, values: AsMeasured) -> SimulatedVehicle:
    """Return the vehicle with these values, the twist stiffness converted to its own wing.

    Raises:
        InputError: the vehicle's file has no section [strip_theory].
    """
    if "strip_theory" not in vehicle.sections:
        raise InputError(f"{vehicle.path}: measured values need a section [strip_theory]")
    wing, drive = vehicle.wing, vehicle.drive
    softened = math.sqrt(values.twist_stiffness / wing.twist_stiffness)
    theory = vehicle.sections["strip_theory"]._replace(stall_angle=values.stall_angle)
    return vehicle._replace(
        wing=wing._replace(
            washout=values.washout,
            twist_stiffness=values.twist_stiffness,
            twist_damping=wing.twist_damping * softened,
        ),
        drive=drive._replace(
            stall_torque=values.stall_torque,
            no_load_speed=values.no_load_speed,
            position_gain=values.position_gain,
            rate_gain=values.rate_gain,
        ),
        sections=vehicle.sections | {"strip_theory": theory},
    )


def as_measured(vehicle: SimulatedVehicle) -> SimulatedVehicle:
    """Return the vehicle with the values of its section [as_measured].

    Raises:
        InputError: its file has no such section.
    """
    values = vehicle.sections.get("as_measured")
    if values is None:
        raise InputError(f"{vehicle.path}: no section [as_measured]: this vehicle's wings were not measured")
    return with_values(vehicle, values)


def for_wing(values: AsMeasured, chord: float) -> AsMeasured:
    """Convert a fit's values to a wing of another largest chord in m: equal spars, Gerdes Eq. 13."""
    return values._replace(twist_stiffness=scaled_stiffness(values.twist_stiffness, REFERENCE_CHORD, chord))


def simulate_rows(vehicle: SimulatedVehicle, values: AsMeasured, flight: MeasuredFlight) -> Measures:
    """Simulate the measured quantities of a flight with a fit's values.

    Raises:
        InputError: the lift is below the weight of the vehicle.
    """
    changed = with_values(vehicle, for_wing(values, vehicle.wing.root_chord))
    return measure(fly(changed, flight.stream), flight.stream)


def fit(
    vehicles: Mapping[str, SimulatedVehicle],
    flights: Mapping[str, MeasuredFlight],
    on_progress: Callable[[float], None] = lambda share: None,
) -> WingFit:
    """Fit one set of values to the flights of the vehicles of the same names.

    ``on_progress`` is called before each evaluation with the completed fraction of the maximum number.
    """
    made = itertools.count()

    def residuals(shares: Floats) -> Floats:
        on_progress(next(made) / (ROUNDS * (len(RANGES) + 1)))
        values = from_shares(shares)
        rows = [_residuals(vehicles[name], values, flight) for name, flight in flights.items()]
        return np.concatenate((*rows, (shares - start) / PRIOR_SIGMA))

    start = to_shares({name: one.start for name, one in RANGES.items()})
    found = least_squares(
        residuals, start, bounds=(0.0, 1.0), diff_step=STEP, max_nfev=ROUNDS, ftol=TOLERANCE, xtol=TOLERANCE
    )
    ends = [name for name, share in zip(RANGES, found.x, strict=True) if not 0.01 < share < 0.99]
    return WingFit(from_shares(found.x), float(found.cost), tuple(ends))


def leave_one_out(
    vehicles: Mapping[str, SimulatedVehicle],
    flights: Mapping[str, MeasuredFlight],
    on_progress: Callable[[float, str], None] = lambda share, words: None,
) -> dict[str, Measures]:
    """Simulate each flight with the values fitted to all the others.

    ``on_progress`` is called with the least completed fraction and the flight that is left out.
    """
    found: dict[str, Measures] = {}
    for name, flight in flights.items():
        others = {other: flights[other] for other in flights if other != name}
        first = len(found)

        def progress(share: float, first: int = first, name: str = name) -> None:
            on_progress((first + share) / len(flights), f"{name} left out")

        found[name] = simulate_rows(vehicles[name], fit(vehicles, others, progress).values, flight)
    return found


def to_shares(values: Mapping[str, float]) -> Floats:
    """Convert values to (n,) fractions 0 to 1 of their `RANGES`."""
    return np.array([_share(RANGES[name], values[name]) for name in RANGES])


def from_shares(shares: Floats) -> AsMeasured:
    """Convert fractions 0 to 1 of the `RANGES` to values."""
    return AsMeasured(*[_value(one, share) for one, share in zip(RANGES.values(), shares.tolist(), strict=True)])


def _share(one: Range, value: float) -> float:
    if one.logarithmic:
        return math.log(value / one.low) / math.log(one.high / one.low)
    return (value - one.low) / (one.high - one.low)


def _value(one: Range, share: float) -> float:
    if one.logarithmic:
        return float(one.low * (one.high / one.low) ** share)
    return float(one.low + share * (one.high - one.low))


def _residuals(vehicle: SimulatedVehicle, values: AsMeasured, flight: MeasuredFlight) -> list[float]:
    changed = with_values(vehicle, for_wing(values, vehicle.wing.root_chord))
    stream = flight.stream
    m = measure(levelled(Tunnel(changed, stream)), stream)
    drag = 0.5 * DENSITY * stream.airspeed**2 * vehicle.fuselage.drag_area
    found = [
        (m.positive_power / flight.power - 1.0) / POWER_SIGMA,
        (m.plunge_speed / flight.plunge_speed - 1.0) / SPEED_SIGMA,
        (m.amplitude / flight.amplitude - 1.0) / AMPLITUDE_SIGMA,
        (m.lift / (total_mass(vehicle) * STANDARD_GRAVITY) - 1.0) / LIFT_SIGMA,
        (m.thrust - drag) / THRUST_SIGMA,
    ]
    if flight.slow is not None:
        found.append(rate_error(fly(changed, flight.slow, SLOW_ANGLE)) / SLOW_SIGMA)
    return found
