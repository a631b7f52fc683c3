"""Published flights of ornithopters, and the laws that predict cruise speed and power of another one.

The cruise speed follows from the Strouhal number: frequency times vertical travel of a wing tip over airspeed, which
cruising flyers keep within narrow limits (Taylor, Nudds, Thomas, Nature 425, 2003). The electrical power is in
proportion to weight times that tip speed, so that the cost of transport is in proportion to the Strouhal number.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from sim_bridge.vehicles.scaling import NewBird

LOADED_VOLTAGE = 8.0
"""V; at which Gerdes Eq. 12 gives the powers of Table 7 from the currents of Table 4; the paper prints no voltage"""
POWER_ERROR = 0.3
"""-; relative standard error of a predicted power; the four published ones scatter by 8 %, but are of one airframe"""


class PublishedFlight(NamedTuple):
    """One steady flight with its source."""

    bird: NewBird
    airspeed: float
    """m/s"""
    power: float | None
    """W; electrical, None if not published"""
    source: str


def _gerdes(wing: str, mass: float, semispan: float, area: float, stroke: float, airspeed: float,
            current: float) -> tuple[str, PublishedFlight]:  # fmt: skip
    """Robo Raven II with one of its wings; ``area`` of one wing, ``stroke`` peak to peak, tail as of the vehicle."""
    bird = NewBird(mass, 2.0 * semispan, 2.0 * area, 0.5 * stroke, 4.0, 0.06, 0.42, 2, 0.74)
    source = "Gerdes, Bruck, Gupta 2017, Tables 3 and 4; 4 Hz"
    return f"Robo Raven II, wing {wing}", PublishedFlight(bird, airspeed, LOADED_VOLTAGE * current, source)


FLIGHTS: dict[str, PublishedFlight] = dict((
    _gerdes("A", 0.312, 0.527, 0.113, 1.137, 5.54, 2.54),
    _gerdes("B", 0.329, 0.622, 0.171, 1.062, 4.80, 2.85),
    _gerdes("C", 0.329, 0.667, 0.210, 1.049, 6.42, 2.93),
    _gerdes("D", 0.359, 0.762, 0.280, 1.032, 7.75, 3.26),
    ("Slow Hawk", PublishedFlight(NewBird(0.45, 1.2, 0.3, 0.53, 5.91, 0.04, 0.45, 3, 1.32), 9.2, None,
                                  "Grauer, Ulrich, Hubbard, Pines, Humbert 2011, sections II and V.A")),
    ("0.9 kg with PX4", PublishedFlight(NewBird(0.904, 1.4, 0.3556, 0.5236, 3.81, 0.07, 0.55, 3, 2.2), 6.46, None,
                                        "dAnte-9029/flap-system-identification and QgcLogs, log 21 of 2026-03-03")),
))  # fmt: skip
"""by name"""


class Prediction(NamedTuple):
    """Predicted cruise of a new vehicle, each number with its relative standard error."""

    airspeed: float
    """m/s"""
    airspeed_error: float
    power: float
    """W; electrical"""
    power_error: float


def predict(bird: NewBird, without: str = "") -> Prediction:
    """Predict airspeed and electrical power of level cruise from the published flights but ``without``.

    Means are geometric. The error of the airspeed is the standard deviation of the Strouhal numbers, with the error
    of their mean.
    """
    flights = [flight for name, flight in FLIGHTS.items() if name != without]
    strouhal = [math.log(one.bird.tip_speed / one.airspeed) for one in flights]
    mean = sum(strouhal) / len(strouhal)
    variance = sum((one - mean) ** 2 for one in strouhal) / (len(strouhal) - 1) * (1.0 + 1.0 / len(strouhal))
    costs = [math.log(one.power / (one.bird.weight * one.bird.tip_speed)) for one in flights if one.power is not None]
    power = math.exp(sum(costs) / len(costs)) * bird.weight * bird.tip_speed
    return Prediction(bird.tip_speed / math.exp(mean), math.sqrt(variance), power, POWER_ERROR)
