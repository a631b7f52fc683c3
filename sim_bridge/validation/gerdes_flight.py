"""Robo Raven II at the speeds and climbs of Table 4: trims, one set of values, and power balances.

`ONE_SET` was fitted to power, plunge speed and stroke of the four wings in the stream and to their thrust balance:
climb and fuselage drag. Washout, suction efficiency and drag area are at the bounds of the fit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from sim_bridge.aerodynamics.surfaces import SEPARATED_NORMAL_FORCE
from sim_bridge.flight_mechanics.orbit import trim
from sim_bridge.flight_mechanics.stroke_map import StrokeMeans
from sim_bridge.flight_mechanics.wind_tunnel import DENSITY, Measures, Tunnel, levelled, measure, stiffened
from sim_bridge.flight_mechanics.wing_fit import REFERENCE_CHORD
from sim_bridge.flight_mechanics.wing_twist import scaled_stiffness
from sim_bridge.validation.gerdes_tables import WINGS, WingFigures
from sim_bridge.validation.gerdes_wings import stream, vehicles
from sim_bridge.validation.row import Row, compare_share, figure, fitted, unreproducible
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

GAP = 0.15
"""-; chosen: relative difference up to which a figure counts as reproduced"""
THRUST_GAP = 0.15
"""N; limit of the thrust balance, its weight in the fit"""


class WingSet(NamedTuple):
    """Values of drive, wing and fuselage that all four vehicles have in common."""

    washout: float
    """rad"""
    twist_stiffness: float
    """N m/rad; of wing A, scaled with the cube of the chord (Eq. 13)"""
    stall_angle: float
    """rad; raised by Kim's factor"""
    suction_efficiency: float
    """-"""
    zero_lift_angle: float
    """rad; camber of the membrane"""
    drag_area: float
    """m^2; of the fuselage"""
    stall_torque: float
    """N m; of one servo, as the next"""
    no_load_speed: float
    """rad/s"""
    position_gain: float
    """N m/rad"""
    rate_gain: float
    """N m s/rad"""


ONE_SET = WingSet(0.6, 0.146, 0.153, 1.0, 0.14, 0.003, 2.9, 16.93, 13.1, 1.78)
SHIPPED = "the vehicle file as it flies: less stroke and power than measured carry and propel it"
SET_FLIGHT = "one set for bench and flight; power net of what the wings give back"
SET_BENCH = "one set of ten values for four wings, fitted to these figures and to the thrust balance"
PLATE = "a rigid wing at the printed body angle: its normal force 1.98 sin(alpha) alone"
BOUND = "momentum theory and climb, no drag: the rest of the measured power is drag and loss"
NO_TRIM = "no trim was found with this set"


def with_set(vehicle: SimulatedVehicle, values: WingSet = ONE_SET) -> SimulatedVehicle:
    """Return the vehicle with a set; the ratio of the twist's damping stays."""
    stiffness = scaled_stiffness(values.twist_stiffness, REFERENCE_CHORD, vehicle.wing.root_chord)
    damping = vehicle.wing.twist_damping * math.sqrt(stiffness / vehicle.wing.twist_stiffness)
    theory = vehicle.sections["strip_theory"]._replace(
        zero_lift_angle=values.zero_lift_angle,
        suction_efficiency=values.suction_efficiency,
        stall_angle=values.stall_angle,
    )
    return vehicle._replace(
        wing=vehicle.wing._replace(washout=values.washout, twist_stiffness=stiffness, twist_damping=damping),
        drive=vehicle.drive._replace(
            stall_torque=values.stall_torque,
            no_load_speed=values.no_load_speed,
            position_gain=values.position_gain,
            rate_gain=values.rate_gain,
        ),
        sections=vehicle.sections | {"strip_theory": theory},
        fuselage=vehicle.fuselage._replace(drag_area=values.drag_area),
    )


def bench_stroke(wing: str, vehicle: SimulatedVehicle) -> Measures:
    """Simulate the commanded stroke in the stream of Table 4, lift closest to the weight."""
    return measure(levelled(Tunnel(vehicle, stream(wing))), stream(wing))


def ideal_stroke(wing: str, vehicle: SimulatedVehicle) -> Measures:
    """Simulate the measured stroke as a sine by ideal drives in the stream of Table 4, lift closest to the weight."""
    sine = stream(wing)._replace(amplitude=0.5 * WINGS[wing].amplitude)
    return measure(levelled(Tunnel(stiffened(vehicle), sine)), sine)


def propulsive_efficiency(wing: str, stroke: Measures) -> float:
    """Compute thrust times airspeed over net mechanical power."""
    return stroke.thrust * WINGS[wing].airspeed / stroke.net_power


def flight(wing: str, vehicle: SimulatedVehicle) -> StrokeMeans | None:
    """Trim at the airspeed and climb rate of Table 4; None without a trim."""
    try:
        return trim(vehicle, WINGS[wing].airspeed, WINGS[wing].climb_rate).means
    except InputError:
        return None


def dynamic_pressure(wing: WingFigures) -> float:
    """Compute the dynamic pressure in Pa of the flight of Table 4."""
    return 0.5 * DENSITY * wing.airspeed**2


def needed_thrust(wing: WingFigures, drag_area: float) -> float:
    """Compute the thrust in N along the path that climb and a drag area in m^2 need."""
    climb = wing.weight * STANDARD_GRAVITY * wing.climb_rate / wing.airspeed
    return climb + drag_area * dynamic_pressure(wing)


def least_power(wing: WingFigures) -> float:
    """Compute a lower bound in W of the flight's power: climb, and induced power W^2 / (2 rho V A) (Betz).

    A is the circle over the span, 2 semispans.
    """
    weight = wing.weight * STANDARD_GRAVITY
    disk = math.pi * wing.semispan**2
    return weight * wing.climb_rate + weight**2 / (2.0 * DENSITY * wing.airspeed * disk)


def plate_loads(wing: WingFigures) -> tuple[float, float]:
    """Compute lift and drag in N of both wings as rigid plates at the angle of attack of Table 4."""
    angle = wing.angle_of_attack
    normal = SEPARATED_NORMAL_FORCE * math.sin(angle) * dynamic_pressure(wing) * 2.0 * wing.area
    return normal * math.cos(angle), normal * math.sin(angle)


def balance_rows() -> list[Row]:
    """Compare what Tables 3, 4 and 7 print of each flight with balances of lift and power."""
    rows = []
    for name, wing in WINGS.items():
        lift, drag = plate_loads(wing)
        weight = wing.weight * STANDARD_GRAVITY
        carried = figure("Table 3, 4", f"lift at the printed incidence over weight, wing {name}", "-", 1.0)
        power = figure("Table 4, 7", f"drag power at the printed incidence, wing {name}", "W", wing.power)
        least = figure("Table 4, 7", f"least power of the flight, wing {name}", "W", wing.power)
        rows += [
            unreproducible(carried, lift / weight, PLATE),
            unreproducible(power, drag * wing.airspeed, PLATE),
            unreproducible(least, least_power(wing), BOUND),
        ]
    return rows


def _flight_rows(wing: str, vehicle: SimulatedVehicle, kind: str, why: str) -> list[Row]:
    """Compare stroke and power of the trim with Tables 4 and 7."""
    printed, means = WINGS[wing], flight(wing, vehicle)
    stroke = figure("Table 4", f"stroke in flight, {kind}, wing {wing}", "rad", printed.amplitude)
    power = figure("Table 7", f"power in flight, {kind}, wing {wing}", "W", printed.power)
    if means is None:
        return [unreproducible(one, None, NO_TRIM) for one in (stroke, power)]
    return [
        compare_share(stroke, 2.0 * means.flap_amplitude, GAP, why),
        compare_share(power, means.mechanical_power, GAP, why),
    ]


def flight_rows() -> list[Row]:
    """Compare the trims of the vehicle files and of the one set."""
    rows = []
    for wing, vehicle in vehicles().items():
        rows += _flight_rows(wing, vehicle, "vehicle file", SHIPPED)
        rows += _flight_rows(wing, with_set(vehicle), "one set", SET_FLIGHT)
    return rows


def bench_set_rows() -> list[Row]:
    """Compare the one set in the stream, at the commanded stroke, with Tables 4 and 7 and the thrust balance."""
    rows = []
    for wing, vehicle in vehicles().items():
        printed, found = WINGS[wing], bench_stroke(wing, with_set(vehicle))
        balance = found.thrust - needed_thrust(printed, ONE_SET.drag_area)
        values = (
            ("Table 7", "power", "W", printed.power, found.positive_power, None),
            ("Table 7", "plunge speed", "rad/s", printed.plunge_speed, found.plunge_speed, None),
            ("Table 4", "stroke", "rad", printed.amplitude, found.amplitude, None),
            ("Table 4", "thrust balance", "N", 0.0, balance, THRUST_GAP),
        )
        for where, quantity, unit, value, computed, limit in values:
            name = f"{quantity} in the stream, one set, wing {wing}"
            rows.append(fitted(figure(where, name, unit, value), computed, SET_BENCH, limit))
    return rows
