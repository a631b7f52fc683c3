"""Gains over the airspeed: a tail turns the vehicle with the dynamic pressure, so less is asked of it in fast flight.

Without it, a loop that keeps 6 dB at the cruise has none left in a glide at 1.4 times its speed.
"""

from __future__ import annotations

from avionics.limits import clip

LEAST, MOST = 0.3, 1.3
"""-; bounds of the share: a wrong airspeed must not take a loop away, nor make one swing near the stall"""


def share(tuned: float, airspeed: float) -> float:
    """Share of gains that hold at the airspeed ``tuned`` (m/s) which does the same at ``airspeed`` (m/s).

    1 where either is not known (0).
    """
    if tuned <= 0.0 or airspeed <= 0.0:
        return 1.0
    ratio = tuned / airspeed
    return clip(ratio * ratio, LEAST, MOST)
