"""A plane's outputs: which channel is which surface, and what a number on it means."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from wingbeat.errors import InputError

MOST_CHANNELS = 32


class Outputs(NamedTuple):
    """Servo and motor outputs of an airplane autopilot."""

    aileron: float = 0.0
    """-; -1 to 1, positive rolls right"""
    elevator: float = 0.0
    """-; -1 to 1, positive pitches the nose up"""
    throttle: float = 0.0
    """-; 0 to 1"""
    rudder: float = 0.0
    """-; -1 to 1, positive yaws the nose right"""
    armed: int = 0
    """-; 1 if the motor is enabled"""


class Channels(NamedTuple):
    """Output channel of each function, from 1; negative if reversed, 0 if unassigned."""

    aileron: int = 1
    elevator: int = 2
    throttle: int = 3
    rudder: int = 4

    def __str__(self) -> str:
        return ",".join(f"{name}={number}" for name, number in zip(self._fields, self, strict=True))


class Pulses(NamedTuple):
    """Pulse widths at the ends of every servo's travel."""

    low: float = 1100.0
    """us; full left or down, throttle closed"""
    high: float = 1900.0
    """us; full right or up, throttle open"""


def parse_channels(text: str) -> Channels:
    """Parse an assignment such as ``elevator=2,throttle=3``; other functions keep their default channels.

    Raises:
        InputError: no such function or channel, a channel given twice, or a throttle that is missing or reversed.
    """
    given: dict[str, int] = {}
    for part in text.split(","):
        name, _, number = part.strip().partition("=")
        if name not in Channels._fields:
            raise InputError(f"channels {text}: {name or 'nothing'} is not one of {', '.join(Channels._fields)}")
        digits = number.removeprefix("-")
        if not (digits.isascii() and digits.isdigit() and int(digits) <= MOST_CHANNELS):
            raise InputError(
                f"channels {text}: the channel of {name} must be 1 to {MOST_CHANNELS}, -1 to reverse it, 0"
            )
        given[name] = int(number)
    channels = Channels(**given)
    used = [abs(number) for number in channels if number]
    if len(set(used)) != len(used):
        raise InputError(f"channels {text}: {channels} gives one channel to two functions")
    if channels.throttle < 1:
        raise InputError(f"channels {text}: the throttle needs a channel, and cannot be reversed")
    return channels


def parse_pulses(text: str) -> Pulses:
    """Parse the ends of the servo travel, ``LOW:HIGH`` in us.

    Raises:
        InputError: not two such numbers, or not increasing.
    """
    low, _, high = text.partition(":")
    if not (low.isascii() and low.isdigit() and high.isascii() and high.isdigit()):
        raise InputError(f"pulses {text}: they must be LOW:HIGH in whole microseconds, such as 1100:1900")
    pulses = Pulses(float(low), float(high))
    if not 500.0 <= pulses.low < pulses.high <= 2500.0:
        raise InputError(f"pulses {text}: they must rise, within 500 to 2500 us")
    return pulses


def from_controls(channels: Channels, controls: Sequence[float], armed: int) -> Outputs | None:
    """Convert controls, -1 to 1 for a servo and 0 to 1 for a motor; None if one is not finite."""
    aileron, elevator, throttle, rudder = (_control(controls, number) for number in channels)
    if not math.isfinite(aileron + elevator + throttle + rudder):
        return None
    surfaces = (_within(value, -1.0) for value in (aileron, elevator, rudder))
    left, up, right = surfaces
    return Outputs(left, up, _within(throttle, 0.0), right, armed)


def _control(controls: Sequence[float], number: int) -> float:
    if number == 0 or abs(number) > len(controls):
        return 0.0
    return math.copysign(1.0, number) * controls[abs(number) - 1]


def from_pulses(channels: Channels, pulses: Pulses, widths: Sequence[int]) -> Outputs:
    """Convert pulse widths in us; a width of 0 is no pulse.

    Without a pulse a surface is centered and the motor is disarmed.
    """
    middle, half = 0.5 * (pulses.low + pulses.high), 0.5 * (pulses.high - pulses.low)

    def turned(number: int) -> float:
        width = widths[abs(number) - 1] if 0 < abs(number) <= len(widths) else 0
        return _within(math.copysign(1.0, number) * (width - middle) / half, -1.0) if width else 0.0

    motor = widths[channels.throttle - 1] if channels.throttle <= len(widths) else 0
    throttle = _within((motor - pulses.low) / (2.0 * half), 0.0)
    return Outputs(
        turned(channels.aileron), turned(channels.elevator), throttle, turned(channels.rudder), int(motor > 0)
    )


def _within(value: float, low: float) -> float:
    return min(max(value, low), 1.0)
