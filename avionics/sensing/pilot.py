"""Whose sticks are flown: the receiver's before overridden channels before MANUAL_CONTROL, never stale ones."""

from __future__ import annotations

from typing import NamedTuple

from avionics.messages import (
    OVERRIDDEN,
    ChannelOverride,
    CommandKind,
    Mode,
    PilotSource,
    ReceiverSample,
)
from avionics.sensing import receiver
from avionics.sensing.receiver import Gains, Sticks

IGNORED = 65535
"""us; in an override: the channel stays as it was"""
RELEASED = 65534
"""us; in an override's channels above 8: the channel is given back; below, 0 does that and here it is ignored"""
PLAIN = 8
"""channels of an override in which 0 releases"""
NEUTRAL = Sticks()


class Act(NamedTuple):
    """What a switch asks for."""

    kind: CommandKind
    name: str = ""
    """-; the mode's name for SET_MODE"""


class State(NamedTuple):
    """What is remembered of the pilot's three ways in."""

    radio: receiver.State = receiver.State()
    override: receiver.State = receiver.State()
    channels: tuple[int, ...] = (0,) * OVERRIDDEN
    """us; overridden channels, 0 where released"""
    manual: Sticks = NEUTRAL
    manual_us: int = -1
    """us; of the last MANUAL_CONTROL, -1 before the first"""
    source: int = PilotSource.NONE
    """-; whose sticks are flown, see `PilotSource`"""


def take_receiver(gains: Gains, state: State, sample: ReceiverSample) -> State:
    """A frame of the receiver came; one that carries no sticks is passed over."""
    if not receiver.usable(gains, sample.pulses, sample.lost):
        return state
    return state._replace(radio=receiver.step(gains, state.radio, sample.time_us, sample.pulses))


def take_override(gains: Gains, state: State, override: ChannelOverride) -> State:
    """RC_CHANNELS_OVERRIDE came: channels are set, left, or released; released sticks are centred.

    Its checksum was right, so a switch counts at once.
    """
    channels = tuple(map(_overridden, range(OVERRIDDEN), state.channels, override.pulses))
    centred = (*(round(pulse) for pulse in gains.trim[:2]), round(_idle(gains)), round(gains.trim[3]))
    flown = tuple(pulse or spare for pulse, spare in zip(channels[:4], centred, strict=True)) + channels[4:]
    state = state._replace(channels=channels)
    if not any(channels) or not receiver.usable(gains, flown, 0):
        return state._replace(override=receiver.State())
    taken = receiver.step(gains, state.override, override.time_us, flown, timeout=1)
    killing = gains.kill_channel and channels[gains.kill_channel - 1]
    return state._replace(override=taken if killing else taken._replace(kill=receiver.Switch()))


def _overridden(place: int, before: int, requested: int) -> int:
    if place < PLAIN:
        return before if requested == IGNORED else requested
    if requested in (0, IGNORED):
        return before
    return 0 if requested == RELEASED else requested


def _idle(gains: Gains) -> float:
    return gains.low[receiver.THROTTLE] if gains.reverse[receiver.THROTTLE] > 0.0 else gains.high[receiver.THROTTLE]


def choose(gains: Gains, state: State, time_us: int) -> PilotSource:
    """The first source that is not stale."""
    if state.radio.time_us >= 0 and not receiver_lost(gains, state, time_us):
        return PilotSource.RECEIVER
    limit = gains.stick_time * 1e6
    if state.override.time_us >= 0 and time_us - state.override.time_us <= limit and any(state.channels[:4]):
        return PilotSource.OVERRIDE
    if state.manual_us >= 0 and time_us - state.manual_us <= limit:
        return PilotSource.MANUAL_CONTROL
    return PilotSource.NONE


def receiver_lost(gains: Gains, state: State, time_us: int) -> bool:
    """Whether the receiver was heard once and is not any more."""
    return 0 <= state.radio.time_us < time_us - gains.frame_time * 1e6


def sticks(state: State) -> Sticks:
    """Those of the chosen source, neutral without one."""
    if state.source == PilotSource.RECEIVER:
        return state.radio.sticks
    if state.source == PilotSource.OVERRIDE:
        return state.override.sticks
    return state.manual if state.source == PilotSource.MANUAL_CONTROL else NEUTRAL


def kill_switch(state: State) -> bool:
    """Whether a kill switch is on, of whatever source."""
    return state.radio.kill.position == 2 or state.override.kill.position == 2


def acts(gains: Gains, before: receiver.State, after: receiver.State, disarmed: bool) -> tuple[Act, ...]:
    """What the switches of the source in command ask for: changes act, and the first mode position while disarmed.

    An arm switch that is on when it is first heard arms nothing: it has to be moved.
    """
    requested: list[Act] = []
    if after.mode.position != before.mode.position and (before.mode.position >= 0 or disarmed):
        number = (gains.mode_low, gains.mode_middle, gains.mode_high)[after.mode.position]
        requested.append(Act(CommandKind.SET_MODE, Mode(number).name))
    was, now = before.arm.position, after.arm.position
    if was >= 0 and (was == 2) != (now == 2):
        requested.append(Act(CommandKind.ARM if now == 2 else CommandKind.DISARM))
    return tuple(requested)
