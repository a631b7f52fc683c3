"""Selection of the stick inputs: receiver, override, then MANUAL_CONTROL.

Stale inputs are not used.
"""

from __future__ import annotations

from typing import Final, NamedTuple

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

IGNORED: Final = 65535
"""us; value of an override: the channel is unchanged"""
RELEASED: Final = 65534
"""us; value of an override in channels above 8: the channel is released; in lower channels 0 releases and this value
is ignored"""
PLAIN: Final = 8
"""-; number of override channels in which 0 releases"""
NEUTRAL: Final = Sticks()


class Act(NamedTuple):
    """Command of a switch."""

    kind: CommandKind
    name: str = ""
    """-; name of the mode for SET_MODE"""


class State(NamedTuple):
    """State of the three stick inputs."""

    radio: receiver.State = receiver.State()
    override: receiver.State = receiver.State()
    channels: tuple[int, ...] = (0,) * OVERRIDDEN
    """us; overridden channels, 0 if released"""
    manual: Sticks = NEUTRAL
    manual_us: int = -1
    """us; time of the last MANUAL_CONTROL, -1 before the first"""
    source: int = PilotSource.NONE
    """-; active stick input, see `PilotSource`"""


def take_receiver(gains: Gains, state: State, sample: ReceiverSample) -> State:
    """Process a frame of the receiver; a frame without sticks is ignored."""
    if not receiver.usable(gains, sample.pulses, sample.lost):
        return state
    return state._replace(radio=receiver.step(gains, state.radio, sample.time_us, sample.pulses))


def take_override(gains: Gains, state: State, override: ChannelOverride) -> State:
    """Process RC_CHANNELS_OVERRIDE: channels are set, kept or released.

    Released sticks are centered. The message has a checksum, so that a switch takes effect at once.
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
    """Return the first source that is not stale."""
    if state.radio.time_us >= 0 and not receiver_lost(gains, state, time_us):
        return PilotSource.RECEIVER
    limit = gains.stick_time * 1e6
    if state.override.time_us >= 0 and time_us - state.override.time_us <= limit and any(state.channels[:4]):
        return PilotSource.OVERRIDE
    if state.manual_us >= 0 and time_us - state.manual_us <= limit:
        return PilotSource.MANUAL_CONTROL
    return PilotSource.NONE


def receiver_lost(gains: Gains, state: State, time_us: int) -> bool:
    """Return whether receiver frames have timed out after the first."""
    return 0 <= state.radio.time_us < time_us - gains.frame_time * 1e6


def sticks(state: State) -> Sticks:
    """Return the sticks of the active source, neutral without one."""
    if state.source == PilotSource.RECEIVER:
        return state.radio.sticks
    if state.source == PilotSource.OVERRIDE:
        return state.override.sticks
    return state.manual if state.source == PilotSource.MANUAL_CONTROL else NEUTRAL


def kill_switch(state: State) -> bool:
    """Return whether the kill switch of any source is on."""
    return state.radio.kill.position == 2 or state.override.kill.position == 2


def acts(gains: Gains, before: receiver.State, after: receiver.State, disarmed: bool) -> tuple[Act, ...]:
    """Return the commands of the switches of the active source.

    A change of a switch causes a command; while disarmed so does the first mode position. An arm switch that is on at
    the first frame has no effect until it is moved.
    """
    requested: list[Act] = []
    if after.mode.position != before.mode.position and (before.mode.position >= 0 or disarmed):
        number = (gains.mode_low, gains.mode_middle, gains.mode_high)[after.mode.position]
        requested.append(Act(CommandKind.SET_MODE, Mode(number).name))
    was, now = before.arm.position, after.arm.position
    if was >= 0 and (was == 2) != (now == 2):
        requested.append(Act(CommandKind.ARM if now == 2 else CommandKind.DISARM))
    return tuple(requested)
