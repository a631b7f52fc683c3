"""Contact with flat ground: springs, dampers and friction at points of the fuselage."""

from __future__ import annotations

import math

from sim_bridge.compiled import kernel
from sim_bridge.vectors import Floats
from wingbeat.constants import STANDARD_GRAVITY

PENETRATION = 0.01
"""m; chosen: how deep the vehicle's weight presses one point into the ground"""
DAMPING_RATIO = 0.7
"""-; chosen: grass does not bounce"""
FRICTION = 0.6
"""-; chosen: sliding on grass"""
SLIP_SPEED = 0.05
"""m/s; below it friction falls to zero, so that it never reverses within a step"""


@kernel
def ground_force(depth: float, velocity: Floats, weight: float, force: Floats) -> bool:
    """Contact force (3,) in N, NED, at a point ``depth`` m below ground moving at ``velocity`` (3,) NED.

    Returns whether it touches.
    """
    force[0] = force[1] = force[2] = 0.0
    if depth <= 0.0:
        return False
    stiffness = weight / PENETRATION
    damping = 2.0 * DAMPING_RATIO * math.sqrt(stiffness * weight / STANDARD_GRAVITY)
    # Full damping only once the point is in: a force that starts from zero keeps the integrator's order.
    sink = damping * min(depth / PENETRATION, 1.0) * velocity[2]
    normal = max(stiffness * depth + sink, 0.0)
    slip = math.sqrt(velocity[0] ** 2 + velocity[1] ** 2)
    grip = FRICTION * normal / max(slip, SLIP_SPEED)
    force[0] = -grip * velocity[0]
    force[1] = -grip * velocity[1]
    force[2] = -normal
    return True
