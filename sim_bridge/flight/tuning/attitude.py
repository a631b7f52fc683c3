"""What the pitch and the roll loop share: rate, highest crossover, gains that fall with the dynamic pressure."""

from __future__ import annotations

from typing import TypeVar

from avionics.stabilization import pitch, roll
from avionics.stabilization.dynamic_pressure import share
from sim_bridge.flight.tuning.aircraft import Aircraft
from sim_bridge.flight.tuning.ranges import greatest
from sim_bridge.tuning.loop import LoopSpec, Process, Terms, search

RATE = 100.0
"""Hz; of the loop"""
SHARE = 1.0 / 3.0
"""-; highest crossover over the flapping frequency: at half of it the stroke averages end"""

Gains = TypeVar("Gains", pitch.Gains, roll.Gains)


def terms(gains: pitch.Gains | roll.Gains, airspeed: float) -> Terms:
    """The loop's part of its gains, at ``airspeed`` m/s."""
    strength = share(gains.airspeed, airspeed)
    return Terms(strength * gains.proportional, strength * gains.integral, strength * gains.damping)


def designed(aircraft: Aircraft, process: Process, gains: Gains) -> Gains:
    """The gains with the loop's part designed, for the airspeed of the model.

    Raises:
        InputError: no gains keep the margins.
    """
    fastest = SHARE * aircraft.model.flapping_rate
    ranges = greatest(type(gains), "proportional", "integral", "damping")
    found = search(process, LoopSpec(fastest, True, True, ranges))
    return gains._replace(**found._asdict(), airspeed=aircraft.model.airspeed)
