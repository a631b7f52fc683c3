"""Loads of tail surfaces and fuselage: flat plates at any angle, drag areas."""

from __future__ import annotations

import math

from sim_bridge.compiled import inlined
from sim_bridge.elementary import arctangent, sine_and_cosine
from sim_bridge.vectors import Floats

SEPARATED_NORMAL_FORCE = 1.98
"""-; normal-force coefficient of a plate across the flow (Hoerner), as DeLaurier uses it for stalled sections"""
PLATE_STALL = 0.35
"""rad; chosen: a low-aspect-ratio plate keeps its attached flow to about 20 degrees"""


@inlined
def plate_normal_force(angle: float, lift_slope: float) -> float:
    """Normal-force coefficient of a flat plate at any angle of attack in rad, blended at the stall."""
    sine, cosine = sine_and_cosine(angle)
    attached = lift_slope * sine * cosine
    separated = SEPARATED_NORMAL_FORCE * sine
    share = min(max((abs(angle) - PLATE_STALL) / 0.35 + 0.5, 0.0), 1.0)
    share = share * share * (3.0 - 2.0 * share)
    # Behind 90 degrees the flow comes from the trailing edge: only the separated part remains.
    return (1.0 - share) * attached + share * separated


@inlined
def plate_pressure(along: float, across: float, deflection: float, lift_slope: float, density: float) -> float:
    """Normal pressure in Pa of a surface, positive against ``across``.

    Args:
        along, across: m/s; speed of the surface through the air along its undeflected chord (forward) and
            along its normal.
        deflection: rad; turns the leading edge along the normal's positive sense.
    """
    angle = arctangent(-across, along) + deflection
    square = along * along + across * across
    return 0.5 * density * square * plate_normal_force(angle, lift_slope)


@inlined
def body_drag(speeds: Floats, drag_area: float, side_area: float, density: float, force: Floats) -> None:
    """Fuselage drag (3,) in N, body axes, for its speed (3,) through the air."""
    speed = math.sqrt(speeds[0] ** 2 + speeds[1] ** 2 + speeds[2] ** 2)
    factor = 0.5 * density * speed
    force[0] = -factor * drag_area * speeds[0]
    force[1] = -factor * side_area * speeds[1]
    force[2] = -factor * side_area * speeds[2]
