"""The vibration section of a vehicle applied to the plant and the sensors of one flight."""

from __future__ import annotations

from sim_bridge import plant_kernel as k
from sim_bridge.observation import Vector
from sim_bridge.plant import Plant
from sim_bridge.sensors.noise import sensor_seed
from sim_bridge.vehicles import SimulatedVehicle
from sim_bridge.vibration.airframe import AirframeVibration
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

STREAM = 10
"""number of the random stream, beside those of the sensors"""
GAUSS_PER_MICROTESLA = 0.01
MOST = 100.0
"""-; factor of the vibration of a flight"""


def vibration_factor(vehicle: SimulatedVehicle, factor: float | None) -> float:
    """Return the factor of the vibration of a flight.

    Args:
        vehicle: with or without a section [vibration].
        factor: of the vehicle file's levels; None: 1 with the section and 0 without it.

    Raises:
        InputError: the factor is no number from 0 to 100, or above 0 and the vehicle file has no section [vibration].
    """
    if factor is None:
        return 1.0 if "vibration" in vehicle.sections else 0.0
    if not 0.0 <= factor <= MOST:
        raise InputError(f"vibration must be a factor from 0 (none) to {MOST:g}, not {factor:g}")
    if factor > 0.0 and "vibration" not in vehicle.sections:
        raise InputError(f"{vehicle.path}: no section [vibration]: it flies with --vibration none only")
    return factor


def vibration_of(vehicle: SimulatedVehicle, factor: float, seed: int, period: float) -> AirframeVibration | None:
    """Return the vibration of one flight, None for a factor of 0.

    Args:
        vehicle: with its section [vibration].
        factor: of the vehicle file's levels.
        seed: of the flight.
        period: s; sensor tick.

    Raises:
        InputError: the vehicle has no section [vibration].
    """
    if vibration_factor(vehicle, factor) <= 0.0:
        return None
    clipping = vehicle.sections["accelerometer"].range_g * STANDARD_GRAVITY
    spec = vehicle.sections["vibration"]
    return AirframeVibration(spec, vehicle.modes, sensor_seed(seed, STREAM), period, clipping, factor)


def make_unequal(plant: Plant, vehicle: SimulatedVehicle, factor: float) -> None:
    """Give the two wings of a plant the differences of the vehicle file times a factor.

    Raises:
        InputError: unequal strokes of wings that neither servos nor a crank drive.
    """
    spec, p = vehicle.sections["vibration"], plant.parameters
    wings, joints = p.wings, p.joints
    if spec.stroke_difference and (p.drive_kind == k.LINKAGE or k.WING not in joints.kind):
        raise InputError(f"{vehicle.path}: vibration.stroke_difference needs servos or a crank that drive the wings")
    stroke = 1.0 + 0.5 * factor * spec.stroke_difference * wings.side  # left, right
    p.servo_gain[:] *= stroke
    p.crank_amplitude[wings.flap] *= stroke
    for wing, side in enumerate(wings.side):
        ratio = 1.0 + 0.5 * side * factor * spec.membrane_difference
        wings.washout[wing] += 0.5 * side * factor * spec.washout_difference
        wings.membrane[wings.first[wing] : wings.first[wing + 1]] *= ratio
        if wings.twist[wing] >= 0:
            joints.stiffness[wings.twist[wing]] *= ratio


def field_per_ampere(vehicle: SimulatedVehicle, factor: float) -> Vector:
    """Return the field of the drive current at the magnetometer in gauss/A, body axes."""
    x, y, z = (factor * GAUSS_PER_MICROTESLA * value for value in vehicle.sections["vibration"].magnetic_field)
    return x, y, z
