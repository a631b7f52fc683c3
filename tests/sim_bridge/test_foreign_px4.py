"""PX4's simulator interface over a real socket, with a scripted PX4 on the stock MAVLink dialect."""

from __future__ import annotations

import math
import socket
import threading
from typing import Any

import pytest
from foreign_bench import RIG, PlanePilot, ScriptedPx4, Serving, Stages, ToyStages
from hypothesis import given
from hypothesis import strategies as st
from ports import free_port
from pymavlink.dialects.v20 import common

from avionics import topics
from avionics.link.codec import FrameWriter
from avionics.messages import GpsFix, ImuSample, PressureSample, ReceiverSample, SensorFrame
from sim_bridge import topics as truth_topics
from sim_bridge.bridge.foreign import px4_wire as wire
from sim_bridge.bridge.foreign.outputs import Outputs
from sim_bridge.bridge.foreign.px4 import Echo, Px4Server, Timeouts
from sim_bridge.bridge.foreign.world import AutopilotSilent, Interface
from sim_bridge.sensors.suite import ticks_of
from wingbeat.errors import InputError

BRIEF = Timeouts(connect=5.0, hello=5.0, moment=0.05, stall=0.2, silence=0.6)
AIR = RIG.vehicle.gains.air_data
FLYING = Outputs(0.1, -0.2, 0.6, 0.3, 1)


def served(stages: Any, timeouts: Timeouts = BRIEF, speed: float | None = 1000.0) -> tuple[Serving, list[str]]:
    told: list[str] = []
    url = f"tcp:127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    return Serving(Px4Server(Interface(url, speed), RIG, told.append, timeouts), stages), told


def full_frame(time_us: int) -> SensorFrame:
    """A frame with everything in it now and then."""
    tick = time_us // 4000
    return SensorFrame(
        time_us,
        ImuSample(time_us, 1.0, 2.0, -9.81, 0.1, 0.2, 0.3, 0.21, 0.01, 0.42),
        pressures=PressureSample(time_us, 9_500_000, 8192, 28_815) if tick % 5 == 0 else None,
        gps=GpsFix(time_us, 0.84, 0.2, 520.0, 3.0, 4.0, -0.5, 2.5, 4.0, 3, 9) if tick % 50 == 0 else None,
        receiver=ReceiverSample(time_us, (1500,) * 8, 0, 200) if tick % 5 == 0 else None,
    )


def parsed(payload: bytes, message_id: int) -> Any:
    """What a stock MAVLink reads of a payload."""
    return common.MAVLink(None).parse_buffer(FrameWriter(1, 200).frame(message_id, payload))[0]


def sensors_of(px4: ScriptedPx4) -> list[Any]:
    return [message for message in px4.received if message.get_type() == "HIL_SENSOR"]


def receive_sensors(px4: ScriptedPx4, number: int) -> None:
    """Listen without answering until so many more sensor frames have come."""
    before = len(sensors_of(px4))
    while len(sensors_of(px4)) < before + number:
        assert px4.receive(), "simulator disconnected"


# --- units ------------------------------------------------------------------------------------------------


def test_hil_sensor_tells_each_group_by_all_of_its_bits_in_the_standards_units() -> None:
    sent = parsed(wire.encode_sensors(full_frame(20_000), True, AIR), wire.HIL_SENSOR)
    assert sent.fields_updated == 0x7 | 0x38 | 0x1C0 | 0x1A00 | 0x400
    assert (sent.time_usec, sent.id) == (20_000, 0)
    assert (sent.xacc, sent.zacc, sent.ygyro, sent.zmag) == pytest.approx((1.0, -9.81, 0.2, 0.42))
    assert (sent.abs_pressure, sent.temperature) == pytest.approx((950.0, 15.0), abs=1e-3)
    assert sent.diff_pressure == pytest.approx(0.0, abs=1e-3)
    assert sent.pressure_alt == pytest.approx(540.3, abs=0.5)
    alone = parsed(wire.encode_sensors(full_frame(4000), False, AIR), wire.HIL_SENSOR)
    assert alone.fields_updated == 0x7 | 0x38


def test_differential_pressure_is_in_hectopascal_and_positive_in_flight() -> None:
    counts = round(AIR.differential_low + 0.75 * (AIR.differential_high - AIR.differential_low))
    frame = full_frame(20_000)
    assert frame.pressures is not None
    frame = frame._replace(pressures=frame.pressures._replace(differential_counts=counts))
    sent = parsed(wire.encode_sensors(frame, True, AIR), wire.HIL_SENSOR)
    assert sent.diff_pressure == pytest.approx(0.5 * AIR.differential_range / 100.0, rel=1e-3)


@given(st.tuples(*[st.floats(-1e4, 1e4)] * 9))
def test_force_and_rate_never_leave_what_sixteen_bits_hold(values: tuple[float, ...]) -> None:
    frame = SensorFrame(8000, ImuSample(8000, *values))
    sent = parsed(wire.encode_sensors(frame, False, AIR), wire.HIL_SENSOR)
    counts = [round(axis / (9.80665 / 2048.0)) for axis in (sent.xacc, sent.yacc, sent.zacc)]
    rates = [round(math.degrees(axis) / (2000.0 / 32768.0)) for axis in (sent.xgyro, sent.ygyro, sent.zgyro)]
    assert all(-32768 <= count <= 32767 for count in counts + rates)


@given(
    st.integers(0, 2**63), st.lists(st.floats(-1.0, 1.0, width=32), min_size=16, max_size=16), st.booleans(),
    st.booleans(),
)  # fmt: skip
def test_controls_of_the_stock_dialect_are_read_back(
    time_us: int, values: list[float], armed: bool, lockstep: bool
) -> None:
    message = common.MAVLink_hil_actuator_controls_message(time_us, values, 1 | 128 * armed, int(lockstep))
    packed = message.pack(common.MAVLink(None, 1, 1))
    payload = packed[10:-2]  # MAVLink 2 has cut trailing zeros off
    assert wire.decode_controls(payload) == (time_us, tuple(values), int(armed), int(lockstep))


def test_the_receiver_is_told_as_rc_channels() -> None:
    message: Any = wire.rc_channels(ReceiverSample(123_000, (1000, 1100, 1200, 1300, 1400, 1500, 1600, 1700), 0, 254))
    assert (message.time_boot_ms, message.chancount, message.rssi) == (123, 8, 254)
    assert (message.chan1_raw, message.chan8_raw, message.chan9_raw) == (1000, 1700, 0xFFFF)


def test_the_echo_finds_the_distance_of_the_clocks_and_what_is_late() -> None:
    echo = Echo().sent(12_000)
    assert not echo.has_started and not echo.prompt
    echo = echo.has_received(
        wire.Controls(4000, (), 0, 1)
    )  # the answer to 8000: 4000 late, which cannot be known yet
    assert echo.prompt and echo.lockstep
    echo = echo.sent(16_000).has_received(wire.Controls(12_000, (), 0, 1))  # PX4's time began at 4000
    assert echo.prompt and echo.distance_us == 4000
    echo = echo.sent(20_000).has_received(wire.Controls(12_000, (), 0, 1))
    assert not echo.prompt and echo.at_us == 16_000


# --- the interface -----------------------------------------------------------------------------------------


def test_it_freewheels_until_the_first_controls_then_every_frame_waits_for_its_answer() -> None:
    stages = ToyStages(1.0, full_frame)
    serving, _ = served(stages, BRIEF._replace(moment=5.0))
    px4 = ScriptedPx4(serving.server.port)
    px4.greet()
    receive_sensors(px4, 10)  # nobody answered, and time went on
    px4.answer(sensors_of(px4)[-1].time_usec, FLYING)
    while fresh := px4.receive():
        for message in fresh:
            if message.get_type() == "HIL_SENSOR":
                px4.answer(message.time_usec, FLYING)
    tally = serving.result()
    times = [message.time_usec for message in sensors_of(px4)]
    assert times == [4000 * number for number in range(1, 251)]
    assert (tally.flights, tally.frames, tally.misses, tally.ended) == (1, 250, 0, "the simulation finished")
    commanded = stages.worlds[0].requested[-1][0]
    assert commanded.armed == 1 and commanded.elevator < 0.0 < commanded.rudder
    assert {duration for _, duration in stages.worlds[0].requested} == {0.004}


def test_rates_and_groups_of_what_is_sent() -> None:
    stages = ToyStages(1.2, full_frame)
    serving, _ = served(stages)
    px4 = ScriptedPx4(serving.server.port)
    px4.greet()
    while px4.receive():
        pass
    serving.result()
    kinds = [message.get_type() for message in px4.received]
    assert kinds.count("HIL_SENSOR") == 300 and kinds.count("HIL_GPS") == 6 and kinds.count("RC_CHANNELS") == 60
    assert kinds.count("HIL_STATE_QUATERNION") == pytest.approx(240, abs=2)  # every 5000 us, as was asked
    assert [m.result for m in px4.received if m.get_type() == "COMMAND_ACK"] == [common.MAV_RESULT_ACCEPTED]
    fields = [message.fields_updated for message in sensors_of(px4)]
    assert sum(bool(word & 0x1C0) for word in fields) == 300 / ticks_of(250.0).magnetometer
    assert all(word & 0x3F == 0x3F and word & 0x1C0 in (0, 0x1C0) for word in fields)
    assert all(word & 0x1E00 in (0, 0x1E00) for word in fields)
    gps = next(message for message in px4.received if message.get_type() == "HIL_GPS")
    assert (gps.eph, gps.epv, gps.vn, gps.vd, gps.vel) == (250, 400, 300, -50, 500)
    # What belongs to a time is there before the HIL_SENSOR that sets the clock.
    assert kinds[-1] == "HIL_SENSOR"


def test_an_answer_that_does_not_come_is_missed_and_counted_and_the_last_command_holds() -> None:
    stages = ToyStages(0.2, full_frame)
    serving, _ = served(stages, BRIEF._replace(moment=0.01, stall=30.0))
    px4 = ScriptedPx4(serving.server.port)
    px4.greet()
    receive_sensors(px4, 1)
    px4.answer(sensors_of(px4)[0].time_usec, FLYING)
    while px4.receive():
        pass
    tally = serving.result()
    assert tally.answers == 1 and tally.misses >= 1
    assert tally.frames == 50 and stages.worlds[0].requested[-1][0].armed == 1


def test_disarmed_or_without_lockstep_nothing_waits() -> None:
    for outputs, flags in ((Outputs(), 1), (FLYING, 0)):
        serving, _ = served(ToyStages(0.4, full_frame), BRIEF._replace(moment=30.0, silence=60.0))
        px4 = ScriptedPx4(serving.server.port)
        px4.greet()
        receive_sensors(px4, 1)
        px4.answer(sensors_of(px4)[0].time_usec, outputs, flags)
        while px4.receive():
            pass
        tally = serving.result()
        assert (tally.frames, tally.misses) == (100, 0)


def test_controls_that_are_no_numbers_are_refused_and_counted() -> None:
    stages = ToyStages(0.1, full_frame)
    serving, _ = served(stages)
    px4 = ScriptedPx4(serving.server.port)
    px4.greet()
    receive_sensors(px4, 1)
    px4.answer(4000, FLYING._replace(elevator=math.nan))
    while px4.receive():
        pass
    tally = serving.result()
    assert (tally.rejected, tally.answers) == (1, 0)
    assert all(command.armed == 0 for command, _ in stages.worlds[0].requested)


def test_who_falls_silent_is_named_with_the_frame_that_was_answered_last() -> None:
    serving, told = served(ToyStages(1e6, full_frame))
    px4 = ScriptedPx4(serving.server.port, clock_at_boot=False)
    px4.greet()
    receive_sensors(px4, 1)
    px4.answer(4000, FLYING)
    drain = threading.Thread(target=lambda: [None for _ in iter(lambda: px4.stream.recv(65536), b"")])
    drain.start()
    with pytest.raises(AutopilotSilent, match=r"PX4 at 127.0.0.1:\d+ timed out after 1 s; .* t = 0\.00\d s"):
        serving.result()
    drain.join(10.0)
    assert any("timed out; last response at t = 0.00" in line for line in told)


def test_who_hangs_up_may_come_back_and_starts_from_the_hand() -> None:
    stages = ToyStages(0.4, full_frame)
    serving, told = served(stages)
    first = ScriptedPx4(serving.server.port)
    first.greet()
    receive_sensors(first, 2)
    first.stream.close()
    second = ScriptedPx4(serving.server.port)
    second.greet()
    while second.receive():
        pass
    tally = serving.result()
    assert tally.flights == 2 and len(stages.worlds) == 2
    assert sensors_of(second)[0].time_usec == 4000
    assert any("disconnected; it restarts on the launcher when it reconnects" in line for line in told)


def test_a_stranger_is_told_what_he_is_and_the_next_one_is_served() -> None:
    serving, told = served(ToyStages(0.1, full_frame), BRIEF._replace(hello=0.2))
    other = ScriptedPx4(serving.server.port)
    other.greet(common.MAV_AUTOPILOT_ARDUPILOTMEGA)
    while other.receive():
        pass
    mute = socket.create_connection(("127.0.0.1", serving.server.port))
    assert mute.recv(10) == b""
    px4 = ScriptedPx4(serving.server.port)
    px4.greet()
    while px4.receive():
        pass
    tally = serving.result()
    assert (tally.strangers, tally.flights) == (2, 1)
    assert any("is MAV_AUTOPILOT 3, not PX4 (12)" in line for line in told)
    assert any("sent no HEARTBEAT" in line for line in told)


def test_nobody_comes_or_the_port_is_taken() -> None:
    serving, _ = served(ToyStages(0.1), BRIEF._replace(connect=0.05))
    with pytest.raises(AutopilotSilent, match=r"no PX4 connected to tcp:127.0.0.1:\d+ for 0.05 s"):
        serving.result()
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(InputError, match="cannot listen"):
        Px4Server(Interface(f"tcp:127.0.0.1:{taken.getsockname()[1]}"), RIG, print)


@given(st.lists(st.binary(min_size=1, max_size=300), min_size=1, max_size=4))
def test_noise_changes_nothing_and_costs_no_flight(noise: list[bytes]) -> None:
    stages = ToyStages(0.02, full_frame)
    serving, _ = served(stages)
    px4 = ScriptedPx4(serving.server.port)
    px4.greet()
    receive_sensors(px4, 1)
    try:
        for piece in noise:
            px4.stream.sendall(piece)
        while px4.receive():
            pass
    except ConnectionError:
        pass  # the world is over and hung up while noise was still under way
    tally = serving.result()
    assert tally.frames == 5 and tally.answers == 0
    assert all(command.armed == 0 for command, _ in stages.worlds[0].requested)


# --- a flight ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def flight() -> tuple[Stages, list[Any], Any, list[str]]:
    """Ten seconds of a scripted PX4 on the real world: what it flew on, what it saw, the tally, what was told."""
    stages = Stages(rate=250.0)
    serving, told = served(stages, BRIEF._replace(connect=0.2), None)
    px4 = ScriptedPx4(serving.server.port)
    px4.greet()
    observed = px4.fly(PlanePilot(5.0), 10.0)
    px4.stream.close()
    return stages, observed, serving.result(), told


def test_a_scripted_px4_is_thrown_climbs_and_holds_its_altitude(
    flight: tuple[Stages, list[Any], Any, list[str]],
) -> None:
    stages, observed, tally, told = flight
    late = [one for one in observed if one.time > 7.0]
    assert min(one.altitude for one in observed) > 1.5  # it is never lower than the hand by more than the throw's dip
    assert all(4.0 < one.altitude < 6.5 for one in late)
    assert all(abs(one.roll) < 0.2 and abs(one.pitch) < 0.5 for one in observed)
    assert stages.worlds[0].launched and not stages.worlds[0].truth().on_ground
    assert tally.flights == 1 and tally.rejected == 0 and tally.answers > 2000
    assert [line.split("s  ")[-1] for line in told[1:3]] == ["armed", "launched, throttle 100 %"]


def test_the_flight_is_recorded_truth_sensors_and_commands(flight: tuple[Stages, list[Any], Any, list[str]]) -> None:
    messages = flight[0].logs[0].messages
    ticks = len(messages[truth_topics.STATE.name])
    assert len(messages[topics.IMU.name]) == len(messages[topics.ACTUATORS.name]) == ticks >= 2500
    assert len(messages[topics.GPS.name]) == pytest.approx(ticks / 50, abs=1)
    assert len(messages[topics.PRESSURES.name]) == pytest.approx(ticks / 5, abs=1)
    texts = [event.text for event in messages[truth_topics.EVENTS.name]]
    assert texts[:2] == ["armed", "launched, throttle 100 %"]
