"""Altitude loop: proportional from altitude error to climb setpoint, the climb loop closed within it, 50 Hz.

The climb setpoint is slewed. At the maximum climb toward its altitude, a vehicle must not be commanded to slow down
faster than that, or it overshoots: proportional <= climb_rate_limit / greatest climb setpoint.
"""

from __future__ import annotations

from avionics.guidance import altitude
from sim_bridge.flight.tuning import climb
from sim_bridge.flight.tuning.aircraft import Aircraft, loop_delay
from sim_bridge.flight.tuning.ranges import greatest
from sim_bridge.tuning import blocks
from sim_bridge.tuning.loop import LoopSpec, Process, Terms, loop_bandwidth, pick, search
from sim_bridge.tuning.margins import GUIDANCE

APART = 4.0
"""-; least bandwidth ratio of the inner loop to this one; chosen: 4 to 10 times is usual in cascades"""


def process(aircraft: Aircraft) -> Process:
    """Build the process of the altitude loop; the filter's altitude has no lag."""
    import control

    height = control.ss([[0.0]], [[1.0]], [[1.0]], [[0.0]], inputs=["climb"], outputs=["altitude"], name="height")
    wait = blocks.delay(loop_delay(climb.RATE), "climb_asked", "climb_setpoint")
    whole = blocks.joined([climb.closed(aircraft), height, wait], ["climb_asked"], ["altitude"])
    return Process(pick(whole, "climb_asked", "altitude"), pick(whole, "climb_asked", "altitude", "altitude"))


def terms(gains: altitude.Gains) -> Terms:
    """Return the gains of the loop."""
    return Terms(gains.proportional, 0.0, 0.0)


def tuned(aircraft: Aircraft) -> Aircraft:
    """Design the altitude loop.

    Raises:
        InputError: no gain meets the margins.
    """
    inside = loop_bandwidth(climb.process(aircraft), climb.terms(aircraft.gains.altitude))
    ranges = greatest(altitude.Gains, "proportional")
    file = aircraft.gains.altitude
    steepest = file.climb_rate_limit / max(file.climb_max, file.sink_max)
    found = search(
        process(aircraft), LoopSpec(inside / APART, False, False, ranges, steepest=steepest, limits=GUIDANCE)
    )
    gains = file._replace(proportional=found.proportional)
    return aircraft._replace(gains=aircraft.gains._replace(altitude=gains))
