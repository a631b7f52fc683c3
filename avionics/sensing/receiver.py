"""Conversion of radio-control channels to sticks and switches.

The conversion is common to the receiver and to overridden channels. Channels 1 to 4 are roll, pitch, throttle and
yaw; a switch has three positions. A frame counts as lost if the receiver reports it, or if the pulse of a stick is
outside the valid range.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final, NamedTuple

from avionics.limits import clip
from wingbeat.units import Quantity

ROLL, PITCH, THROTTLE, YAW = range(4)
"""indices of the sticks in the channels"""
STICKS: Final = 4
"""channels; minimum number in a frame"""
SWITCH_LOW, SWITCH_HIGH = 1300, 1700
"""us; thresholds between the low, middle and high position of a switch"""
SETTLED: Final = 3
"""frames; confirmation of a switch position: 60 ms at 50 Hz"""

Four = tuple[float, float, float, float]
PULSE: Final = Quantity("us", 500.0, 2500.0)


class Gains(NamedTuple):
    """Calibration of channels and switches, and timeouts."""

    low: Annotated[Four, PULSE] = (1000.0, 1000.0, 1000.0, 1000.0)
    """us; pulse of roll, pitch, throttle and yaw at the low end. Default: the usual pulse of a stick at its low end
    """
    trim: Annotated[Four, PULSE] = (1500.0, 1500.0, 1500.0, 1500.0)
    """us; pulse at the center, not used for the throttle. Default: the usual pulse of a centered stick"""
    high: Annotated[Four, PULSE] = (2000.0, 2000.0, 2000.0, 2000.0)
    """us; pulse at the high end: right, nose up, full flapping, right. Default: the usual pulse of a stick at its
    high end"""
    reverse: Annotated[Four, Quantity("-", -1.0, 1.0)] = (1.0, 1.0, 1.0, 1.0)
    """-; -1 if the transmitter reverses a channel, else 1. Default: right, stick back, full flapping and right are
    long pulses"""
    dead_zone: Annotated[float, Quantity("us", 0.0, 200.0)] = 10.0
    """us; dead zone about the trim. Default: the play of a stick, ten times the jitter of the receiver"""
    pulse_min: Annotated[float, PULSE] = 850.0
    """us; minimum pulse of a valid signal. Default: below every calibrated stick; a receiver in failsafe may send
    less"""
    pulse_max: Annotated[float, PULSE] = 2150.0
    """us; maximum pulse of a valid signal. Default: above every calibrated stick"""
    frame_time: Annotated[float, Quantity("s", 0.05, 10.0)] = 0.5
    """s; time without a valid frame after which the receiver counts as lost. Default: 25 frames"""
    stick_time: Annotated[float, Quantity("s", 0.05, 60.0)] = 1.0
    """s; time without MANUAL_CONTROL or RC_CHANNELS_OVERRIDE after which their sticks count as lost. Default: ten
    messages of a ground station"""
    mode_channel: Annotated[int, Quantity("-", 0, 18)] = 5
    """-; channel of the mode switch, 0 for none. Default: the first after the sticks"""
    arm_channel: Annotated[int, Quantity("-", 0, 18)] = 6
    """-; channel of the arm switch, which arms when moved to high, 0 for none. Default: the next"""
    kill_channel: Annotated[int, Quantity("-", 0, 18)] = 7
    """-; channel of the kill switch, active if high, 0 for none. Default: the next"""
    mode_low: Annotated[int, Quantity("-", 1, 7)] = 2
    """-; number of the mode in the low position of the switch. Default: STABILIZED, for a pilot in an emergency"""
    mode_middle: Annotated[int, Quantity("-", 1, 7)] = 7
    """-; number of the mode in the middle position. Default: LOITER, to gain time"""
    mode_high: Annotated[int, Quantity("-", 1, 7)] = 4
    """-; number of the mode in the high position. Default: AUTO"""


class Sticks(NamedTuple):
    """Stick positions."""

    pitch: float = 0.0
    """-; from -1 nose down to 1 nose up"""
    roll: float = 0.0
    """-; from -1 left to 1 right"""
    yaw: float = 0.0
    """-; from -1 left to 1 right"""
    throttle: float = 0.0
    """-; from 0 to 1 flapping"""


class Switch(NamedTuple):
    """Debounced switch."""

    position: int = -1
    """-; 0 low, 1 middle, 2 high, -1 before the first frame"""
    received: int = -1
    """-; position in the last frame"""
    frames: int = 0
    """-; consecutive frames with that position"""


class State(NamedTuple):
    """State of one source of channels."""

    time_us: int = -1
    """us; time of the last valid frame, -1 before the first"""
    sticks: Sticks = Sticks()
    mode: Switch = Switch()
    arm: Switch = Switch()
    kill: Switch = Switch()


def usable(gains: Gains, pulses: Sequence[int], lost: int) -> bool:
    """Return whether a frame carries valid stick positions."""
    return (
        not lost
        and len(pulses) >= STICKS
        and all(gains.pulse_min <= pulse <= gains.pulse_max for pulse in pulses[:STICKS])
    )


def step(gains: Gains, state: State, time_us: int, pulses: Sequence[int], timeout: int = SETTLED) -> State:
    """Process a valid frame.

    A channel that is missing, or 0 us, leaves its switch unchanged. ``timeout`` is the number of frames for which a
    switch must be constant.
    """
    return State(
        time_us,
        sticks(gains, pulses),
        _settled(state.mode, gains.mode_channel, pulses, timeout),
        _settled(state.arm, gains.arm_channel, pulses, timeout),
        _settled(state.kill, gains.kill_channel, pulses, timeout),
    )


def sticks(gains: Gains, pulses: Sequence[int]) -> Sticks:
    """Return the four calibrated sticks."""
    pitch, roll, yaw = (_axis(gains, place, pulses) for place in (PITCH, ROLL, YAW))
    return Sticks(pitch, roll, yaw, _flap(gains, pulses))


def _axis(gains: Gains, place: int, pulses: Sequence[int]) -> float:
    """Return a centered stick from -1 to 1; each half has its own travel."""
    off = pulses[place] - gains.trim[place]
    beyond = abs(off) - gains.dead_zone
    if beyond <= 0.0:
        return 0.0
    end = gains.high[place] if off > 0.0 else gains.low[place]
    travel = max(abs(end - gains.trim[place]) - gains.dead_zone, 1.0)
    share = min(beyond / travel, 1.0)
    return share if off * gains.reverse[place] > 0.0 else -share


def _flap(gains: Gains, pulses: Sequence[int]) -> float:
    """Return the throttle from 0 to 1, with the dead zone at its low end."""
    low, high = gains.low[THROTTLE], gains.high[THROTTLE]
    share = (pulses[THROTTLE] - low) / max(high - low, 1.0)
    share = share if gains.reverse[THROTTLE] > 0.0 else 1.0 - share
    dead = gains.dead_zone / max(high - low, 1.0)
    return clip((share - dead) / (1.0 - dead), 0.0, 1.0)


def _settled(switch: Switch, channel: int, pulses: Sequence[int], timeout: int) -> Switch:
    if not 1 <= channel <= len(pulses) or pulses[channel - 1] == 0:
        return switch
    pulse = pulses[channel - 1]
    received = 0 if pulse < SWITCH_LOW else 2 if pulse > SWITCH_HIGH else 1
    count = min(switch.frames + 1, timeout) if received == switch.received else 1
    return Switch(received if count >= timeout else switch.position, received, count)
