"""The surrogate bird flown by stick: three ways in, by rank; kill; sticks that are lost."""

import math
from collections import defaultdict
from functools import cache

import pytest
from surrogate import Bird
from surrogate_gains import VEHICLE as RAVEN
from test_autopilot_flights import ARM, AUTO, Flight, airborne_flight, en_route, sticks

from avionics import inputs, topics
from avionics.messages import (
    ChannelOverride,
    Command,
    CommandKind,
    Failsafe,
    Mode,
    PilotSource,
    ReceiverSample,
    SensorFrame,
    Stage,
)
from wingbeat.message import Severity

HANDS_OFF = (1500, 1500, 1000, 1500, 1000, 1000, 1000, 1500)


class RadioBird(Bird):
    """A bird with a receiver: ``pulses`` at 50 Hz while ``on``."""

    def __init__(self) -> None:
        super().__init__()
        self.pulses, self.on, self.lost = HANDS_OFF, True, 0

    def set(self, **channels: int) -> None:
        values = enumerate(self.pulses, 1)
        self.pulses = tuple(channels.get(f"ch{number}", pulse) for number, pulse in values)

    def frame(self) -> SensorFrame:
        frame = super().frame()
        if not self.on or self.tick % 4:
            return frame
        return frame._replace(receiver=ReceiverSample(self.time_us, self.pulses, self.lost, 200))


def radio_flight() -> tuple[Flight, RadioBird]:
    bird = RadioBird()
    return Flight(bird=bird), bird


def launched(mode_pulse: int = 1000, throttle: int = 1750) -> tuple[Flight, RadioBird]:
    """Armed by switch, thrown, in the air under full control of the transmitter; flown once for all who begin so."""
    flight = first_launched(mode_pulse, throttle).branch()
    assert isinstance(flight.bird, RadioBird)
    return flight, flight.bird


@cache
def first_launched(mode_pulse: int, throttle: int) -> Flight:
    flight, bird = radio_flight()
    bird.set(ch5=mode_pulse)
    flight.fly(3.0)
    bird.set(ch6=2000)
    flight.fly(0.2)
    assert flight.autopilot.state.modes.armed == 1
    bird.set(ch3=throttle)
    bird.throw()
    return flight.fly(2.0)


def test_a_branch_flies_on_as_the_flight_it_left() -> None:
    flight, _ = launched()
    twin = flight.branch()
    assert repr(twin.fly(1.0).reports) == repr(flight.fly(1.0).reports)
    assert twin.frames == flight.frames and twin.bird is not flight.bird


def test_a_flight_by_transmitter_from_the_hand_to_the_ground() -> None:
    flight, bird = launched()
    state = flight.autopilot.state
    assert (state.modes.mode, state.modes.stage) == (Mode.STABILIZED, Stage.EN_ROUTE)
    assert {PilotSource.RECEIVER} == {stick.source for stick in flight.of(topics.PILOT)}
    flight.fly(4.0)
    before = bird.yaw
    bird.set(ch1=1800)
    flight.fly(3.0)
    assert bird.roll == pytest.approx(290 / 490 * RAVEN.gains.roll.stick_roll, abs=0.06)
    assert bird.yaw > before + 0.5
    bird.set(ch1=1500, ch3=1000)
    flight.fly(60.0, until=Stage.LANDED)
    assert bird.altitude == 0.0
    assert flight.events()[-1] == "on the ground, disarmed"


def test_manual_moves_tail_and_wings_by_stick() -> None:
    flight, bird = launched()
    flight.fly(0.1, (Command(0, CommandKind.SET_MODE, "MANUAL"),))
    bird.set(ch2=1750, ch1=1750, ch4=1600)
    flight.fly(0.5)
    command, gains = flight.of(topics.ACTUATORS)[-1], RAVEN.gains
    half = 240 / 490
    assert command.elevator == pytest.approx(gains.pitch.elevator_trim + half * gains.pitch.elevator_max)
    assert command.rudder == pytest.approx(half * gains.tail.rudder_share + 90 / 490 * gains.tail.yaw_share)


def test_manual_is_flown_by_a_pilot_who_sees_the_bird() -> None:
    flight, bird = launched()
    flight.fly(2.0)
    flight.fly(0.1, (Command(0, CommandKind.SET_MODE, "MANUAL"),))
    altitudes = []
    for step in range(400):
        wanted_roll = 0.25 if step < 200 else -0.25
        roll = 0.8 * (wanted_roll - bird.roll) - 0.1 * bird.roll_rate
        pitch = 0.8 * (0.15 - bird.pitch) - 0.15 * bird.pitch_rate
        throttle = 0.65 + 0.04 * (20.0 - bird.altitude) + 0.1 * bird.velocity()[2]
        bird.set(
            ch1=round(1500 + 500 * max(-1.0, min(1.0, roll))),
            ch2=round(1500 + 500 * max(-1.0, min(1.0, pitch))),
            ch3=round(1000 + 1000 * max(0.0, min(1.0, throttle))),
        )
        flight.fly(0.05)
        altitudes.append(bird.altitude)
        if step in (190, 390):
            assert bird.roll == pytest.approx(wanted_roll, abs=0.12)
    assert flight.autopilot.state.modes.mode == Mode.MANUAL
    assert abs(altitudes[-1] - 20.0) < 6.0


def test_the_mode_switch_takes_over_from_the_mission_and_back() -> None:
    flight, bird = launched(mode_pulse=2000)
    assert flight.autopilot.state.modes.mode == Mode.AUTO
    bird.set(ch5=1500)
    flight.fly(0.2)
    assert flight.autopilot.state.modes.mode == Mode.LOITER
    bird.set(ch5=1000)
    flight.fly(0.2)
    assert flight.autopilot.state.modes.mode == Mode.STABILIZED
    assert not [entry for entry in flight.of(topics.INPUTS) if "SET_MODE" in entry.text]


def test_the_receiver_is_flown_before_the_joystick_and_the_joystick_after_it() -> None:
    flight, bird = launched()
    flight.fly(1.0, fixed=sticks(roll=-1.0, throttle=0.7))
    assert flight.autopilot.state.pilot.source == PilotSource.RECEIVER
    assert flight.autopilot.state.pilot.roll == 0.0
    bird.on = False
    flight.fly(1.0, fixed=sticks(roll=-1.0, throttle=0.7))
    pilot = flight.autopilot.state.pilot
    assert (pilot.source, pilot.roll, pilot.throttle) == (PilotSource.MANUAL_CONTROL, -1.0, 0.7)
    bird.on = True
    flight.fly(0.1, fixed=sticks(roll=-1.0, throttle=0.7))
    assert flight.autopilot.state.pilot.source == PilotSource.RECEIVER
    reports = [event.text for event in flight.of(topics.EVENTS) if event.source == "pilot"]
    assert reports == ["manual control by receiver", "manual control by MANUAL_CONTROL", "manual control by receiver"]


def test_overridden_channels_are_logged_and_flown() -> None:
    flight = Flight().fly(0.5)
    override = ChannelOverride(0, (1800, 1500, 1500, 1500, *[0] * 14))
    flight.fly(0.1, (override,))
    assert flight.autopilot.state.pilot.roll == pytest.approx(290 / 490)
    assert [entry.pulses for entry in flight.of(topics.OVERRIDE)] == [override.pulses]
    assert flight.of(topics.PILOT)[-1].source == PilotSource.OVERRIDE
    flight.fly(RAVEN.gains.receiver.stick_time + 0.1)
    assert flight.autopilot.state.pilot[1:] == (0.0, 0.0, 0.0, 0.0, PilotSource.NONE)


def test_sticks_are_read_back_from_the_log_as_inputs() -> None:
    """A replay merges the frames with the inputs of MANUAL_CONTROL and overrides and gets the same flight."""
    flight, bird = launched()
    flight.fly(1.0, fixed=sticks(roll=-0.5, throttle=0.7))
    bird.on = False
    flight.fly(1.5, (ChannelOverride(0, (1700, 1500, 1700, 1500, *[0] * 14)),), fixed=sticks(throttle=0.6))
    flight.fly(1.5)
    entered: dict[int, list] = defaultdict(list)
    for stick in flight.of(topics.PILOT):
        if stick.source == PilotSource.MANUAL_CONTROL:
            entered[stick.time_us].append(stick)
    for channels in flight.of(topics.OVERRIDE):
        entered[channels.time_us].append(channels)
    for text in flight.of(topics.INPUTS):
        entered[text.time_us].append(inputs.decode_command(text.text))
    again = Flight()
    for frame in flight.frames:
        again.autopilot.step(frame, entered.get(frame.time_us, ()))
    assert repr(again.reports) == repr(flight.reports)


# --- kill -----------------------------------------------------------------------------------------------


def check_killed(flight: Flight) -> None:
    command = flight.of(topics.ACTUATORS)[-1]
    assert (command.armed, command.throttle, command.elevator, command.rudder) == (0, 0.0, 0.0, 0.0)
    killed = [event for event in flight.of(topics.EVENTS) if event.text.startswith("KILLED")]
    assert [event.severity for event in killed] == [Severity.EMERGENCY]
    # Wings stay where they were when it came.
    last = [c for c in flight.of(topics.ACTUATORS) if c.armed][-1]
    assert (command.wing_left, command.wing_right) == (last.wing_left, last.wing_right)


def test_the_kill_switch_stops_the_wings_at_once_even_on_autopilot() -> None:
    flight, bird = launched(mode_pulse=2000)
    bird.set(ch7=2000)
    flight.fly(0.1)
    check_killed(flight)
    assert flight.autopilot.state.modes.armed == 0


def test_after_a_kill_it_needs_the_switch_off_and_arming_anew() -> None:
    flight, bird = launched()
    bird.set(ch7=2000)
    flight.fly(20.0, until=None)
    refused = flight.fly(0.1, (ARM,)).events()[-1]
    assert refused.startswith("arming denied") and "kill switch" in refused
    bird.set(ch7=1000, ch3=1000)
    flight.fly(0.2)
    assert flight.autopilot.state.modes.armed == 0
    bird.set(ch6=1000)
    flight.fly(0.2)
    bird.set(ch6=2000)
    flight.fly(0.2)
    assert (flight.autopilot.state.modes.armed, flight.autopilot.state.modes.killed) == (1, 0)


@pytest.mark.parametrize(
    "entry",
    [
        Command(0, CommandKind.KILL, source="link"),
        Command(0, CommandKind.DISARM, value=inputs.FORCED_DISARM, source="link"),
        ChannelOverride(0, (0, 0, 0, 0, 0, 0, 2000, *[0] * 11)),
    ],
    ids=["flight termination", "forced disarm", "overridden kill channel"],
)
def test_kill_comes_from_the_ground_too(entry) -> None:
    flight = airborne_flight().fly(5.0)
    flight.fly(0.02, (entry,))
    check_killed(flight)


def test_a_kill_on_the_bench_does_nothing_to_a_disarmed_vehicle() -> None:
    flight = Flight().fly(0.5)
    flight.fly(0.1, (Command(0, CommandKind.KILL),))
    assert not [text for text in flight.events() if "KILLED" in text]


# --- sticks that are lost ---------------------------------------------------------------------------------


def test_without_sticks_a_piloted_flight_circles_and_then_comes_home() -> None:
    flight, bird = launched()
    flight.fly(6.0)
    bird.set(ch1=1700)
    flight.fly(0.5)
    bird.on = False
    flight.fly(RAVEN.gains.receiver.frame_time + 0.1)
    state = flight.autopilot.state
    assert state.modes.mode == Mode.LOITER
    assert state.pilot[1:5] == (0.0, 0.0, 0.0, 0.0)
    assert state.modes.failsafe & Failsafe.PILOT_LOST
    flight.fly(RAVEN.gains.modes.link_loss_delay + 0.1)
    assert flight.autopilot.state.modes.mode == Mode.RETURN
    assert "failsafe: returning, manual control lost" in flight.events()
    bird.on = True
    flight.fly(0.3)
    assert not flight.autopilot.state.modes.failsafe & Failsafe.PILOT_LOST
    bird.set(ch5=1500)
    flight.fly(0.3)
    bird.set(ch5=1000)
    flight.fly(0.3)
    assert flight.autopilot.state.modes.mode == Mode.STABILIZED


def test_a_receiver_in_failsafe_is_lost_though_frames_still_come() -> None:
    flight, bird = launched()
    flight.fly(3.0)
    bird.lost = 1
    flight.fly(RAVEN.gains.receiver.frame_time + 0.1)
    assert flight.autopilot.state.modes.mode == Mode.LOITER


def test_without_a_position_lost_sticks_hold_the_altitude_level() -> None:
    flight, bird = launched()
    flight.fly(4.0)
    bird.gps_on = False
    flight.fly(RAVEN.gains.modes.gps_loss_delay + 0.5)
    bird.on = False
    flight.fly(4.0)
    assert flight.autopilot.state.modes.mode == Mode.ALTITUDE_HOLD
    assert abs(bird.roll) < 0.1


def test_in_altitude_hold_a_lost_receiver_circles_and_a_mode_that_is_chosen_then_stays() -> None:
    flight, bird = launched()
    flight.fly(4.0)
    hold = Command(0, CommandKind.SET_MODE, "ALTITUDE_HOLD")
    flight.fly(1.0, (hold,))
    bird.on = False
    flight.fly(RAVEN.gains.receiver.frame_time + 0.1)
    assert flight.autopilot.state.modes.mode == Mode.LOITER
    flight.fly(1.0, (hold,))
    assert flight.autopilot.state.modes.mode == Mode.ALTITUDE_HOLD
    flight.fly(0.1, (Command(0, CommandKind.SET_MODE, "LOITER"),))
    flight.fly(2.0 * RAVEN.gains.modes.link_loss_delay)
    assert flight.autopilot.state.modes.mode == Mode.LOITER


def test_a_mission_goes_on_without_the_receiver_and_says_so() -> None:
    flight, bird = launched(mode_pulse=2000)
    flight.fly(4.0)
    bird.on = False
    flight.fly(10.0)
    modes = flight.autopilot.state.modes
    assert (modes.mode, modes.failsafe) == (Mode.AUTO, Failsafe.RECEIVER_LOST)
    assert flight.events().count("failsafe: receiver lost") == 1
    bird.on = True
    flight.fly(2.0)
    assert flight.autopilot.state.modes.failsafe == 0
    assert flight.events()[-1] == "failsafe cleared: receiver lost"


def test_a_receiver_that_was_never_heard_is_not_lost_and_one_that_was_hinders_arming() -> None:
    flight, bird = radio_flight()
    bird.on = False
    flight.fly(3.0)
    assert flight.autopilot.state.modes.failsafe == 0
    bird.on = True
    flight.fly(0.1)
    bird.on = False
    flight.fly(1.0)
    flight.fly(0.1, (ARM,))
    assert flight.autopilot.state.modes.armed == 0
    assert flight.events()[-1] == "arming denied: receiver lost"


def test_a_mission_does_not_miss_the_sticks() -> None:
    flight = airborne_flight().fly(6.0)
    assert flight.autopilot.state.modes.mode == Mode.AUTO
    assert not flight.autopilot.state.modes.failsafe


def test_a_snapshot_keeps_the_pilot() -> None:
    flight, bird = launched()
    flight.fly(1.0, (ChannelOverride(0, (1700, 1500, 1700, 1500, *[0] * 14)),))
    other = Flight(mission=())
    other.autopilot.restore(flight.autopilot.snapshot())
    assert other.autopilot.state == flight.autopilot.state
    mark = len(flight.reports)
    bird.on = False
    flight.fly(1.0)
    for frame in flight.frames[-200:]:
        other.autopilot.step(frame)
    assert repr(other.reports) == repr(flight.reports[mark:])


# --- LOITER ---------------------------------------------------------------------------------------------


@pytest.mark.validate
def test_loiter_circles_where_it_was_asked_for() -> None:
    flight = en_route().fly(5.0)
    bird = flight.bird
    before, north, east = bird.altitude, bird.north, bird.east
    flight.fly(0.1, (Command(0, CommandKind.SET_MODE, "LOITER"),))
    flight.fly(25.0)
    state, radius = flight.autopilot.state.navigation, RAVEN.gains.navigation.loiter_radius
    away = []
    for _ in range(60):
        flight.fly(0.5)
        away.append(math.dist((bird.north, bird.east), (state.centre_north, state.centre_east)))
    assert max(abs(distance - radius) for distance in away) < 5.0
    assert math.dist((north, east), (state.centre_north, state.centre_east)) == pytest.approx(radius, abs=3.0)
    assert bird.altitude == pytest.approx(before, abs=3.0)


def test_auto_goes_on_after_loiter() -> None:
    flight = en_route().fly(2.0)
    item = flight.autopilot.state.navigation.item
    flight.fly(3.0, (Command(0, CommandKind.SET_MODE, "LOITER"),))
    flight.fly(1.0, (AUTO,))
    assert flight.autopilot.state.navigation.item == item
