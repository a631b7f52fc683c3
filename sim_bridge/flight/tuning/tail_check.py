"""Parameters of the jammed-tail detector from the linear model."""

from __future__ import annotations

from avionics.gains import FlightGains
from sim_bridge.tuning.model import LinearModel

EFFECT_FRACTION = 1.0 / 6.0
"""-; fraction of the elevator effectiveness that the detector expects. In gusts the pitch loop moves the elevator
against the disturbance, so the response to the elevator is below M_delta.
"""
KEYS = ("tail_check.effect", "tail_check.damping")
PITCH_RATE = 2
"""index of the pitch rate in the state of a `LinearModel`"""


def tuned(model: LinearModel, gains: FlightGains) -> FlightGains:
    """Return the gains with the detector's effect and damping of the model.

    The effect is the fraction `EFFECT_FRACTION` of |M_delta| / V^2, the damping is -M_q, or 0 for an M_q above 0.
    """
    effect = EFFECT_FRACTION * abs(float(model.elevator[PITCH_RATE])) / model.airspeed**2
    damping = max(-float(model.a[PITCH_RATE, PITCH_RATE]), 0.0)
    check = gains.tail_check._replace(effect=float(f"{effect:.3g}"), damping=float(f"{damping:.3g}"))
    return gains._replace(tail_check=check)
