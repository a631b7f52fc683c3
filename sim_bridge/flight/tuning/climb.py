"""Climb loop: throttle, the drive's lag, the climb rate averaged over a stroke, sampled at 50 Hz.

The pitch loop is closed within it; the feed-forwards from the climb setpoint to throttle and pitch are the file's; so
is the pitch's answer to the climb error, which is part of the loop: that is cut where the climb rate is measured.
"""

from __future__ import annotations

from typing import Any

from avionics.guidance import altitude
from sim_bridge.flight.tuning import pitch
from sim_bridge.flight.tuning.aircraft import Aircraft, loop_delay
from sim_bridge.flight.tuning.ranges import greatest
from sim_bridge.tuning import blocks
from sim_bridge.tuning.loop import LoopSpec, Process, Terms, pick, search
from sim_bridge.tuning.margins import GUIDANCE
from wingbeat.errors import InputError

RATE = 50.0
"""Hz; of the loop"""
SHARE = 0.1
"""-; highest crossover over the flapping frequency: the mean thrust of a stroke is known at its end"""


def system(aircraft: Aircraft) -> Any:
    """Build the system from throttle_asked, pitch_asked and climb_setpoint to climb and the measured variables."""
    gains, wait = aircraft.gains.altitude, loop_delay(RATE)
    parts = [
        pitch.closed(aircraft),
        blocks.delay(wait, "throttle_asked", "throttle"),
        blocks.gain(gains.throttle_climb, "climb_setpoint", "throttle_asked"),
        blocks.delay(wait, "pitch_asked", "pitch_setpoint"),
        blocks.gain(gains.pitch_climb, "climb_setpoint", "pitch_asked"),
        blocks.stroke_mean(aircraft.model.frequency, "climb", "climb_seen"),
    ]
    return blocks.joined(parts, ["throttle_asked", "pitch_asked", "climb_setpoint"], ["climb", "climb_seen"])


def process(aircraft: Aircraft) -> Process:
    """Build the process of the climb loop: its damping is the pitch response to the climb error."""
    import control

    whole, answer = (
        system(aircraft),
        blocks.gain(aircraft.gains.altitude.pitch_error, "climb_setpoint", "pitch_asked"),
    )
    ahead = blocks.joined([whole, answer], ["climb_setpoint"], ["climb"])
    # Two inputs, one output, transposed: the loop responses are equal, with one input and two outputs.
    paths = whole[["climb_seen"], ["throttle_asked", "pitch_asked"]]
    sensed = control.ss(paths.A.T, paths.C.T, paths.B.T, paths.D.T)
    return Process(pick(whole, "throttle_asked", "climb"), sensed, ahead)


def closed(aircraft: Aircraft) -> Any:
    """Close the climb loop: climb_setpoint to climb."""
    throttle, answer = terms(aircraft.gains.altitude)._replace(damping=0.0), aircraft.gains.altitude.pitch_error
    parts = [
        system(aircraft),
        blocks.controller(throttle, ("climb_setpoint", "climb_seen", "no_rate", "throttle_asked")),
        blocks.gain(answer, "climb_setpoint", "pitch_asked"),
        blocks.gain(-answer, "climb_seen", "pitch_asked"),
    ]
    return blocks.joined(parts, ["climb_setpoint"], ["climb"])


def terms(gains: altitude.Gains) -> Terms:
    """Return the gains of the loop."""
    return Terms(gains.throttle_error, gains.throttle_integral, gains.pitch_error)


def tuned(aircraft: Aircraft) -> Aircraft:
    """Design the climb loop.

    Raises:
        InputError: no gains meet the margins.
    """
    fastest = SHARE * aircraft.model.flapping_rate
    ranges, held = (
        greatest(altitude.Gains, "throttle_error", "throttle_integral"),
        aircraft.gains.altitude.pitch_error,
    )
    spec = LoopSpec(fastest, True, False, ranges, held, regulates=True, limits=GUIDANCE)
    try:
        found = search(process(aircraft), spec)
    except InputError as error:
        # The pitch response to the climb error has the gain of the file and is part of the loop.
        hint = f"; try altitude.pitch_error below {held:g} rad s/m, down to 0" if held > 0.0 else ""
        raise InputError(f"{error}{hint}") from None
    gains = aircraft.gains.altitude._replace(throttle_error=found.proportional, throttle_integral=found.integral)
    return aircraft._replace(gains=aircraft.gains._replace(altitude=gains))
