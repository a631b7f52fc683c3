"""A plane's outputs on an ornithopter: channels, pulses, the mixing to wings and tail, and the throw."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from foreign_bench import RIG, Log, ToyWorld
from hypothesis import given
from hypothesis import strategies as st

from avionics import topics
from avionics.vehicles import load_vehicle
from sim_bridge import topics as truth_topics
from sim_bridge.bridge.foreign import launch, mixer
from sim_bridge.bridge.foreign.flight import LONGEST_STEP, ForeignFlight
from sim_bridge.bridge.foreign.outputs import (
    Channels,
    Outputs,
    Pulses,
    from_controls,
    from_pulses,
    parse_channels,
    parse_pulses,
)
from sim_bridge.bridge.foreign.world import Stage
from wingbeat.errors import InputError

GAINS = mixer.gains_of(RIG.vehicle)
STEP = 0.005
share = st.floats(-1.0, 1.0)


def mixed(outputs: Outputs, steps: int = 400) -> list[tuple[float, float, float, float]]:
    """Left and right wing, elevator, rudder over two seconds."""
    state, track = mixer.State(), []
    for tick in range(steps):
        state, _, command = mixer.step(GAINS, state, tick * 5000, STEP, outputs)
        track.append((command.wing_left, command.wing_right, command.elevator, command.rudder))
    return track


@pytest.mark.parametrize(
    ("text", "channels"),
    [
        ("aileron=0", Channels(0, 2, 3, 4)),
        ("aileron=7,elevator=8,throttle=5,rudder=3", Channels(7, 8, 5, 3)),
        ("elevator=-2, rudder=-4", Channels(1, -2, 3, -4)),
        ("aileron=0,elevator=0,rudder=0", Channels(0, 0, 3, 0)),
    ],
)
def test_channels_are_assigned_by_name(text: str, channels: Channels) -> None:
    assert parse_channels(text) == channels == parse_channels(str(channels))


@pytest.mark.parametrize(
    ("text", "error_text"),
    [
        ("flaps=5", "flaps is not one of aileron"),
        ("", "nothing is not one of"),
        ("rudder=33", "must be 1 to 32"),
        ("rudder=four", "must be 1 to 32"),
        ("elevator=3", "one channel to two functions"),
        ("elevator=-4", "one channel to two functions"),
        ("throttle=-3", "cannot be reversed"),
        ("throttle=0", "needs a channel"),
    ],
)
def test_channels_that_cannot_be_are_refused_in_one_line(text: str, error_text: str) -> None:
    with pytest.raises(InputError, match=error_text):
        parse_channels(text)


@pytest.mark.parametrize("text", ["1900:1100", "1100", "100:1900", "1100:2600", "a:b", "1100:1900:5"])
def test_pulses_that_cannot_be_are_refused(text: str) -> None:
    with pytest.raises(InputError):
        parse_pulses(text)
    assert parse_pulses("1000:2000") == Pulses(1000.0, 2000.0)


def test_pulses_become_shares_of_the_travel_and_none_is_the_middle_and_disarmed() -> None:
    assert from_pulses(Channels(), Pulses(), (1900, 1100, 1500, 1700)) == Outputs(1.0, -1.0, 0.5, 0.5, 1)
    assert from_pulses(Channels(-1, 2, 3, -4), Pulses(), (1900, 1300, 1100, 1700)) == Outputs(
        -1.0, -0.5, 0.0, -0.5, 1
    )
    assert from_pulses(Channels(), Pulses(), (0, 0, 0, 0)) == Outputs()
    assert from_pulses(Channels(throttle=9), Pulses(), (1500,) * 4) == Outputs()


@given(st.lists(st.integers(0, 65535), min_size=16, max_size=32))
def test_whatever_the_pulses_the_outputs_are_within_their_ranges(widths: list[int]) -> None:
    outputs = from_pulses(Channels(5, -6, 7, 8), Pulses(), widths)
    assert all(-1.0 <= value <= 1.0 for value in (outputs.aileron, outputs.elevator, outputs.rudder))
    assert 0.0 <= outputs.throttle <= 1.0 and outputs.armed in (0, 1)


@given(st.lists(st.floats(width=32), min_size=16, max_size=16))
def test_controls_are_within_their_ranges_or_refused_when_one_in_use_is_no_number(values: list[float]) -> None:
    outputs = from_controls(Channels(), values, 1)
    if outputs is None:
        assert not math.isfinite(sum(values[:4]))
    else:
        assert all(-1.0 <= value <= 1.0 for value in outputs[:4]) and outputs.throttle >= 0.0


def test_a_control_that_is_no_number_is_refused_only_where_it_is_in_use() -> None:
    values = [0.1, 0.2, 0.3, 0.4, math.nan]
    assert from_controls(Channels(), values, 1) == Outputs(0.1, 0.2, 0.3, 0.4, 1)
    assert from_controls(Channels(aileron=5), values, 1) is None


def test_throttle_is_flapping_at_the_vehicles_frequency_and_both_wings_alike() -> None:
    track = mixed(Outputs(throttle=1.0, armed=1))
    left = [wings[0] for wings in track[100:]]
    crossings = sum(before <= GAINS.flapping.mean_angle < after for before, after in pairwise(left))
    assert crossings == pytest.approx(1.5 * GAINS.flapping.frequency_points[-1], abs=1)
    assert max(left) - min(left) == pytest.approx(2.0 * GAINS.flapping.amplitude_points[-1], rel=0.02)
    assert all(wings[0] == wings[1] for wings in track)


def test_disarmed_or_without_throttle_the_wings_glide() -> None:
    for outputs in (Outputs(throttle=1.0, armed=0), Outputs(throttle=0.0, armed=1)):
        left, right, elevator, rudder = mixed(outputs)[-1]
        assert (left, right) == (GAINS.flapping.glide_angle, GAINS.flapping.glide_angle)
        assert (elevator, rudder) == pytest.approx((GAINS.elevator_trim, 0.0))


def test_the_tail_has_its_signs_and_its_travel() -> None:
    assert mixed(Outputs(elevator=1.0))[-1][2] == pytest.approx(GAINS.tail.elevator_max)
    assert mixed(Outputs(elevator=-1.0))[-1][2] == pytest.approx(GAINS.tail.elevator_min)
    assert mixed(Outputs(rudder=0.5))[-1][3] == pytest.approx(0.5 * GAINS.tail.rudder_max)
    assert mixed(Outputs(aileron=0.5))[-1][3] == pytest.approx(0.5 * GAINS.tail.rudder_share)


def test_the_aileron_goes_into_the_stroke_where_the_vehicle_rolls_by_it() -> None:
    gains = GAINS._replace(tail=GAINS.tail._replace(asymmetry_share=0.2, rudder_share=0.0))
    state, widths = mixer.State(), []
    for tick in range(400):
        state, _, command = mixer.step(gains, state, tick * 5000, STEP, Outputs(aileron=1.0, throttle=0.5, armed=1))
        widths.append((command.wing_left, command.wing_right))
    strokes = [max(side) - min(side) for side in zip(*widths[100:], strict=True)]
    assert strokes[0] / strokes[1] == pytest.approx(1.2 / 0.8, rel=0.01)
    assert command.rudder == 0.0


@given(share, share, st.floats(0.0, 1.0), share)
def test_whatever_is_asked_stays_within_the_servos_travel(
    aileron: float, elevator: float, throttle: float, rudder: float
) -> None:
    flap, tail = GAINS.flapping, GAINS.tail
    for left, right, up, yaw in mixed(Outputs(aileron, elevator, throttle, rudder, 1), 60):
        assert flap.travel_min <= min(left, right) and max(left, right) <= flap.travel_max
        assert tail.elevator_min <= up <= tail.elevator_max and abs(yaw) <= tail.rudder_max


def test_a_vehicle_with_a_motor_passes_its_throttle_on() -> None:
    gains = mixer.gains_of(load_vehicle("arizona_100cm"))
    outputs = Outputs(throttle=0.7, armed=1)
    _, _, command = mixer.step(gains, mixer.State(), 0, STEP, outputs)
    assert command.throttle == (0.7 if gains.flapping.drive == "motor" else 0.0)


def test_he_throws_after_half_a_second_of_armed_throttle_and_a_twitch_is_not_enough() -> None:
    gains = launch.Gains(0.3)

    def ready_after(requested: list[Outputs]) -> int | None:
        state = launch.State()
        for tick, outputs in enumerate(requested):
            state, ready = launch.step(gains, state, STEP, outputs)
            if ready:
                return tick + 1
        return None

    up, low, off = Outputs(throttle=0.3, armed=1), Outputs(throttle=0.29, armed=1), Outputs(throttle=1.0)
    assert ready_after([up] * 200) == pytest.approx(gains.time / STEP, abs=1)
    assert ready_after([low] * 400) is None and ready_after([off] * 400) is None
    assert ready_after(([up] * 60 + [low]) * 5) is None


def test_a_long_step_is_cut_so_that_the_stroke_is_followed_and_the_throw_is_told() -> None:
    world, log, told = ToyWorld(5.0), Log(), list[str]()
    flight = ForeignFlight(Stage(world, log.publish), RIG, told.append)
    for _ in range(30):
        flight.advance(Outputs(throttle=1.0, armed=1), 0.02)
    assert world.time_us == 600_000
    assert {duration for _, duration in world.requested} == {LONGEST_STEP}
    assert told == ["    0.5 s  launched, throttle 100 %"]
    assert [event.text for event in log.messages[truth_topics.EVENTS.name]] == ["launched, throttle 100 %"]
    flapped = log.messages[topics.ACTUATORS.name]
    assert len(flapped) == 120 and len({command.wing_left for command in flapped}) > 40
