"""The whole flight computer: flights of the surrogate bird, determinism, snapshots, inputs, bad sensors."""

import copy
import itertools
import json
import math
from functools import cache

import pytest
from surrogate import Bird
from surrogate_gains import VEHICLE as RAVEN

from avionics import inputs, processors, topics
from avionics.autopilot import Autopilot
from avionics.guidance.mission import Channel, Excitation, ItemKind, MissionItem, Shape
from avionics.messages import Command, CommandKind, Failsafe, Mode, PilotInput, SensorFrame, Stage
from avionics.missions import load_mission
from avionics.state import FORMER_NAMES, decode_state
from avionics.tasks import guide, sense, stabilize
from wingbeat.errors import InputError
from wingbeat.topic import Topic

ARM = Command(0, CommandKind.ARM, source="script")
AUTO = Command(0, CommandKind.SET_MODE, "AUTO", source="script")
LOW = (
    MissionItem(ItemKind.TAKEOFF, altitude=14.0),
    MissionItem(ItemKind.HOLD, altitude=14.0, heading=1.5, duration=4.0),
    MissionItem(ItemKind.EXCITE, excitation=Excitation(Channel.ELEVATOR, Shape.DOUBLET, 0.08, 0.2, 0.5, 2)),
    MissionItem(ItemKind.LAND, north=60.0, east=220.0, heading=1.5),
)


class Flight:
    """An autopilot and a bird, with everything that was published."""

    def __init__(self, mission=LOW, bird: Bird | None = None, schedule=processors.SCHEDULE) -> None:
        self.reports: list = []
        self.autopilot = Autopilot(
            RAVEN, mission, lambda topic, message: self.reports.append((topic, message)), schedule
        )
        self.bird = bird or Bird()
        self.frames: list[SensorFrame] = []

    def fly(
        self, seconds: float, commands=(), until: Stage | None = None, fixed: PilotInput | None = None
    ) -> "Flight":
        """``fixed`` sticks are said ten times a second, as a ground station does."""
        for tick in range(round(seconds * 200)):
            frame = self.bird.frame()
            self.frames.append(frame)
            reports = (fixed,) if fixed is not None and tick % 20 == 0 else ()
            self.bird.advance(self.autopilot.step(frame, (*commands, *reports)))
            commands = ()
            if until is not None and self.autopilot.state.modes.stage == until:
                break
        return self

    def branch(self) -> "Flight":
        """The same flight as it stands, to be flown on by itself; messages and frames are immutable."""
        twin = Flight(bird=copy.deepcopy(self.bird))
        twin.autopilot.restore(self.autopilot.snapshot())
        twin.reports[:], twin.frames[:] = self.reports, self.frames
        return twin

    def launch(self) -> "Flight":
        self.fly(3.0)
        self.fly(0.5, (AUTO, ARM))
        self.bird.throw()
        return self

    def of(self, topic: Topic) -> list:
        return [message for each, message in self.reports if each is topic]

    def events(self) -> list[str]:
        return [event.text for event in self.of(topics.EVENTS)]


@cache
def whole_flight() -> Flight:
    return Flight().launch().fly(120.0, until=Stage.LANDED)


@cache
def _launched() -> Flight:
    return Flight().launch()


@cache
def _en_route() -> Flight:
    return airborne_flight().fly(60.0, until=Stage.EN_ROUTE)


@cache
def _ten_seconds() -> Flight:
    return airborne_flight().fly(10.0)


def airborne_flight() -> Flight:
    """Armed and thrown; flown once for all who begin so, as the two below are."""
    return _launched().branch()


def en_route() -> Flight:
    """Climbed out to the mission's height."""
    return _en_route().branch()


def ten_seconds() -> Flight:
    """Ten seconds after the throw."""
    return _ten_seconds().branch()


def test_a_mission_is_flown_from_the_hand_to_the_ground() -> None:
    flight = whole_flight()
    reports = flight.events()
    for words in (
        "armed",
        "launched",
        "waypoint 0 reached (takeoff 14 m)",
        "waypoint 1 reached (hold 86 deg, 14 m)",
        "stage flare",
    ):
        assert words in reports
    assert reports[-1] == "touchdown, disarmed"
    assert flight.bird.altitude == 0.0
    stages = [status.stage for status in flight.of(topics.NAVIGATION)]
    flown = [stage for i, stage in enumerate(stages) if i == 0 or stage != stages[i - 1]]
    assert flown[:5] == [Stage.ON_GROUND, Stage.WAIT_LAUNCH, Stage.CLIMB_OUT, Stage.EN_ROUTE, Stage.APPROACH]
    assert math.dist((flight.bird.north, flight.bird.east), (60.0, 220.0)) < 60.0


def test_wings_are_still_on_the_hand_and_after_the_landing() -> None:
    flight = whole_flight()
    commands = flight.of(topics.ACTUATORS)
    glide = RAVEN.gains.flapping.glide_angle
    assert {command.wing_left for command in commands[:690]} == {glide}
    assert commands[-1].armed == 0


def test_the_hold_keeps_altitude_and_heading() -> None:
    flight = whole_flight()
    rows = [status for status in flight.of(topics.NAVIGATION) if status.item == 1]
    start, end = rows[-60].time_us, rows[-1].time_us
    heights = [a.altitude for a in flight.of(topics.ALTITUDE) if start < a.time_us < end]
    headings = [a.yaw for a in flight.of(topics.ATTITUDE) if start < a.time_us < end]
    assert max(abs(height - 14.0) for height in heights) < 3.0
    assert max(abs(heading - 1.5) for heading in headings) < 0.15


def test_doublets_are_flown_with_the_loops_frozen() -> None:
    flight = whole_flight()
    active = [status for status in flight.of(topics.EXCITATION) if status.active]
    assert {status.manoeuvre for status in active} == {1, 2}
    assert max(status.elevator for status in active) == pytest.approx(0.08, abs=1e-3)
    assert min(status.elevator for status in active) == pytest.approx(-0.08, abs=1e-3)
    for number in (1, 2):
        times = [status.time_us for status in active if status.manoeuvre == number]
        throttles = [a.throttle for a in flight.of(topics.ALTITUDE_LOOP) if times[1] < a.time_us <= times[-1]]
        elevators = [p.elevator for p in flight.of(topics.PITCH_LOOP) if times[1] < p.time_us <= times[-1]]
        # The altitude loop runs at half the rate and may have one turn left when the manoeuvre begins.
        assert len(set(throttles[1:])) == 1
        assert len(set(elevators)) == 1
        assert sum(status.frozen for status in flight.of(topics.NAVIGATION)) > 20


def test_every_topic_comes_at_its_rate() -> None:
    flight = whole_flight()
    seconds = (flight.frames[-1].time_us - flight.frames[0].time_us) * 1e-6
    silent = {
        topics.RECEIVER,
        topics.RANGE,
        topics.TORQUE_RAW,
        topics.DRIVE_TORQUE,
        topics.TIMING,
        topics.LINK_EVENTS,
    }
    for topic in topics.TOPICS:
        if topic.rate and topic not in silent:
            assert len(flight.of(topic)) == pytest.approx(topic.rate * seconds, rel=0.02, abs=2), topic.name
    for topic, message in flight.reports:
        assert isinstance(message, topic.message)


def test_messages_hold_plain_numbers_of_their_types() -> None:
    for topic, message in whole_flight().reports[::37]:
        if topic in (topics.EVENTS, topics.INPUTS, topics.SNAPSHOTS, topics.ADC):
            continue
        for name, value in message._asdict().items():
            assert isinstance(value, int | float), (topic.name, name, type(value))
            assert type(value).__module__ != "numpy", (topic.name, name)


@pytest.mark.validate
def test_the_same_frames_give_the_same_bytes() -> None:
    first = whole_flight()
    again = Flight().launch().fly(10.0)
    assert repr(first.reports[: len(again.reports)]) == repr(again.reports)


def test_a_restored_snapshot_continues_bit_for_bit() -> None:
    # Not from `thrown`, which was restored itself.
    flight = Flight().launch().fly(12.0)
    text = flight.autopilot.snapshot()
    assert json.loads(text)["clock"]
    other = Flight(mission=())
    other.autopilot.restore(text)
    assert other.autopilot.state == flight.autopilot.state
    assert other.autopilot.snapshot() == text
    mark = len(flight.reports)
    flight.fly(11.0)
    for frame in flight.frames[-2200:]:
        other.autopilot.step(frame)
    assert repr(other.reports) == repr(flight.reports[mark:])


def test_snapshot_with_former_field_names_restores() -> None:
    autopilot = Flight().launch().fly(3.0).autopilot
    former = {new: old for old, new in FORMER_NAMES.items()}
    document = {former.get(key, key): value for key, value in json.loads(autopilot.snapshot()).items()}
    assert set(FORMER_NAMES) <= set(document)
    assert decode_state(json.dumps(document)) == autopilot.state


def test_a_published_snapshot_restores_too() -> None:
    flight = whole_flight()
    snapshot = flight.of(topics.SNAPSHOTS)[2]
    other = Flight(mission=())
    other.autopilot.restore(snapshot.text)
    frames = [frame for frame in flight.frames if frame.time_us > snapshot.time_us][:600]
    actuators = [other.autopilot.step(frame) for frame in frames]
    logged = [a for a in flight.of(topics.ACTUATORS) if a.time_us > snapshot.time_us][:600]
    assert actuators == logged


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"gains":3}', "null"])
def test_what_is_no_snapshot_is_refused_and_loses_nothing(text: str) -> None:
    flight = Flight().fly(0.5)
    before = flight.autopilot.state
    with pytest.raises(InputError, match="not a snapshot"):
        flight.autopilot.restore(text)
    assert flight.autopilot.state == before


# --- inputs ---------------------------------------------------------------------------------------------


def test_every_command_is_logged_before_it_is_applied() -> None:
    flight = Flight().fly(2.0)
    flight.fly(0.1, (AUTO, ARM))
    order = [topic.name for topic, _ in flight.reports if topic in (topics.INPUTS, topics.EVENTS)]
    assert order[-4:] == ["/system/inputs", "/system/events"] * 2
    text = flight.of(topics.INPUTS)[-1]
    command = inputs.decode_command(text.text)
    assert command == ARM._replace(time_us=text.time_us)
    assert text.time_us == flight.frames[-20].time_us


@pytest.mark.parametrize(
    "command",
    [
        Command(7, CommandKind.SET_MISSION, payload=tuple(load_mission("circuit")), source="link"),
        Command(7, CommandKind.EXCITE, payload=LOW[2].excitation),
        Command(7, CommandKind.SET_PARAMETER, "PITCH_P", 0.1 + 0.2),
    ],
)
def test_commands_come_back_from_the_log_exactly(command: Command) -> None:
    assert inputs.decode_command(inputs.encode_command(command)) == command


def test_parameters_missions_and_items_are_set_in_flight() -> None:
    flight = airborne_flight().fly(1.0)
    mission = (MissionItem(ItemKind.HOLD, altitude=20.0, heading=0.5, duration=1.0), *LOW)
    flight.fly(
        0.1,
        (
            Command(0, CommandKind.SET_PARAMETER, "PITCH_P", 0.75),
            Command(0, CommandKind.SET_MISSION, payload=list(mission)),
            Command(0, CommandKind.SET_CURRENT_ITEM, value=2.0),
        ),
    )
    state = flight.autopilot.state
    assert (state.gains.pitch.proportional, state.mission, state.navigation.item) == (0.75, mission, 2)


@pytest.mark.parametrize(
    ("command", "word"),
    [
        (Command(0, CommandKind.SET_MODE, "HOVER"), "unknown mode"),
        (Command(0, CommandKind.SET_PARAMETER, "NOPE", 1.0), "unknown parameter"),
        (Command(0, CommandKind.SET_PARAMETER, "PITCH_P", math.nan), "not a number"),
        (Command(0, CommandKind.SET_CURRENT_ITEM, value=99.0), "item 99 denied"),
        (Command(0, CommandKind.SET_CURRENT_ITEM, value=math.nan), "denied"),
        (Command(0, CommandKind.EXCITE, payload=LOW[2].excitation), "excitation denied"),
        (Command(0, CommandKind.SET_MISSION, payload=(MissionItem(ItemKind.EXCITE),)), "mission rejected: item 1"),
        (Command(0, CommandKind.SET_MODE, "RETURN"), "no GPS position"),
        (Command(0, CommandKind.DISARM), "already disarmed"),
    ],
)
def test_a_refused_command_says_why_and_changes_nothing(command: Command, word: str) -> None:
    bird = Bird()
    bird.gps_on = False
    flight = Flight(bird=bird).fly(0.5)
    before = flight.autopilot.state
    flight.fly(0.005, (command,))
    after = flight.autopilot.state
    assert word in flight.events()[-1]
    assert (after.modes.mode, after.gains, after.mission) == (before.modes.mode, before.gains, before.mission)
    assert after.navigation.item == before.navigation.item


def test_an_excitation_over_the_link_is_flown() -> None:
    flight = en_route().fly(1.0)
    flight.fly(3.0, (Command(0, CommandKind.EXCITE, payload=LOW[2]),))
    assert "excitation requested (elevator)" in flight.events()
    assert max(status.elevator for status in flight.of(topics.EXCITATION)) > 0.07


def sticks(pitch=0.0, roll=0.0, yaw=0.0, throttle=0.0) -> PilotInput:
    return PilotInput(0, pitch, roll, yaw, throttle)


def test_in_manual_the_sticks_move_the_tail_and_the_wings() -> None:
    flight = Flight().fly(2.0, fixed=sticks())
    flight.fly(0.1, (ARM,), fixed=sticks())
    flight.fly(1.5, fixed=sticks(0.5, 0.5, 0.2, 0.8))
    command = flight.of(topics.ACTUATORS)[-1]
    gains = RAVEN.gains
    assert command.elevator == pytest.approx(gains.pitch.elevator_trim + 0.5 * gains.pitch.elevator_max)
    assert command.rudder == pytest.approx(0.5 * gains.tail.rudder_share + 0.2 * gains.tail.yaw_share)
    assert flight.of(topics.FLAP)[-1].frequency == pytest.approx(1.0 + 0.8 * 4.5)
    assert flight.of(topics.PILOT)[-1].throttle == 0.8


def test_stabilized_turns_sticks_into_attitude() -> None:
    flight = airborne_flight().fly(4.0)
    mode = Command(0, CommandKind.SET_MODE, "STABILIZED")
    flight.fly(4.0, (mode,), fixed=sticks(roll=0.5, throttle=0.75))
    assert flight.bird.roll == pytest.approx(0.5 * RAVEN.gains.roll.stick_roll, abs=0.06)
    flight.fly(4.0, fixed=sticks(roll=-0.5, throttle=0.75))
    assert flight.bird.roll == pytest.approx(-0.5 * RAVEN.gains.roll.stick_roll, abs=0.06)
    level = flight.bird.pitch
    flight.fly(4.0, fixed=sticks(pitch=0.5, throttle=0.75))
    assert flight.bird.pitch - level == pytest.approx(0.5 * RAVEN.gains.pitch.stick_pitch, abs=0.08)


def test_sticks_that_are_no_numbers_are_refused() -> None:
    flight = Flight().fly(0.5)
    flight.fly(0.1, (sticks(roll=math.nan),))
    assert flight.autopilot.state.pilot[1:5] == (0.0, 0.0, 0.0, 0.0)
    assert flight.autopilot.state.plausibility.rejected == 1


@pytest.mark.validate
def test_link_loss_turns_the_bird_home_and_lands_it() -> None:
    flight = en_route()
    flight.fly(RAVEN.gains.modes.link_loss_delay + 0.5, (Command(0, CommandKind.LINK_LOST, source="link"),))
    assert flight.autopilot.state.modes.mode == Mode.RETURN
    flight.fly(30.0)
    assert math.hypot(flight.bird.north, flight.bird.east) < RAVEN.gains.navigation.loiter_radius + 15.0
    flight.fly(250.0, until=Stage.LANDED)
    assert flight.autopilot.state.modes.stage == Stage.LANDED


def test_without_gps_the_heading_is_held() -> None:
    flight = en_route().fly(6.0)
    flight.bird.gps_on = False
    flight.fly(5.0)
    assert flight.of(topics.HEALTH)[-1].failsafe == Failsafe.GPS_LOST
    assert flight.bird.yaw == pytest.approx(1.5, abs=0.25)


# --- bad sensors ----------------------------------------------------------------------------------------


def test_time_that_goes_backwards_is_refused_once_said_and_the_last_actuators_kept() -> None:
    flight = Flight().fly(1.0)
    before = flight.autopilot.state
    old = flight.frames[50]
    for _ in range(3):
        command = flight.autopilot.step(old)
    assert command == before.actuators._replace(time_us=old.time_us)
    after = flight.autopilot.state
    assert after.plausibility.rejected == before.plausibility.rejected + 3
    assert after.attitude == before.attitude
    assert sum("sensor time" in text for text in flight.events()) == 1


def test_one_frame_far_ahead_is_refused_and_the_flight_goes_on_by_the_old_clock() -> None:
    flight = ten_seconds()
    before, reports = flight.autopilot.state, len(flight.events())
    frame = flight.bird.frame()
    ahead = 40_000_000
    command = flight.autopilot.step(frame.shifted(ahead))
    assert command == before.actuators._replace(time_us=frame.time_us + ahead)
    assert flight.autopilot.state.attitude == before.attitude
    flight.fly(2.0)
    assert flight.autopilot.state.clock.time_us == flight.frames[-1].time_us
    assert [text for text in flight.events()[reports:] if "failsafe" in text or "sensor clock" in text] == []
    assert sum("sensor time" in text for text in flight.events()) == 1


def test_a_clock_that_stays_ahead_is_followed() -> None:
    flight = ten_seconds()
    for _ in range(100):
        frame = flight.bird.frame()
        flight.bird.advance(flight.autopilot.step(frame.shifted(40_000_000)))
    state = flight.autopilot.state
    assert state.clock.time_us == pytest.approx(frame.time_us, abs=200_000)
    assert [text for text in flight.events() if "sensor clock" in text] == [
        "sensor clock 40.095 s ahead: new time base accepted"
    ]
    assert state.modes.failsafe == 0


@pytest.mark.parametrize(
    "name", ["RC_KILL_CHANNEL", "RC_MODE_CHANNEL", "RC_ARM_CHANNEL", "IMU_ACCEL_OFS_1", "WING_ZERO_LEFT"]
)
def test_what_would_kill_in_flight_is_set_on_the_ground_alone(name: str) -> None:
    asked = Command(0, CommandKind.SET_PARAMETER, name, 2.0)
    flight = airborne_flight().fly(1.0)
    before = flight.autopilot.state.gains
    flight.fly(0.005, (asked,))
    assert flight.autopilot.state.gains == before
    assert f"{name} denied: armed, disarm first" in flight.events()
    assert Flight().fly(0.1, (asked,)).autopilot.state.gains != before


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e6, math.radians(2000.0), -math.radians(2000.0)])
def test_an_impossible_imu_sample_is_refused_and_the_last_good_one_kept(value: float) -> None:
    flight = Flight().fly(1.0)
    good = flight.autopilot.state
    for _ in range(10):
        flight.bird.advance(good.actuators)
        frame = flight.bird.frame()
        flight.autopilot.step(frame._replace(imu=frame.imu._replace(gyro_y=value)))
    state = flight.autopilot.state
    assert state.frame.imu == good.frame.imu
    assert state.attitude == good.attitude
    assert state.plausibility.rejected == 10
    assert sum("IMU sample rejected" in text for text in flight.events()) == 1


@pytest.mark.parametrize("bad", [{"accel_x": math.nan}, {"gyro_z": math.radians(2000.0)}], ids=["no number", "full"])
def test_an_imu_that_stays_bad_is_a_fault_and_hinders_arming(bad: dict[str, float]) -> None:
    flight = Flight().fly(3.0)
    for i in range(200):
        flight.bird.advance(flight.autopilot.state.actuators)
        frame = flight.bird.frame()
        frame = frame._replace(imu=frame.imu._replace(**bad))
        flight.autopilot.step(frame, (ARM,) if i == 150 else ())
    assert flight.autopilot.state.modes.failsafe & Failsafe.IMU_FAULT
    assert any("arming denied" in text and "IMU" in text for text in flight.events())
    flight.fly(1.0)
    assert not flight.autopilot.state.modes.failsafe & Failsafe.IMU_FAULT


def test_bad_samples_of_the_other_sensors_are_refused_one_by_one() -> None:
    flight = Flight().fly(1.0)
    while flight.bird.frame().pressures is None or flight.bird.frame().adc is None:
        flight.fly(0.005)
    frame = flight.bird.frame()
    before = flight.autopilot.state
    bad = frame._replace(
        encoder=frame.encoder._replace(left_counts=10**7),
        pressures=frame.pressures._replace(static_counts=-(2**31)),
        adc=frame.adc._replace(current_counts=(-5,) * 60),
        gps=flight.bird.fix((math.nan, 0.0, 0.0)),
    )
    flight.autopilot.step(bad)
    after = flight.autopilot.state
    assert after.plausibility.rejected == before.plausibility.rejected + 4
    assert (after.wing, after.air, after.power_state, after.last_fix) == (
        before.wing,
        before.air,
        before.power_state,
        before.last_fix,
    )


def test_an_encoder_that_was_reset_is_believed_after_a_while() -> None:
    flight = Flight().fly(1.0)
    for _ in range(40):
        flight.bird.advance(flight.autopilot.state.actuators)
        frame = flight.bird.frame()
        jumped = frame.encoder._replace(left_counts=frame.encoder.left_counts + 5000)
        flight.autopilot.step(frame._replace(encoder=jumped))
    assert flight.autopilot.state.plausibility.encoder_refused == 0


def test_a_gap_in_the_sensors_does_not_upset_the_loops() -> None:
    flight = ten_seconds()
    for _ in range(30):
        flight.bird.advance(flight.autopilot.state.actuators)
    flight.fly(3.0)
    assert abs(flight.bird.roll) < 0.5
    assert flight.bird.altitude > 3.0


# --- the board's stopwatch ------------------------------------------------------------------------------


def test_run_times_are_published_for_each_processor_and_change_nothing_else() -> None:
    ticks = iter(range(0, 10**12, 1000))
    watch = processors.Stopwatch(lambda: next(ticks))
    flight = Flight(schedule=watch.schedule)
    for _ in range(450):
        frame = flight.bird.frame()
        flight.bird.advance(flight.autopilot.step(frame))
        watch.tick(frame.time_us, lambda topic, message: flight.reports.append((topic, message)))
    timings = flight.of(topics.TIMING)
    assert [timing.processor for timing in timings] == [0, 1, 2, 3] * 2
    assert all(0.0 < timing.mean_us <= timing.worst_us for timing in timings)
    assert all(timing.overruns == 0 for timing in timings)
    plain = Flight().fly(450 / 200)
    assert repr([row for row in flight.reports if row[0] is not topics.TIMING]) == repr(plain.reports)


def test_rates_must_divide_the_base_rate() -> None:
    table = {processors.Processor.MAIN: (processors.Task(processors.Part.MIX, 30.0, 0, lambda s, publish: None),)}
    with pytest.raises(ValueError, match="divide"):
        processors.build_schedule(table)


@pytest.mark.parametrize("phase", [-1, 4])
def test_a_phase_lies_between_two_turns(phase: int) -> None:
    table = {processors.Processor.MAIN: (processors.Task(processors.Part.MIX, 50.0, phase, lambda s, publish: None),)}
    with pytest.raises(ValueError, match="phase"):
        processors.build_schedule(table)


STEP = {100.0: "dt_100", 50.0: "dt_50", 20.0: "dt_20"}


def test_every_task_has_its_turn_at_its_rate_and_phase_and_the_clock_tells_its_step() -> None:
    turns: dict[processors.Run, list[tuple[int, int, float]]] = {}

    def recorded(rows):
        def run(s, publish) -> None:
            for _, task in rows:
                step = getattr(s.clock, STEP.get(task.rate, "dt"))
                turns.setdefault(task.run, []).append((s.clock.ticks, s.clock.time_us, step))
                task.run(s, publish)

        return (run,)

    flight = Flight(schedule=processors.build_schedule(processors.PROCESSORS, recorded))
    for tick in range(200):
        frame = flight.bird.frame()
        time_us = 5000 * tick + 37 * tick * tick % 1900
        flight.autopilot.step(frame._replace(time_us=time_us, imu=frame.imu._replace(time_us=time_us)))
    for task in (task for table in processors.PROCESSORS.values() for task in table):
        found = turns[task.run]
        assert [turn[0] for turn in found] == list(range(task.phase, 200, round(200 / task.rate)))
        if task.rate >= 20.0:
            for before, now in itertools.pairwise(found):
                assert now[2] == pytest.approx((now[1] - before[1]) * 1e-6, abs=1e-12), task


def test_the_tick_of_the_pressure_filters_is_spared_what_can_wait() -> None:
    others = {sense.wings, sense.tail, guide.modes, guide.navigation, stabilize.pitch, stabilize.roll}
    for due in processors.SCHEDULE[::4]:
        assert others.isdisjoint(run for part in due for run in part)
