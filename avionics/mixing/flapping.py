"""Throttle -> stroke of the wing drives.

Two kinds of drive: "servo" (one position servo a wing follows a commanded sine, Gerdes 2017: Robo Raven II)
and "motor" (a geared motor turns the crank, Malladi 2007 Table 2 gives its frequency).
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, NamedTuple

from avionics.limits import TWO_PI, between_points, clip, slew
from avionics.messages import FlapCommand
from wingbeat.errors import InputError
from wingbeat.records import constructor
from wingbeat.units import Quantity

DRIVES = ("servo", "motor")


class Gains(NamedTuple):
    """What the stroke is made with."""

    drive: str
    """-; "servo" or "motor\""""
    throttle_points: Annotated[tuple[float, ...], Quantity("-", 0.0, 1.0)]
    """-; throttle of the points of the frequency map, rising"""
    frequency_points: Annotated[tuple[float, ...], Quantity("Hz", 0.0, 30.0)]
    """Hz; flapping frequency at those points"""
    throttle_cut: Annotated[float, Quantity("-", 0.0, 0.5)]
    """-; below this throttle the wings glide"""
    frequency_rate: Annotated[float, Quantity("Hz/s", 0.1, 200.0)]
    """Hz/s; how fast the frequency may change"""
    start_time: Annotated[float, Quantity("s", 0.01, 5.0)]
    """s; in which the stroke grows from glide to full, and shrinks again"""
    amplitude_points: Annotated[tuple[float, ...], Quantity("rad", 0.0, 1.5)]
    """rad; half the peak-to-peak commanded stroke at those points (servo drives)"""
    mean_angle: Annotated[float, Quantity("rad", -0.8, 0.8)]
    """rad; middle of the stroke, wing up is positive"""
    glide_angle: Annotated[float, Quantity("rad", -0.8, 0.8)]
    """rad; dihedral while gliding"""
    travel_min: Annotated[float, Quantity("rad", -1.6, 0.0)]
    """rad; lowest commanded wing angle"""
    travel_max: Annotated[float, Quantity("rad", 0.0, 1.6)]
    """rad; highest commanded wing angle"""


class State(NamedTuple):
    """What the stroke generator remembers."""

    phase: float = 0.0
    """rad; 0 to 2 pi, 0 at the upward crossing of the stroke's middle"""
    frequency: float = 0.0
    """Hz; commanded"""
    envelope: float = 0.0
    """-; 0 glide to 1 full stroke"""
    amplitude: float = 0.0
    """rad; of the full stroke last asked, in which the wings come to rest"""


class Stroke(NamedTuple):
    """What the wing drives are told."""

    left: float
    """rad; wing up is positive (servo drives)"""
    right: float
    """rad; wing up is positive (servo drives)"""
    throttle: float
    """-; 0 to 1 (motor drives)"""


def check(gains: Gains) -> Gains:
    """The gains, once they make sense together.

    Raises:
        InputError: unknown drive, or a frequency map that is not a rising list of pairs.
    """
    if gains.drive not in DRIVES:
        raise InputError(f'flapping.drive must be "servo" or "motor", not "{gains.drive}"')
    points = gains.throttle_points
    if len(points) < 2 or {len(gains.frequency_points), len(gains.amplitude_points)} != {len(points)}:
        raise InputError(
            "flapping.throttle_points, frequency_points and amplitude_points must be lists of equal length, 2 or more"
        )
    if any(later <= earlier for earlier, later in pairwise(points)):
        raise InputError("flapping.throttle_points must rise")
    return gains


_new_stroke = constructor(Stroke)
_new_state = constructor(State)
_new_flap_command = constructor(FlapCommand)


def step(
    gains: Gains, state: State, time_us: int, dt: float, throttle: float, asymmetry: float
) -> tuple[State, FlapCommand, Stroke]:
    """One step; ``throttle`` 0 to 1, ``asymmetry`` the share by which the left stroke is larger, ``dt`` in s."""
    flapping = throttle >= gains.throttle_cut and throttle > 0.0
    requested = between_points(throttle, gains.throttle_points, gains.frequency_points) if flapping else 0.0
    if gains.drive == "motor":
        return _motor(state, time_us, dt, throttle if flapping else 0.0, requested)
    envelope = slew(state.envelope, 1.0 if flapping else 0.0, 1.0 / gains.start_time, dt)
    frequency = _frequency(gains, state, dt, requested, envelope)
    phase = (state.phase + TWO_PI * frequency * dt) % TWO_PI if envelope > 0.0 else 0.0
    mean = gains.glide_angle + (gains.mean_angle - gains.glide_angle) * envelope
    full = between_points(throttle, gains.throttle_points, gains.amplitude_points) if flapping else state.amplitude
    amplitude = full * envelope
    swing = amplitude * math.sin(phase)
    left = clip(mean + swing * (1.0 + asymmetry), gains.travel_min, gains.travel_max)
    right = clip(mean + swing * (1.0 - asymmetry), gains.travel_min, gains.travel_max)
    flap = _new_flap_command(time_us, frequency, amplitude, mean, phase, asymmetry)
    return _new_state(phase, frequency, envelope, full), flap, _new_stroke(left, right, 0.0)


def _frequency(gains: Gains, state: State, dt: float, requested: float, envelope: float) -> float:
    """Slewed frequency; it starts at what is asked and keeps turning while the stroke shrinks."""
    if envelope <= 0.0:
        return 0.0
    if state.envelope <= 0.0:
        return requested
    return slew(state.frequency, requested, gains.frequency_rate, dt) if requested > 0.0 else state.frequency


def _motor(
    state: State, time_us: int, dt: float, throttle: float, frequency: float
) -> tuple[State, FlapCommand, Stroke]:
    """A motor's crank gives the stroke: the throttle passes, the frequency map is for the record."""
    phase = (state.phase + TWO_PI * frequency * dt) % TWO_PI
    flap = FlapCommand(time_us, frequency, 0.0, 0.0, phase, 0.0)
    return State(phase, frequency, float(throttle > 0.0)), flap, Stroke(0.0, 0.0, throttle)
