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
"""-; highest crossover over the flapping frequency: at half of it stroke averages are no longer valid"""

Gains = TypeVar("Gains", pitch.Gains, roll.Gains)


def terms(gains: pitch.Gains | roll.Gains, airspeed: float) -> Terms:
    """Return the gains of the loop at ``airspeed`` m/s."""
    strength = share(gains.airspeed, airspeed)
    return Terms(strength * gains.proportional, strength * gains.integral, strength * gains.damping)


def designed(aircraft: Aircraft, process: Process, gains: Gains) -> Gains:
    """Design the gains of the loop for the airspeed of the model.

    Raises:
        InputError: no gains meet the margins.
    """
    fastest = SHARE * aircraft.model.flapping_rate
    ranges = greatest(type(gains), "proportional", "integral", "damping")
    found = search(process, LoopSpec(fastest, True, True, ranges))
    return gains._replace(**found._asdict(), airspeed=aircraft.model.airspeed)
