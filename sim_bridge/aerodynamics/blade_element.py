"""Blade elements with separate coefficients for up- and down-stroke (Malladi et al. 2007, Eq. 18).

A section's lift coefficient is proportional to its angle of attack, 2 pi alpha after Azuma; its drag coefficient
is 7 Re^-0.5 after Willmott and Ellington, to which the polar of Eq. 22 and 23 adds K C_L^2. Lift is perpendicular to
the section's velocity through the air and drag along it, so that the law needs no airspeed and stays finite at rest.

The paper stops at small angles. Beyond the stall the section is a plate across the flow (Hoerner), and a flow from
behind meets the trailing edge as its leading edge: with both the loads hold at every angle. What the paper averages
over the strokes (Eq. 19 to 25) belongs to identification.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from sim_bridge.aerodynamics.protocol import (
    FORWARD,
    NOSE_UP,
    UPWARD,
    AerodynamicModel,
    Motion,
    SectionLoads,
    Strips,
    ValidRange,
)
from sim_bridge.aerodynamics.strip_theory import KINEMATIC_VISCOSITY
from sim_bridge.aerodynamics.surfaces import SEPARATED_NORMAL_FORCE
from sim_bridge.compiled import inlined, kernel
from sim_bridge.elementary import arctangent
from sim_bridge.vectors import Floats
from wingbeat.units import Quantity

STALL_BLEND = 0.1
"""rad; chosen: half width over which attached and separated loads are blended, as a hard switch makes a jump"""
TURNING_RATE = 1.0
"""rad/s; chosen: flap rate below which up- and down-stroke are blended, a twentieth of a stroke's greatest"""
LOWEST_REYNOLDS = 1.0
"""-; below it 7 Re^-0.5 is held, for a section at rest"""
PARTS = ("lift", "drag", "induced", "separated")
LIFT, DRAG, INDUCED, SEPARATED = range(len(PARTS))


class BladeElement(NamedTuple):
    """Section ``[blade_element]`` of a vehicle file."""

    lift_slope_up: Annotated[float, Quantity("1/rad", 0.0, 10.0)]
    """of a section during the up-stroke; 2 pi in the paper"""
    lift_slope_down: Annotated[float, Quantity("1/rad", 0.0, 10.0)]
    """of a section during the down-stroke; 2 pi in the paper"""
    drag_factor_up: Annotated[float, Quantity("-", 0.0, 100.0)]
    """of Re^-0.5 during the up-stroke; 7 in the paper"""
    drag_factor_down: Annotated[float, Quantity("-", 0.0, 100.0)]
    """of Re^-0.5 during the down-stroke; 7 in the paper"""
    polar: Annotated[float, Quantity("-", 0.0, 1.0)]
    """K of Eq. 22 and 23; 0 is Eq. 18 as printed"""
    stall_angle: Annotated[float, Quantity("rad", 0.05, 1.4)]
    """beyond which the section is a plate across the flow"""


class BladeParameters(NamedTuple):
    """Kernel arguments, see `BladeElement`."""

    lift_slope_up: float
    lift_slope_down: float
    drag_factor_up: float
    drag_factor_down: float
    polar: float
    stall_angle: float


class SectionCoefficients(NamedTuple):
    """Dimensionless coefficients of one section, referred to q c."""

    lift: float
    """perpendicular to the velocity, of the attached flow"""
    drag: float
    """against the velocity, 7 Re^-0.5"""
    induced: float
    """against the velocity, K C_L^2"""
    separated: float
    """along the section's normal, at mid-chord"""
    stalled: float
    """share 0 to 1"""


def build(settings: BladeElement, strips: Strips) -> BladeParameters:
    """The model's parameters for the wings of a vehicle."""
    return BladeParameters(*settings)


def initial(parameters: BladeParameters, strips: Strips) -> Floats:
    """Return an empty state: the loads depend on the motion alone."""
    return np.zeros(0)


@kernel
def down_stroke_share(flap_rate: float) -> float:
    """Weight of the down-stroke's coefficients, 0 to 1, at a flap rate in rad/s, wing up positive."""
    share = min(max(0.5 - 0.5 * flap_rate / TURNING_RATE, 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share)


@kernel
def stalled_share(incidence: float, stall_angle: float) -> float:
    """Stalled fraction of a section, 0 to 1, at an incidence in rad to the leading edge in the flow."""
    share = min(max(0.5 + 0.5 * (abs(incidence) - stall_angle) / STALL_BLEND, 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share)


@kernel
def section_coefficients(
    angle: float, reynolds: float, down_stroke: float, p: BladeParameters
) -> SectionCoefficients:
    """Coefficients of a section at any angle of attack in rad, -pi to pi.

    ``down_stroke`` is the share of the down-stroke's coefficients, see `down_stroke_share`.
    """
    lift_slope = p.lift_slope_up + down_stroke * (p.lift_slope_down - p.lift_slope_up)
    drag_factor = p.drag_factor_up + down_stroke * (p.drag_factor_down - p.drag_factor_up)
    incidence = angle
    if abs(angle) > 0.5 * math.pi:
        incidence = angle - math.copysign(math.pi, angle)
    stalled = stalled_share(incidence, p.stall_angle)
    lift = (1.0 - stalled) * lift_slope * incidence
    return SectionCoefficients(
        lift,
        drag_factor / math.sqrt(max(reynolds, LOWEST_REYNOLDS)),
        p.polar * lift * lift,
        stalled * SEPARATED_NORMAL_FORCE * math.sin(angle),
        stalled,
    )


@inlined
def loads(
    parameters: BladeParameters, strips: Strips, motion: Motion, density: float, state: Floats, out: SectionLoads
) -> None:
    """Fill ``out``, see `sim_bridge.aerodynamics.protocol` (Malladi Eq. 18)."""
    parts = out.parts
    for i in range(strips.chord.shape[0]):
        chord, along, down = strips.chord[i], motion.along[i], motion.down[i]
        speed = math.sqrt(along * along + down * down)
        share = down_stroke_share(motion.wings[int(strips.wing[i]), 1])
        c = section_coefficients(arctangent(down, along), speed * chord / KINEMATIC_VISCOSITY, share, parameters)
        scale = 0.5 * density * chord * strips.width[i] * speed
        parts[LIFT, FORWARD, i] = scale * c.lift * down
        parts[LIFT, UPWARD, i] = scale * c.lift * along
        parts[DRAG, FORWARD, i] = -scale * c.drag * along
        parts[DRAG, UPWARD, i] = scale * c.drag * down
        parts[INDUCED, FORWARD, i] = -scale * c.induced * along
        parts[INDUCED, UPWARD, i] = scale * c.induced * down
        parts[SEPARATED, UPWARD, i] = scale * c.separated * speed
        # No moment about the aerodynamic centre: a quarter chord behind the edge that leads, mid-chord when stalled.
        lever = math.copysign(0.25 * chord, along) * (1.0 - c.stalled)
        for part in (LIFT, DRAG, INDUCED):
            parts[part, NOSE_UP, i] = lever * parts[part, UPWARD, i]


@kernel
def advance(
    parameters: BladeParameters, strips: Strips, motion: Motion, density: float, state: Floats, dt: float
) -> None:
    """Do nothing: the model has no memory."""


RANGES = (
    ValidRange("advance_ratio", 1.0, math.inf, "chosen: the lift of Eq. 18 is linear, inflow at the tip 57 deg at 1"),
    ValidRange("reynolds", 1e3, 5e5, "Willmott and Ellington 1997, 7 Re^-0.5: from insects to a plate's transition"),
    ValidRange("reduced_frequency", 0.0, 0.8, "chosen: as strip theory without the lag of the wake"),
)
MODEL = AerodynamicModel(
    name="blade_element",
    title="Blade elements with coefficients of up- and down-stroke (Malladi et al. 2007)",
    settings=BladeElement,
    parameters=BladeParameters,
    parts=PARTS,
    build=build,
    initial=initial,
    loads=loads,
    advance=advance,
    ranges=RANGES,
)
