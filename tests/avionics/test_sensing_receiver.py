"""Channels to sticks and switches, and whose sticks are flown."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from surrogate_gains import VEHICLE

from avionics.messages import ChannelOverride, CommandKind, PilotSource, ReceiverSample
from avionics.sensing import pilot, receiver

GAINS = VEHICLE.gains.receiver
CENTRED = (1500, 1500, 1000, 1500, 1000, 1000, 1000, 1500)
widths = st.integers(900, 2100)


def frame(time: float, lost: int = 0, **channels: int) -> ReceiverSample:
    """A frame with centred sticks but for ``chN``."""
    pulses = tuple(channels.get(f"ch{number}", pulse) for number, pulse in enumerate(CENTRED, 1))
    return ReceiverSample(round(time * 1e6), pulses, lost, 200)


def received(frames, state: pilot.State | None = None, gains: receiver.Gains = GAINS) -> pilot.State:
    state = state or pilot.State()
    for each in frames:
        state = pilot.take_receiver(gains, state, each)
    return state


@pytest.mark.parametrize("channels", [0, 1, 3])
def test_a_frame_of_fewer_channels_than_sticks_is_passed_over(channels: int) -> None:
    short = ReceiverSample(1_000_000, CENTRED[:channels], 0, 200)
    assert pilot.take_receiver(GAINS, pilot.State(), short) == pilot.State()


# --- calibration ------------------------------------------------------------------------------------------


def test_ends_trim_and_dead_zone() -> None:
    assert receiver.sticks(GAINS, CENTRED) == (0.0, 0.0, 0.0, 0.0)
    assert receiver.sticks(GAINS, (2000, 1000, 2000, 2000)) == (-1.0, 1.0, 1.0, 1.0)
    assert receiver.sticks(GAINS, (1000, 2000, 1000, 1000)) == (1.0, -1.0, -1.0, 0.0)
    assert receiver.sticks(GAINS, (1510, 1490, 1010, 1505)) == (0.0, 0.0, 0.0, 0.0)
    assert receiver.sticks(GAINS, (1755, 1500, 1500, 1500)).roll == pytest.approx(0.5)


@given(pulses=st.tuples(widths, widths, widths, widths))
def test_sticks_stay_within_their_travel(pulses) -> None:
    pitch, roll, yaw, throttle = receiver.sticks(GAINS, pulses)
    assert max(abs(pitch), abs(roll), abs(yaw)) <= 1.0
    assert 0.0 <= throttle <= 1.0


@given(lower=widths, upper=widths)
def test_a_longer_pulse_is_never_less(lower: int, upper: int) -> None:
    if lower > upper:
        lower, upper = upper, lower
    for low, high in zip(receiver.sticks(GAINS, (lower,) * 4), receiver.sticks(GAINS, (upper,) * 4), strict=True):
        assert low <= high


def test_a_reversed_channel_is_the_other_way_round() -> None:
    turned = GAINS._replace(reverse=(-1.0, 1.0, -1.0, 1.0))
    pitch, roll, yaw, throttle = receiver.sticks(turned, (2000, 2000, 1000, 2000))
    assert (pitch, roll, yaw, throttle) == (1.0, -1.0, 1.0, 1.0)


def test_halves_of_different_travel_both_reach_their_end() -> None:
    crooked = GAINS._replace(low=(1200.0,) * 4, trim=(1400.0,) * 4, high=(1900.0,) * 4)
    assert receiver.sticks(crooked, (1200, 1900, 1900, 1400))[:2] == (1.0, -1.0)
    assert receiver.sticks(crooked, (1655, 1295, 1900, 1400))[:2] == (pytest.approx(-0.5), pytest.approx(0.5))


# --- failsafe --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "bad",
    [frame(1.0, lost=1), frame(1.0, ch1=0), frame(1.0, ch3=800), frame(1.0, ch2=2300), frame(1.0, ch4=65535)],
    ids=["flag", "no pulse", "failsafe throttle", "too long", "not used"],
)
def test_a_frame_without_sticks_is_passed_over(bad: ReceiverSample) -> None:
    before = received([frame(0.98, ch1=1800)])
    assert received([bad], before) == before


def test_a_receiver_is_lost_after_its_time() -> None:
    state = received([frame(1.0)])
    assert pilot.choose(GAINS, state, 1_400_000) == PilotSource.RECEIVER
    assert pilot.choose(GAINS, state, 1_510_000) == PilotSource.NONE


# --- switches --------------------------------------------------------------------------------------------


def flip(positions, start: float = 1.0, channel: str = "ch5", disarmed: bool = False) -> list[tuple]:
    """What the switches ask for over frames with these pulses of a channel."""
    state, asked = pilot.State(), []
    for number, pulse in enumerate(positions):
        before = state.radio
        state = received([frame(start + 0.02 * number, **{channel: pulse})], state)
        asked += [(act.kind, act.name) for act in pilot.acts(GAINS, before, state.radio, disarmed)]
    return asked


def test_the_mode_switch_acts_when_it_moved_for_good() -> None:
    asked = flip([1000] * 5 + [2000] * 5 + [1500] * 5)
    assert asked == [(CommandKind.SET_MODE, "AUTO"), (CommandKind.SET_MODE, "LOITER")]
    assert flip([1000] * 5 + [2000, 1000, 2000, 2000, 1000] + [1000] * 5) == []


def test_the_first_position_sets_the_mode_only_while_disarmed() -> None:
    assert flip([2000] * 5, disarmed=True) == [(CommandKind.SET_MODE, "AUTO")]
    assert flip([2000] * 5, disarmed=False) == []


def test_an_arm_switch_that_is_on_at_first_arms_nothing() -> None:
    assert (CommandKind.ARM, "") not in flip([2000] * 9, channel="ch6")
    asked = flip([2000] * 5 + [1000] * 5 + [2000] * 5, channel="ch6")
    assert asked == [(CommandKind.DISARM, ""), (CommandKind.ARM, "")]


def test_the_kill_switch_is_a_position_not_a_move() -> None:
    assert pilot.kill_switch(received([frame(1.0 + 0.02 * n, ch7=2000) for n in range(3)]))
    assert not pilot.kill_switch(received([frame(1.0 + 0.02 * n, ch7=2000) for n in range(2)]))
    assert not pilot.kill_switch(received([frame(1.0 + 0.02 * n, ch7=1500) for n in range(9)]))


# --- overridden channels ---------------------------------------------------------------------------------


def override(time: float, *pulses: int) -> ChannelOverride:
    return ChannelOverride(round(time * 1e6), (*pulses, *(0,) * (18 - len(pulses))))


def overridden(*overrides: ChannelOverride) -> pilot.State:
    state = pilot.State()
    for each in overrides:
        state = pilot.take_override(GAINS, state, each)
    return state


def test_overridden_channels_are_calibrated_like_the_receivers() -> None:
    state = overridden(override(1.0, 2000, 1500, 1505, 1500))
    assert state.override.sticks == receiver.sticks(GAINS, (2000, 1500, 1505, 1500))
    assert pilot.choose(GAINS, state, 1_900_000) == PilotSource.OVERRIDE
    assert pilot.choose(GAINS, state, 2_100_000) == PilotSource.NONE


def test_65535_leaves_a_channel_and_0_gives_it_back() -> None:
    state = overridden(override(1.0, 2000, 1700, 1600, 1500), override(1.1, 65535, 0, 65535, 65535))
    assert state.channels[:4] == (2000, 0, 1600, 1500)
    assert (state.override.sticks.roll, state.override.sticks.pitch) == (1.0, 0.0)


def test_above_eight_0_and_65535_leave_a_channel_and_65534_gives_it_back() -> None:
    first = override(1.0, 1500, 1500, 1000, 1500, 0, 0, 0, 0, 1900, 1800, 1700)
    state = overridden(first, override(1.1, *[65535] * 8, 0, 65535, 65534))
    assert state.channels[8:11] == (1900, 1800, 0)


def test_an_override_given_back_is_no_source() -> None:
    state = overridden(override(1.0, 2000, 1500, 1500, 1500), override(1.1, 0, 0, 0, 0))
    assert pilot.choose(GAINS, state, 1_110_000) == PilotSource.NONE


def test_a_released_throttle_is_idle() -> None:
    assert overridden(override(1.0, 2000, 1500, 0, 1500)).override.sticks.throttle == 0.0
    assert overridden(override(1.0, 0, 0, 1800, 0)).override.sticks[:3] == (0.0, 0.0, 0.0)


def test_an_overridden_kill_counts_at_once_and_ends_when_given_back() -> None:
    killing = override(1.0, 0, 0, 0, 0, 0, 0, 2000)
    assert pilot.kill_switch(overridden(killing))
    assert not pilot.kill_switch(overridden(killing, override(1.1, 1500, 1500, 1000, 1500)))


# --- whose sticks are flown --------------------------------------------------------------------------------

ALL = overridden(override(1.0, 1600, 1500, 1500, 1500))._replace(
    manual=receiver.Sticks(roll=0.9), manual_us=1_000_000, radio=received([frame(1.0, ch1=1800)]).radio
)


def test_the_receiver_goes_before_the_override_and_that_before_manual_control() -> None:
    assert pilot.choose(GAINS, ALL, 1_100_000) == PilotSource.RECEIVER
    assert pilot.choose(GAINS, ALL._replace(radio=receiver.State()), 1_100_000) == PilotSource.OVERRIDE
    left = ALL._replace(radio=receiver.State(), channels=(0,) * 18)
    assert pilot.choose(GAINS, left, 1_100_000) == PilotSource.MANUAL_CONTROL
    assert pilot.choose(GAINS, pilot.State(), 1_100_000) == PilotSource.NONE


def test_the_sticks_are_those_of_the_source() -> None:
    rolls = [pilot.sticks(ALL._replace(source=source)).roll for source in PilotSource]
    assert rolls == [0.0, 0.9, pytest.approx(90 / 490), pytest.approx(290 / 490)]
    assert all(math.isfinite(value) for value in pilot.sticks(ALL))
