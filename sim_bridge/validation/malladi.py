"""Malladi, Krashanitsa, Silin, Shkarayev 2007: planform, throttle map and short period of the 100 cm ornithopter."""

from __future__ import annotations

import math

import numpy as np

from sim_bridge.flight_mechanics.averaged import AveragedModel, short_period_of, stroke_averaged_model
from sim_bridge.flight_mechanics.orbit import trim
from sim_bridge.flight_mechanics.stroke_map import throttle_for
from sim_bridge.mechanism import wing_strips
from sim_bridge.plant_kernel import crank_frequency
from sim_bridge.validation.row import Check, Row, compare, compare_share, figure, fitted
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import load_vehicle

VEHICLE = "arizona_100cm"
AREA = 0.1571
"""m^2; of both wings, Table 1"""
TABLE_2 = ((0.25, 2.0, 2.5), (0.5, 4.5, 5.0), (0.75, 5.5, 6.0), (1.0, 7.0, 7.5))
"""throttle, range of the flapping frequency in Hz"""
PERIOD = (0.8, 1.25)
"""s; "about 1 sec", and the band of 1 to 1.25 Hz of the pitch spectrum"""
HALF = 2.0
"""s; "about 2 sec" to half amplitude"""
DAMPING = 0.055
"""-; of a period of 1 s that halves in 2 s"""
THROTTLE, SLOW = 0.35, 0.23
"""-, Hz; of the hands-off flight"""
SPEED = "at 8 m/s, which the paper shows in Fig. 6, and with a chosen stroke"
MODE = "the phugoid of the stroke-averaged motion; the paper saw this peak but, in 10 s, no phugoid"
INERTIA = "the pitch inertia is not printed: the vehicle's was chosen for a period of about 1.1 s"
LIGHT = (
    "no damping as light as this comes out of wings and tail of this size (0.3 at the least over tail areas and"
    " arms): the paper's flight is hands-off at constant throttle, and its oscillation, as it says, established"
    " qualitatively only"
)


def vehicle_rows() -> list[Row]:
    """Compare planform and Table 2, from which the vehicle file is made."""
    vehicle = load_vehicle(VEHICLE)
    strips, _ = wing_strips(vehicle.wing)
    area = figure("Table 1", "planform of both wings, elliptic chord", "m^2", AREA)
    table = np.array(vehicle.drive.frequencies)
    return [
        compare_share(area, float(strips.chord @ strips.width), 0.002),
        *(
            compare(
                figure("Table 2", f"flapping frequency at {100.0 * throttle:.0f} % throttle", "Hz", low, high),
                float(crank_frequency(throttle, table)),
                why="an input: the vehicle has the middle of the range",
            )
            for throttle, low, high in TABLE_2
        ),
    ]


def flight_rows() -> list[Row]:
    """Compare throttle and longitudinal modes of level flight with the hands-off flight."""
    vehicle = load_vehicle(VEHICLE)
    orbit = trim(vehicle, vehicle.cruise.airspeed, vehicle.cruise.climb_rate)
    model = stroke_averaged_model(vehicle, orbit)
    return [
        compare(
            figure("IV.B", "cruise throttle", "-", THROTTLE),
            throttle_for(orbit.inputs.frequency, vehicle),
            0.05,
            SPEED,
        ),
        compare_share(
            figure("Fig. 9", "major peak of the pitch spectrum", "Hz", SLOW), slow_frequency(model.a), 0.15, MODE
        ),
        *short_period_rows(model),
    ]


def slow_frequency(a: Floats) -> float:
    """Compute the frequency in Hz of the slowest oscillation of a state matrix."""
    rates = [abs(root.imag) for root in np.linalg.eigvals(a).astype(complex) if abs(root.imag) > 1e-6]
    return min(rates, default=0.0) / (2.0 * math.pi)


def short_period_rows(model: AveragedModel) -> list[Row]:
    """Compare the short period with fixed controls, of the stroke-averaged motion about cruise."""
    mode = short_period_of(model)
    swing = mode.natural_frequency * math.sqrt(max(1.0 - mode.damping**2, 1e-12))
    half = math.log(2.0) / (mode.damping * mode.natural_frequency)
    return [
        fitted(figure("Fig. 8 and 9", "short period: period", "s", *PERIOD), 2.0 * math.pi / swing, INERTIA),
        compare_share(figure("Fig. 8", "short period: time to half", "s", HALF), half, 0.5, LIGHT),
        compare_share(figure("Fig. 8", "short period: damping ratio", "-", DAMPING), mode.damping, 0.5, LIGHT),
    ]


CHECKS = (Check("planform and throttle", vehicle_rows), Check("hands-off flight", flight_rows, slow=True))
