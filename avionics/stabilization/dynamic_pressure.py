"""Gain scheduling of the attitude loops with the dynamic pressure.

The control moment of a tail is proportional to the dynamic pressure, so that the gains are reduced at high airspeed.
With constant gains, a loop with a gain margin of 6 dB at cruise has none in a glide at 1.4 times the cruise airspeed.
"""

from __future__ import annotations

from avionics.limits import clip

LEAST, MOST = 0.3, 1.3
"""-; limits of the factor: a wrong airspeed must neither disable a loop nor destabilize it near the stall"""


def share(tuned: float, airspeed: float) -> float:
    """Return the gain factor at ``airspeed`` for gains tuned at ``tuned`` (m/s).

    The factor is 1 if one of them is unknown (0).
    """
    if tuned <= 0.0 or airspeed <= 0.0:
        return 1.0
    ratio = tuned / airspeed
    return clip(ratio * ratio, LEAST, MOST)
