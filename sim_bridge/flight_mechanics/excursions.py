"""How far flapping throws the body about its steady flight, and the figures that sum a steady flight up."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim_bridge.flight_mechanics.orbit import Orbit
from sim_bridge.flight_mechanics.stroke_map import INTERVALS, StrokeMap
from sim_bridge.mechanism import total_mass
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.constants import STANDARD_GRAVITY

Range = tuple[float, float]


class Excursions(NamedTuple):
    """Motion of the fuselage over a stroke of an orbit, each (minimum, maximum)."""

    altitude: float
    """m; without the mean climb"""
    heave_speed: Range
    """m/s; along the body's z axis, down positive"""
    pitch: Range
    """rad"""
    pitch_rate: Range
    """rad/s"""
    vertical_acceleration: Range
    """m/s^2; up positive, zero in steady flight; means over a fortieth of the stroke"""


class Figures(NamedTuple):
    """Dimensionless figures of a steady flight, with endurance and range."""

    strouhal: float
    """-; frequency times the tip's vertical stroke over airspeed"""
    reduced_frequency: float
    """-; pi times frequency times largest chord over airspeed"""
    cost_of_transport: float
    """-; electrical power over weight times airspeed"""
    endurance: float
    """s; with a full battery"""
    range: float
    """m; through the air, with a full battery"""


def excursions(vehicle: SimulatedVehicle, orbit: Orbit) -> Excursions:
    """Simulate one stroke of the orbit and return the excursions of the fuselage."""
    stroke = StrokeMap(vehicle)
    stroke.unpack(orbit.state, orbit.inputs)
    rows = [_row(stroke.plant.y)]
    for piece in range(INTERVALS):
        stroke.plant.advance(stroke.controls(piece, orbit.inputs), stroke.around)
        rows.append(_row(stroke.plant.y))
    height, heave, pitch, rate, climb = np.array(rows).T
    level = height - np.linspace(height[0], height[-1], INTERVALS + 1)
    acceleration = np.diff(climb) * orbit.inputs.frequency * INTERVALS
    return Excursions(float(np.ptp(level)), *(_range(column) for column in (heave, pitch, rate, acceleration)))


def figures(vehicle: SimulatedVehicle, orbit: Orbit) -> Figures:
    """Compute the figures of the orbit; endurance and range are infinite for a drive without current."""
    means, frequency = orbit.means, orbit.inputs.frequency
    height = 2.0 * vehicle.wing.semispan * math.sin(min(means.flap_amplitude, math.pi / 2))
    weight = total_mass(vehicle) * STANDARD_GRAVITY
    endurance = vehicle.battery.capacity / means.current if means.current > 0.0 else math.inf
    return Figures(
        frequency * height / means.airspeed,
        math.pi * frequency * vehicle.wing.root_chord / means.airspeed,
        means.electrical_power / (weight * means.airspeed),
        endurance,
        endurance * means.airspeed,
    )


def _row(y: Floats) -> tuple[float, ...]:
    """Height, heave speed, pitch, pitch rate, climb rate of symmetric flight."""
    pitch = 2.0 * math.atan2(y[5], y[3])
    return -y[2], y[9], pitch, y[11], y[7] * math.sin(pitch) - y[9] * math.cos(pitch)


def _range(column: Floats) -> Range:
    return float(np.min(column)), float(np.max(column))
