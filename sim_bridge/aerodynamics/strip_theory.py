"""Modified strip theory (DeLaurier 1993) with Kim's dynamic stall (Kim 2011), as Gerdes 2017 uses it.

Written in section velocities instead of angles over a constant flight speed, so that arbitrary motion works
and the loads stay finite as the airspeed goes to zero. The downwash of the unsteady wake is a first-order lag
a strip, which is the time-domain form of F'(k), G'(k):  C'(k) = 1 - C1 ik / (ik + C2).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from sim_bridge.vectors import Floats, kernel

STALL_BLEND = math.radians(3.0)
"""rad; half width over which attached and separated loads are blended: a hard switch makes the force jump"""
SLOWEST = 0.3
"""m/s; chordwise speed below which the reduced frequency is no longer resolved"""
KINEMATIC_VISCOSITY = 1.46e-5
"""m^2/s; of air at 15 degrees Celsius"""


class StripParameters(NamedTuple):
    """What the section loads need beside the motion; SI."""

    aspect_ratio: float
    zero_lift_angle: float
    suction_efficiency: float
    stall_angle: float
    c1: float
    c2: float
    lift_factor: float


def strip_parameters(
    aspect_ratio: float, zero_lift_angle: float, suction_efficiency: float, stall_angle: float
) -> StripParameters:
    """Constants of the modified Theodorsen function for a wing's aspect ratio (both wings together)."""
    return StripParameters(
        aspect_ratio,
        zero_lift_angle,
        suction_efficiency,
        stall_angle,
        0.5 * aspect_ratio / (2.32 + aspect_ratio),
        0.181 + 0.772 / aspect_ratio,
        aspect_ratio / (2.0 + aspect_ratio),
    )


@kernel
def stall_factor(plunge_angle: float, towards: float, chord: float, speed: float, stall_angle: float) -> float:
    """Kim's dynamic stall factor xi (Gerdes Eq. 8 as corrected): 1 to 2, at most.

    ``plunge_angle`` is |atan(h' cos(theta - theta_a) / V_x)|, ``towards`` the pitch rate in rad/s counted
    positive when it increases the magnitude of the angle of attack.
    """
    pitching = math.copysign(0.51 * math.sqrt(chord * abs(towards) / (2.0 * speed)), towards)
    return max(1.0, min(1.0 + (plunge_angle + pitching) / stall_angle, 2.0))


@kernel
def friction_coefficient(reynolds: float) -> float:
    """Skin friction of both faces of a plate, 0.89 / (log10 Re)^2.58."""
    return float(0.89 / math.log10(max(reynolds, 1000.0)) ** 2.58)


@kernel
def section_loads(motion: Floats, chord: float, density: float, lag: float, p: StripParameters, out: Floats) -> None:
    """Loads a unit span of one section.

    Args:
        motion: (5,) forward speed along the chord; downward speed normal to it of the leading edge by flapping
            alone (h' cos(theta - theta_a)), of the section through the air at 1/2 and at
            3/4 chord, m/s; pitch rate about the span, leading edge up, rad/s.
        lag: m/s; the wake's state.
        out: (6,) normal force at 1/4 chord, normal force at 1/2 chord, chordwise force (forward) in N/m;
            rate of the lag in m/s^2; apparent mass kg/m at 1/2 chord; stalled share 0 to 1.
    """
    along, plunge, half, three_quarter, pitch_rate = motion[0], motion[1], motion[2], motion[3], motion[4]
    speed = max(abs(along), SLOWEST)
    pressure = 0.5 * density * chord
    effective = three_quarter - p.c1 * (three_quarter - lag)
    wash = p.lift_factor * effective
    resultant = math.sqrt(along * along + (wash - 0.5 * chord * pitch_rate) ** 2)
    angle = math.atan2(wash - 0.75 * chord * pitch_rate, speed)
    plunge_angle = abs(math.atan2(plunge, speed))
    towards = pitch_rate if angle >= 0.0 else -pitch_rate
    limit = p.stall_angle * stall_factor(plunge_angle, towards, chord, speed, p.stall_angle)
    stalled = min(max((abs(angle) - limit) / (2.0 * STALL_BLEND) + 0.5, 0.0), 1.0)
    stalled = stalled * stalled * (3.0 - 2.0 * stalled)
    attached = 1.0 - stalled
    circulation = wash + p.zero_lift_angle * along * p.lift_factor
    suction = wash - 0.25 * chord * pitch_rate
    ratio = resultant / speed
    friction = friction_coefficient(speed * chord / KINEMATIC_VISCOSITY) * along * abs(along)
    camber = 2.0 * math.pi * p.zero_lift_angle * wash * resultant
    thrust = p.suction_efficiency * 2.0 * math.pi * suction * suction * ratio
    out[0] = attached * pressure * 2.0 * math.pi * resultant * circulation
    out[1] = stalled * 1.98 * pressure * math.sqrt(along * along + half * half) * half
    out[2] = attached * pressure * (thrust + camber - friction)
    out[3] = 2.0 * speed / chord * p.c2 * (three_quarter - lag)
    out[4] = (1.0 - 0.5 * stalled) * density * math.pi * chord * chord / 4.0
    out[5] = stalled


def frequency_domain_incidence(alpha: complex, k: float, parameters: StripParameters) -> complex:
    """The printed form alpha' = AR/(2+AR) (F'(k) + i G'(k)) alpha for harmonic motion, for checks."""
    lag = 1j * k / (1j * k + parameters.c2)
    return parameters.lift_factor * (1.0 - parameters.c1 * lag) * alpha
