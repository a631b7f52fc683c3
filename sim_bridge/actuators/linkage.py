"""A motor that drives both wings through gears and a four-bar linkage (Slow Hawk, Grauer 2011).

One side is described, seen from behind: outboard to the right, up. Its crank turns about the origin, the coupler goes
from the crank's pin to the pin of the rocker, and the rocker turns about the wing's hinge with the wing fixed to it.
The other side is its mirror image on a crank of the same size that turns the other way: both wings flap alike.

The loop closes exactly (Freudenstein 1954): with D from crank pin to hinge and e(psi) along the rocker,
D . e(psi) = (coupler^2 - rocker^2 - D^2) / (2 rocker). Of its two solutions a linkage that turns through keeps one.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from sim_bridge.compiled import kernel
from wingbeat.errors import InputError
from wingbeat.units import Quantity

BREAKAWAY = 1.0
"""rad/s; chosen: motor speed below which its friction fades, so that it holds at rest instead of changing sign"""


class FourBar(NamedTuple):
    """Section ``[linkage]`` of a vehicle file; one side."""

    crank: Annotated[float, Quantity("m", 0.0, 1.0)]
    """from its axle to its pin"""
    coupler: Annotated[float, Quantity("m", 0.0, 1.0)]
    """from pin to pin"""
    rocker: Annotated[float, Quantity("m", 0.0, 1.0)]
    """from the wing's hinge to the coupler's pin"""
    hinge_outboard: Annotated[float, Quantity("m", -1.0, 1.0)]
    """of the wing's hinge from the crank's axle"""
    hinge_up: Annotated[float, Quantity("m", -1.0, 1.0)]
    """of the wing's hinge from the crank's axle"""
    horn_angle: Annotated[float, Quantity("rad", -4.0, 4.0)]
    """of the rocker above the wing's spar"""
    upper_assembly: bool
    """the rocker lies counter-clockwise of the line from crank pin to hinge"""


class FlapMotion(NamedTuple):
    """Flap angle of a crank position and its derivative."""

    angle: float
    """rad; flap, wing up positive, -pi to pi"""
    slope: float
    """-; flap rate over crank rate"""


class Motor(NamedTuple):
    """Section ``[motor]`` of a vehicle file: a direct-current motor, or a brushless one behind its controller."""

    torque_constant: Annotated[float, Quantity("N m/A", 1e-6, 10.0)]
    """also the back-EMF in V s/rad"""
    resistance: Annotated[float, Quantity("ohm", 1e-4, 100.0)]
    """of winding and controller"""
    no_load_current: Annotated[float, Quantity("A", 0.0, 50.0)]
    """what its own friction takes"""
    gear_ratio: Annotated[float, Quantity("-", 1.0, 1000.0)]
    """motor turns a crank turn"""
    gear_efficiency: Annotated[float, Quantity("-", 0.05, 1.0)]
    rotor_inertia: Annotated[float, Quantity("kg m^2", 0.0, 1.0)]
    """with what turns at the motor's speed"""


class Drive(NamedTuple):
    """State of the motor at one voltage and crank rate; ``voltage current = torque rate +`` three losses."""

    torque: float
    """N m; on the crank, after the gears"""
    current: float
    """A; never below 0: a controller feeds nothing back"""
    copper_loss: float
    """W"""
    friction_loss: float
    """W; in the motor"""
    gear_loss: float
    """W"""


def checked(linkage: FourBar) -> FourBar:
    """Return the linkage if its crank can rotate fully and its rocker oscillates (Grashof).

    Raises:
        InputError: a length that is not positive, or the link that is too long or too short for the others.
    """
    ground = math.hypot(linkage.hinge_outboard, linkage.hinge_up)
    crank, coupler, rocker = linkage.crank, linkage.coupler, linkage.rocker
    for name, length in (("crank", crank), ("coupler", coupler), ("rocker", rocker), ("hinge's distance", ground)):
        if not (length > 0.0 and math.isfinite(length)):
            raise InputError(f"linkage: {name} {length:g} m is not a length")
    if crank >= ground:
        raise InputError(
            f"linkage: crank {crank:g} m is not shorter than the {ground:g} m to the hinge; the wing would turn round"
        )
    if coupler <= ground + crank - rocker:
        raise InputError(
            f"linkage: coupler {coupler:g} m is too short; it needs more than {ground + crank - rocker:g} m"
        )
    if coupler >= ground - crank + rocker:
        raise InputError(
            f"linkage: coupler {coupler:g} m is too long; it needs less than {ground - crank + rocker:g} m"
        )
    if rocker >= ground - crank + coupler:
        raise InputError(
            f"linkage: rocker {rocker:g} m is too long; it needs less than {ground - crank + coupler:g} m"
        )
    return linkage


@kernel
def rocker_angle(linkage: FourBar, crank_outboard: float, crank_up: float, coupler: float) -> float:
    """Angle in rad from outboard of the rocker that a ``coupler`` in m holds to a pin at these coordinates in m."""
    right, up = linkage.hinge_outboard - crank_outboard, linkage.hinge_up - crank_up
    distance, rocker = math.sqrt(right * right + up * up), linkage.rocker
    along = (coupler * coupler - rocker * rocker - distance * distance) / (2.0 * rocker)
    across = math.sqrt(max((distance - along) * (distance + along), 0.0))
    between = math.atan2(across, along)
    return math.atan2(up, right) + (between if linkage.upper_assembly else -between)


@kernel
def flap_motion(linkage: FourBar, crank_angle: float) -> FlapMotion:
    """Flap angle and its derivative at a crank angle in rad, counter-clockwise from outboard.

    The derivative is that of the closed loop: with R along the coupler from crank pin to rocker pin, t and n the
    directions in which these pins move,  slope = crank t . R / (rocker n . R).
    """
    cosine, sine, crank, rocker = math.cos(crank_angle), math.sin(crank_angle), linkage.crank, linkage.rocker
    psi = rocker_angle(linkage, crank * cosine, crank * sine, linkage.coupler)
    along, up = math.cos(psi), math.sin(psi)
    r_out = linkage.hinge_outboard + rocker * along - crank * cosine
    r_up = linkage.hinge_up + rocker * up - crank * sine
    slope = crank * (cosine * r_up - sine * r_out) / (rocker * (along * r_up - up * r_out))
    flap = psi - linkage.horn_angle
    return FlapMotion(math.atan2(math.sin(flap), math.cos(flap)), slope)


def stroke(linkage: FourBar) -> tuple[float, float]:
    """Lowest and highest flap angle in rad: crank and coupler in one line, stretched and folded."""
    ends = [
        rocker_angle(linkage, 0.0, 0.0, linkage.coupler + crank) - linkage.horn_angle
        for crank in (linkage.crank, -linkage.crank)
    ]
    middle, half = math.remainder(0.5 * (ends[0] + ends[1]), 2.0 * math.pi), 0.5 * abs(ends[0] - ends[1])
    return middle - half, middle + half


@kernel
def drive(motor: Motor, voltage: float, crank_rate: float) -> Drive:
    """Crank torque and current at a mean ``voltage`` in V across the motor and a crank rate in rad/s."""
    speed = motor.gear_ratio * crank_rate
    current = max((voltage - motor.torque_constant * speed) / motor.resistance, 0.0)
    friction = motor.torque_constant * motor.no_load_current * min(max(speed / BREAKAWAY, -1.0), 1.0)
    shaft = motor.torque_constant * current - friction
    # Gears lose from the side that drives: the motor, or the wings when they turn it.
    share = motor.gear_efficiency if shaft * speed >= 0.0 else 1.0 / motor.gear_efficiency
    torque = motor.gear_ratio * shaft * share
    electrical = (voltage - current * motor.resistance) * current
    return Drive(
        torque,
        current,
        current * current * motor.resistance,
        electrical - shaft * speed,
        shaft * speed - torque * crank_rate,
    )
