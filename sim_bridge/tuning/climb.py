"""Climb loop: throttle, the drive's lag, the climb rate averaged over a stroke, sampled at 50 Hz.

The pitch loop is closed within it; the feed-forwards from the climb setpoint to throttle and pitch are the file's.
"""

from __future__ import annotations

from typing import Any

from avionics.guidance import altitude
from sim_bridge.tuning import blocks, pitch
from sim_bridge.tuning.aircraft import Aircraft
from sim_bridge.tuning.loop import Process, Terms, Wish, pick, search
from sim_bridge.tuning.margins import GUIDANCE
from sim_bridge.tuning.ranges import greatest

RATE = 50.0
"""Hz; of the loop"""
SHARE = 0.1
"""-; highest crossover over the flapping frequency: the thrust of a stroke is known when it is over"""


def system(aircraft: Aircraft) -> Any:
    """throttle_asked and climb_setpoint (by the feed-forwards) to climb and to what the loop measures."""
    gains, wait = aircraft.gains.altitude, blocks.loop_delay(RATE)
    parts = [
        pitch.closed(aircraft),
        blocks.delay(wait, "throttle_asked", "throttle"),
        blocks.gain(gains.throttle_climb, "climb_setpoint", "throttle_asked"),
        blocks.delay(wait, "climb_setpoint", "climb_ahead"),
        blocks.gain(gains.pitch_climb, "climb_ahead", "pitch_setpoint"),
        blocks.stroke_mean(aircraft.model.frequency, "climb", "climb_seen"),
    ]
    return blocks.joined(parts, ["throttle_asked", "climb_setpoint"], ["climb", "climb_seen"])


def process(aircraft: Aircraft) -> Process:
    """What the climb loop acts on."""
    whole = system(aircraft)
    followed, seen = (pick(whole, "throttle_asked", *names) for names in (["climb"], ["climb_seen", "climb_seen"]))
    return Process(followed, seen, pick(whole, "climb_setpoint", "climb"))


def closed(aircraft: Aircraft) -> Any:
    """The aircraft with its climb loop closed: climb_setpoint to climb."""
    signals = ("climb_setpoint", "climb_seen", "no_rate", "throttle_asked")
    loop = blocks.controller(terms(aircraft.gains.altitude), signals)
    return blocks.joined([system(aircraft), loop], ["climb_setpoint"], ["climb"])


def terms(gains: altitude.Gains) -> Terms:
    """The loop's part of its gains."""
    return Terms(gains.throttle_error, gains.throttle_integral, 0.0)


def tuned(aircraft: Aircraft) -> Aircraft:
    """With the climb loop designed.

    Raises:
        BadInput: no gains keep the margins.
    """
    fastest = SHARE * aircraft.model.flapping_rate
    ranges = greatest(altitude.Gains, "throttle_error", "throttle_integral")
    found = search(process(aircraft), Wish(fastest, True, False, ranges, regulates=True, limits=GUIDANCE))
    gains = aircraft.gains.altitude._replace(throttle_error=found.proportional, throttle_integral=found.integral)
    return aircraft._replace(gains=aircraft.gains._replace(altitude=gains))
