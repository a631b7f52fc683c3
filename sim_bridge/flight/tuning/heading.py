"""Heading loop: proportional from heading error to roll setpoint, the roll loop closed within it, 50 Hz.

The file's integral is kept as it is: the course that is steered has the wind in it already. The roll
setpoint is slewed: in a turn at the greatest bank the error must not shrink faster than that can follow.
"""

from __future__ import annotations

import math

from avionics.guidance import heading
from sim_bridge.flight.tuning import roll
from sim_bridge.flight.tuning.aircraft import Aircraft, loop_delay
from sim_bridge.flight.tuning.altitude import APART
from sim_bridge.flight.tuning.climb import RATE
from sim_bridge.flight.tuning.ranges import greatest
from sim_bridge.tuning import blocks
from sim_bridge.tuning.loop import LoopSpec, Process, Terms, loop_bandwidth, pick, search
from sim_bridge.tuning.margins import GUIDANCE
from wingbeat.constants import STANDARD_GRAVITY


def process(aircraft: Aircraft) -> Process:
    """Build the process of the heading loop; in still air the course equals the yaw."""
    import control

    turn = control.ss([[0.0]], [[1.0]], [[1.0]], [[0.0]], inputs=["yaw_rate"], outputs=["yaw"], name="turn")
    wait = blocks.delay(loop_delay(RATE), "bank_asked", "roll_setpoint")
    whole = blocks.joined([roll.closed(aircraft), turn, wait], ["bank_asked"], ["yaw"])
    return Process(pick(whole, "bank_asked", "yaw"), pick(whole, "bank_asked", "yaw", "yaw"))


def terms(gains: heading.Gains) -> Terms:
    """Return the gains of the loop."""
    return Terms(gains.proportional, gains.integral, 0.0)


def tuned(aircraft: Aircraft) -> Aircraft:
    """Design the heading loop.

    Raises:
        InputError: no gain meets the margins.
    """
    inside = loop_bandwidth(roll.process(aircraft), roll.terms(aircraft))
    ranges = greatest(heading.Gains, "proportional")
    file = aircraft.gains.heading
    steepest = file.roll_rate * aircraft.model.airspeed / (STANDARD_GRAVITY * math.tan(file.roll_max))
    found = search(
        process(aircraft), LoopSpec(inside / APART, False, False, ranges, steepest=steepest, limits=GUIDANCE)
    )
    gains = file._replace(proportional=found.proportional)
    return aircraft._replace(gains=aircraft.gains._replace(heading=gains))
