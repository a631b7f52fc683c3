"""Report of a steady flight and its modes."""

from __future__ import annotations

import math

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from groundstation.views import wording
from sim_bridge.flight_mechanics.excursions import Excursions, Figures
from sim_bridge.flight_mechanics.orbit import Orbit
from sim_bridge.flight_mechanics.stroke_map import throttle_for
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.constants import STANDARD_GRAVITY

UNMODELLED = "not modelled: the wings' motion is prescribed, without a drive that would draw current"


def flight_heading(vehicle: SimulatedVehicle, orbit: Orbit) -> Text:
    """Return vehicle and flight condition."""
    means = orbit.means
    climb = f"climbing {means.climb_rate:+.2f} m/s" if abs(means.climb_rate) > 5e-3 else "level"
    flown = f"{means.airspeed:.2f} m/s, {climb}, air loads by {vehicle.aerodynamics.model}"
    return Text.assemble((vehicle.title, "bold"), "\n", flown)


def trim_table(vehicle: SimulatedVehicle, orbit: Orbit, moved: Excursions, numbers: Figures) -> RenderableType:
    """Return settings of drive and tail, power and vibration of the flight as a table."""
    table = Table.grid(padding=(0, 3))
    table.add_column(style="dim", min_width=9)
    table.add_column()
    means, travel = orbit.means, vehicle.tail_servo.travel
    angles = (
        f"pitch {wording.angle(means.pitch, '+.1f')}   angle of attack {wording.angle(means.angle_of_attack, '+.1f')}"
    )
    elevator = f"{wording.angle(orbit.inputs.elevator, '+.1f')} of ±{wording.angle(travel, '.0f')}"
    rows = (
        ("drive", drive_words(vehicle, orbit)),
        ("elevator", elevator),
        ("attitude", angles),
        *(_cost(orbit, numbers) if draws_current(vehicle) else (("power", UNMODELLED),)),
        ("wings", _wings(orbit, numbers)),
        ("body", _body(moved)),
    )
    for label, text in rows:
        table.add_row(label, text)
    return table


def drive_words(vehicle: SimulatedVehicle, orbit: Orbit) -> str:
    """Describe the drive's setting and the resulting stroke."""
    inputs = orbit.inputs
    achieved = f"stroke ±{wording.angle(orbit.means.flap_amplitude, '.1f')}"
    if vehicle.drive.kind == "servo":
        commanded = (
            f"±{wording.angle(inputs.amplitude, '.1f')} about {wording.angle(vehicle.cruise.stroke_mean, '+.1f')}"
        )
        return f"flapping at {inputs.frequency:.2f} Hz   {commanded} commanded   {achieved} achieved"
    throttle = inputs.throttle if vehicle.drive.kind == "linkage" else throttle_for(inputs.frequency, vehicle)
    return f"flapping at {inputs.frequency:.2f} Hz   throttle {wording.percent(throttle)}   {achieved}"


def draws_current(vehicle: SimulatedVehicle) -> bool:
    """Return whether the drive has a torque; otherwise the wing motion is prescribed and its power given."""
    return vehicle.drive.kind == "linkage" or vehicle.drive.stall_torque > 0.0


def _cost(orbit: Orbit, numbers: Figures) -> tuple[tuple[str, str], ...]:
    return ("power", _power(orbit)), ("economy", _economy(numbers))


def _power(orbit: Orbit) -> str:
    means = orbit.means
    electrical, mechanical = (
        f"{means.electrical_power:.3g} W electrical",
        f"{means.mechanical_power:.3g} W mechanical",
    )
    return f"{electrical}   {means.current:.3g} A   {mechanical}   {means.torque:.3g} N m a drive"


def _economy(numbers: Figures) -> str:
    if not math.isfinite(numbers.endurance):
        return "the drive draws no current"
    charge = f"{wording.duration(numbers.endurance)} and {numbers.range / 1e3:.1f} km on a charge"
    return f"{charge}   cost of transport {numbers.cost_of_transport:.2f}"


def _wings(orbit: Orbit, numbers: Figures) -> str:
    rate = f"fastest {orbit.means.flap_rate:.1f} rad/s"
    return f"{rate}   Strouhal number {numbers.strouhal:.2f}   reduced frequency {numbers.reduced_frequency:.2f}"


def _body(moved: Excursions) -> str:
    low, high = (value / STANDARD_GRAVITY for value in moved.vertical_acceleration)
    heave = (
        f"heaves {moved.altitude * 1e3:.3g} mm, {moved.heave_speed[0]:+.2f} to {moved.heave_speed[1]:+.2f} m/s down"
    )
    pitch = " to ".join(wording.angle(value, "+.1f") for value in moved.pitch)
    return f"{heave}   pitches {pitch}   shaken by {low:+.1f} to {high:+.1f} g"
