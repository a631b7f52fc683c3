"""Stroke generator: throttle to commands of the wing drives.

The drive is "servo" (one position servo for each wing follows a commanded sine, Gerdes 2017: Robo Raven II) or
"motor" (a geared motor turns the crank, Malladi 2007 Table 2 gives its frequency).
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Final, NamedTuple

from avionics.limits import TWO_PI, between_points, clip, slew
from avionics.messages import FlapCommand
from wingbeat.errors import InputError
from wingbeat.records import constructor
from wingbeat.units import Quantity

DRIVES = ("servo", "motor")


class Gains(NamedTuple):
    """Parameters of the stroke generator."""

    drive: str
    """-; "servo" or "motor\""""
    throttle_points: Annotated[tuple[float, ...], Quantity("-", 0.0, 1.0)]
    """-; throttle at the points of the frequency map, rising"""
    frequency_points: Annotated[tuple[float, ...], Quantity("Hz", 0.0, 30.0)]
    """Hz; flapping frequency at the points of the map"""
    throttle_cut: Annotated[float, Quantity("-", 0.0, 0.5)]
    """-; throttle below which the wings glide"""
    frequency_rate: Annotated[float, Quantity("Hz/s", 0.1, 200.0)]
    """Hz/s; slew rate limit of the frequency"""
    start_time: Annotated[float, Quantity("s", 0.01, 5.0)]
    """s; duration of the change between glide and full stroke"""
    amplitude_points: Annotated[tuple[float, ...], Quantity("rad", 0.0, 1.5)]
    """rad; commanded amplitude, half the peak-to-peak stroke, at the points of the map (servo drives)"""
    mean_angle: Annotated[float, Quantity("rad", -0.8, 0.8)]
    """rad; mean angle of the stroke, positive wing up"""
    glide_angle: Annotated[float, Quantity("rad", -0.8, 0.8)]
    """rad; dihedral while gliding"""
    travel_min: Annotated[float, Quantity("rad", -1.6, 0.0)]
    """rad; minimum commanded wing angle"""
    travel_max: Annotated[float, Quantity("rad", 0.0, 1.6)]
    """rad; maximum commanded wing angle"""


class State(NamedTuple):
    """State of the stroke generator."""

    phase: float = 0.0
    """rad; from 0 to 2 pi, 0 at the upward crossing of the stroke middle"""
    frequency: float = 0.0
    """Hz; commanded"""
    envelope: float = 0.0
    """-; from 0 (glide) to 1 (full stroke)"""
    amplitude: float = 0.0
    """rad; amplitude of the last full stroke, used while the wings come to rest"""


class Stroke(NamedTuple):
    """Commands of the wing drives."""

    left: float
    """rad; positive wing up (servo drives)"""
    right: float
    """rad; positive wing up (servo drives)"""
    throttle: float
    """-; from 0 to 1 (motor drives)"""


def check(gains: Gains) -> Gains:
    """Return the parameters if they are consistent.

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


_new_stroke: Final = constructor(Stroke)
_new_state: Final = constructor(State)
_new_flap_command: Final = constructor(FlapCommand)


def step(
    gains: Gains, state: State, time_us: int, dt: float, throttle: float, asymmetry: float
) -> tuple[State, FlapCommand, Stroke]:
    """Advance the stroke by ``dt`` (s).

    ``throttle`` is from 0 to 1; ``asymmetry`` is the relative increase of the left stroke.
    """
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
    """Return the slewed frequency.

    It starts at the requested value and is held while the stroke decays.
    """
    if envelope <= 0.0:
        return 0.0
    if state.envelope <= 0.0:
        return requested
    return slew(state.frequency, requested, gains.frequency_rate, dt) if requested > 0.0 else state.frequency


def _motor(
    state: State, time_us: int, dt: float, throttle: float, frequency: float
) -> tuple[State, FlapCommand, Stroke]:
    """Return the command of a motor drive.

    The crank determines the stroke: the throttle is passed through, and the frequency map is used for the log only.
    """
    phase = (state.phase + TWO_PI * frequency * dt) % TWO_PI
    flap = FlapCommand(time_us, frequency, 0.0, 0.0, phase, 0.0)
    return State(phase, frequency, float(throttle > 0.0)), flap, Stroke(0.0, 0.0, throttle)
