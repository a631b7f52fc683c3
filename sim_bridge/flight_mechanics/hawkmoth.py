"""The hawkmoth of Han et al. 2017 (Fig. 9-10) at 2.9 and 5.0 m/s: loads over a stroke, and who bears them.

The paper prints airspeed, stroke-plane angle and weight. Its wing motion, third-order series of figures in Willmott &
Ellington (1997), is not printed, nor is the moth's wing: those values are chosen, each for the reason beside it. The
angles follow the text on the angle of attack; the lead of the wing's turn follows insects in general, and
with it stand and fall the rotational share and the sign of its thrust. So the shares are no validation; they show
where the model puts the load.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.protocol import Strips
from sim_bridge.aerodynamics.quasi_steady import MODEL, PARTS, ROTATIONAL, QuasiSteady, build, elliptic_strips
from sim_bridge.flight_mechanics.prescribed import Harmonics, PrescribedStroke, StrokeKinematics, kinematics
from sim_bridge.flight_mechanics.stroke_loads import StrokeLoads, mean_lift_and_thrust, stroke_loads

WEIGHT = 1.995e-3 * 9.81
"""N; published: 1.995 g"""
DENSITY = 1.2
"""kg/m^3; chosen: air of a laboratory"""
WING_LENGTH, MEAN_CHORD, ROOT, STRIPS = 0.0521, 0.0197, 0.05, 20
"""m, m, -, -; chosen: a typical moth of this weight: 10 N/m^2 at an aspect ratio of 5.3, r_2 of 0.52"""
PITCHING_AXIS = 0.25
"""-; chosen: the quarter chord, near which the two ellipses of the printed planform join"""
LEAD = 0.3
"""rad; chosen: wing rotation slightly before stroke reversal, as for insect wings; the value is uncertain and
determines the rotational forces
"""
THIRD = 0.1
"""-; chosen: of the feathering amplitude, third harmonic that flattens it in mid-stroke"""


class HawkmothCase(NamedTuple):
    """Flight condition of the moth."""

    airspeed: float
    """m/s; published"""
    stroke_plane: float
    """rad; published"""
    amplitude: float
    """rad; of the stroke angle, half of peak to peak; chosen: sweeps of 112 and 100 degrees, less when fast"""
    downstroke: float
    """rad; feathering in mid-downstroke; chosen: angles of attack at r_2 near the text's 45 and 10 degrees"""
    upstroke: float
    """rad; feathering in mid-upstroke; chosen: at r_2 within 5 degrees of the inflow: nearly feathered"""
    frequency: float = 25.0
    """Hz; chosen: a hawkmoth's, nearly the same at all speeds"""


CASES = (
    HawkmothCase(2.9, math.radians(44.4), math.radians(56.0), math.radians(-30.0), math.radians(40.0)),
    HawkmothCase(5.0, math.radians(56.3), math.radians(50.0), math.radians(-45.0), math.radians(10.0)),
)


class Shares(NamedTuple):
    """Fractions of the weight, means over a stroke, -."""

    lift: float
    thrust: float
    translational: float
    """contributions to the mean lift, as the next two"""
    rotational: float
    added_mass: float


def hawkmoth_strips() -> Strips:
    """Return the strips of both wings."""
    return elliptic_strips(WING_LENGTH, MEAN_CHORD, ROOT, STRIPS)


def hawkmoth_stroke(case: HawkmothCase) -> PrescribedStroke:
    """Return the motion of the wings; phase 0 is the top of the upstroke."""
    mean = 0.5 * (case.downstroke + case.upstroke)
    # The chosen angles are those of mid-stroke.
    swing = 0.5 * (case.downstroke - case.upstroke) / (math.cos(LEAD) - THIRD)
    feathering = Harmonics(mean, (swing * math.sin(LEAD),), (swing * math.cos(LEAD), 0.0, swing * THIRD))
    return PrescribedStroke(
        case.frequency,
        case.stroke_plane,
        Harmonics(0.0, (case.amplitude,)),
        feathering=feathering,
        axis=PITCHING_AXIS,
    )


def hawkmoth_kinematics(case: HawkmothCase, phases: int = 200) -> StrokeKinematics:
    """Compute the motion through still air, body level."""
    body = np.array([case.airspeed, 0.0, 0.0, 0.0, 0.0, 0.0])
    return kinematics(hawkmoth_stroke(case), hawkmoth_strips(), body, phases)


def hawkmoth_loads(case: HawkmothCase, phases: int = 200) -> StrokeLoads:
    """Compute the loads of both wings by `quasi_steady`."""
    strips = hawkmoth_strips()
    parameters = build(QuasiSteady(PITCHING_AXIS), strips)
    return stroke_loads(MODEL, parameters, strips, hawkmoth_kinematics(case, phases), DENSITY)


def shares(loads: StrokeLoads) -> Shares:
    """Compute the contributions to the weight."""
    mean = mean_lift_and_thrust(loads)
    lift, thrust = float(np.sum(mean.lift)), float(np.sum(mean.thrust))
    translational = float(np.sum(mean.lift[:ROTATIONAL]))
    added = float(mean.lift[len(PARTS)])
    return Shares(
        lift / WEIGHT,
        thrust / WEIGHT,
        translational / lift,
        float(mean.lift[ROTATIONAL]) / lift,
        added / lift,
    )
