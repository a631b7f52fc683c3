"""ArduPilot's JSON interface over a real socket, with a scripted ArduPlane, a recorded exchange and the real one."""

from __future__ import annotations

import json
import math
import os
import socket
import struct
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from foreign_bench import (
    METRES_PER_DEGREE,
    RIG,
    PlanePilot,
    ScriptedArduPlane,
    Serving,
    Stages,
    ToyStages,
    ToyWorld,
    read_state,
)
from hypothesis import given
from hypothesis import strategies as st
from ports import free_port
from pymavlink import mavutil

from avionics import topics
from avionics.messages import ReceiverSample
from groundstation.command.main import main
from sim_bridge import topics as truth_topics
from sim_bridge.bridge.foreign import ardupilot_wire as wire
from sim_bridge.bridge.foreign.ardupilot import ArduPilotServer, BridgeStatistics, Order, Timeouts, order_of
from sim_bridge.bridge.foreign.flight import Rig
from sim_bridge.bridge.foreign.launch import Launch
from sim_bridge.bridge.foreign.outputs import Pulses
from sim_bridge.bridge.foreign.world import AutopilotSilent, Interface
from sim_bridge.bridge.world import NEUTRAL
from sim_bridge.flight.world import Scenario
from wingbeat.errors import InputError

RECORDED = Path(__file__).parent.parent / "data" / "foreign" / "ardupilot_exchange.jsonl"
BRIEF = Timeouts(stall=0.2, connect=1.0)
MIDDLE = (1500, 1500, 1100, 1500)
UP = (1500, 1500, 1900, 1500)


def served(stages: Any, timeouts: Timeouts = BRIEF, rig: Rig = RIG) -> tuple[Serving, list[str]]:
    told: list[str] = []
    url = f"udpin:127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    return Serving(ArduPilotServer(Interface(url), rig, Pulses(), told.append, timeouts), stages), told


# --- packets ----------------------------------------------------------------------------------------------


@given(st.integers(1, 65535), st.integers(0, 2**32 - 1), st.data())
def test_packets_of_both_kinds_are_read(frame_rate: int, frame_count: int, data: st.DataObject) -> None:
    for magic, number in ((18458, 16), (29569, 32)):
        widths = data.draw(st.lists(st.integers(0, 65535), min_size=number, max_size=number))
        packet = struct.pack(f"<HHI{number}H", magic, frame_rate, frame_count, *widths)
        assert wire.decode_servos(packet) == (frame_rate, frame_count, tuple(widths))


@given(st.binary(max_size=120))
def test_any_other_datagram_is_malformed(data: bytes) -> None:
    sound = len(data) in (40, 72) and data[:2] in (struct.pack("<H", 18458), struct.pack("<H", 29569))
    if not sound:
        with pytest.raises(wire.Malformed):
            wire.decode_servos(data)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "0 bytes, too short"),
        (struct.pack("<HHI16H", 18459, 400, 0, *[1500] * 16), "magic number 18459, expected"),
        (struct.pack("<HHI16H", 18458, 400, 0, *[1500] * 16)[:-1], "39 bytes, expected 40"),
        (struct.pack("<HHI16H", 29569, 400, 0, *[1500] * 16), "40 bytes, expected 72"),
        (struct.pack("<HHI16H", 18458, 0, 0, *[1500] * 16), "frame rate is 0"),
    ],
)
def test_a_malformed_packet_says_what_is_wrong_with_it(data: bytes, why: str) -> None:
    with pytest.raises(wire.Malformed, match=why):
        wire.decode_servos(data)


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_where_a_frame_stands_after_another(last: int, count: int) -> None:
    order = order_of(last, count)
    assert (order is Order.REPEAT) == (count == last)
    assert (order is Order.START) == (count == 0 and last > 0)
    assert (order is Order.NEXT) == (count > last)
    assert order_of(None, count) is Order.START


def test_the_state_has_every_field_where_ardupilots_reader_looks_for_it() -> None:
    world = ToyWorld(1.0)
    observation = world.advance(NEUTRAL, 0.0025)
    received = ReceiverSample(0, (1000, 1100, 1200, 1300, 1400, 1500, 1600, 1700), 0, 200)
    line = wire.encode_state(observation, world.truth(), world.truth_wing(), received)
    state = read_state(line)
    assert state == {
        "timestamp": 0.0025,
        "imu": {"gyro": [0.1, 0.2, 0.3], "accel_body": [0.0, 0.0, -9.81]},
        "position": [1.0, 2.0, -3.0],
        "velocity": [0.0, 0.0, 0.0],
        "quaternion": [1.0, 0.0, 0.0, 0.0],
        "airspeed": 7.0,
        "velocity_wind": [-3.0, 0.0, 0.0],
        "battery": {"voltage": 8.1, "current": 2.5},
        "rng_1": 3.0,
        "rc": {f"rc_{number}": 900 + 100 * number for number in range(1, 9)},
    }
    text = line.decode()
    assert " " not in text and text.index('"velocity"') < text.index('"velocity_wind"')
    assert "rc" not in read_state(wire.encode_state(observation, world.truth(), world.truth_wing(), None))


def test_the_rangefinder_looks_along_the_body_and_no_farther_than_it_can() -> None:
    observed = ToyWorld(1.0).advance(NEUTRAL, 0.0025)
    bank = (math.cos(0.3), math.sin(0.3), 0.0, 0.0)  # 0.6 rad
    assert wire.range_below(observed._replace(quaternion=bank)) == pytest.approx(3.0 / math.cos(0.6))
    assert wire.range_below(observed._replace(quaternion=(0.0, 1.0, 0.0, 0.0))) is None
    assert wire.range_below(observed._replace(position_ned=(0.0, 0.0, -41.0))) is None


# --- the interface ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("frame_rate", "channels"), [(400, 16), (1200, 32), (50, 16)])
def test_each_packet_moves_the_world_by_one_step_of_its_frame_rate(frame_rate: int, channels: int) -> None:
    stages = ToyStages(0.1)
    serving, told = served(stages)
    plane = ScriptedArduPlane(serving.server.port, frame_rate, channels)
    steps = frame_rate // 10
    times = [plane.exchange(UP)["timestamp"] for _ in range(steps)]
    assert times == pytest.approx([number / frame_rate for number in range(1, steps + 1)], abs=1e-6)
    tally = serving.result()
    assert tally == BridgeStatistics(flights=1, frames=steps, ended="the simulation finished")
    assert f"has come with {frame_rate} frames/s" in told[0]
    assert sum(duration for _, duration in stages.worlds[0].requested) == pytest.approx(0.1)
    plane.close()


def test_the_frame_rate_may_change_from_packet_to_packet() -> None:
    serving, _ = served(ToyStages(0.5))
    plane = ScriptedArduPlane(serving.server.port)
    times = [0.0]
    for rate in range(400, 300, -1):  # as ArduPilot glides from one rate to the other
        plane.frame_rate = rate
        times.append(plane.exchange(MIDDLE)["timestamp"])
    wanted = sum(1.0 / rate for rate in range(400, 300, -1))
    assert times[-1] == pytest.approx(wanted, abs=1e-4)
    serving.result()
    plane.close()


def test_a_packet_sent_again_is_answered_again_and_moves_nothing() -> None:
    stages = ToyStages(0.1)
    serving, _ = served(stages)
    plane = ScriptedArduPlane(serving.server.port)
    plane.exchange(MIDDLE)
    first = plane.exchange(UP)
    again = []
    for _ in range(3):
        plane.socket.send(plane.packet(UP, 1))
        again.append(read_state(plane.socket.recv(65536)))
    assert again == [first] * 3
    assert plane.exchange(UP)["timestamp"] == pytest.approx(3 / 400)
    tally = serving.result()
    assert (tally.frames, tally.repeats, len(stages.worlds[0].requested)) == (3, 3, 3)
    plane.close()


def test_lost_frames_are_counted_and_overtaken_ones_dropped() -> None:
    serving, _ = served(ToyStages(1.0))
    plane = ScriptedArduPlane(serving.server.port)
    plane.exchange(MIDDLE)
    plane.frame_count = 6
    assert plane.exchange(MIDDLE)["timestamp"] == pytest.approx(2 / 400)  # physics' own time: no drift
    plane.socket.send(plane.packet(MIDDLE, 3))
    assert plane.exchange(MIDDLE)["timestamp"] == pytest.approx(3 / 400)
    tally = serving.result()
    assert (tally.frames, tally.lost, tally.stale) == (3, 5, 1)
    plane.close()


@pytest.mark.parametrize("same_port", [True, False])
def test_a_frame_count_of_zero_puts_the_vehicle_back_into_the_hand(same_port: bool) -> None:
    stages = ToyStages(1.0)
    serving, told = served(stages)
    plane = ScriptedArduPlane(serving.server.port)
    for _ in range(5):
        plane.exchange(UP)
    again = plane if same_port else ScriptedArduPlane(serving.server.port)
    again.frame_count = 0
    assert again.exchange(MIDDLE)["timestamp"] == pytest.approx(1 / 400)
    tally = serving.result()
    assert (tally.flights, tally.frames, len(stages.worlds)) == (2, 6, 2)
    assert any("starts over" in line for line in told)
    plane.close()
    again.close()


def test_a_second_autopilot_is_refused_and_the_first_flies_on() -> None:
    serving, told = served(ToyStages(1.0))
    first, second = ScriptedArduPlane(serving.server.port), ScriptedArduPlane(serving.server.port)
    first.exchange(MIDDLE)
    for count in (7, 8):
        second.socket.send(second.packet(UP, count))
    assert first.exchange(MIDDLE)["timestamp"] == pytest.approx(2 / 400)
    tally = serving.result()
    assert (tally.strangers, tally.flights) == (2, 1)
    assert sum("second autopilot" in line for line in told) == 1
    first.close()
    second.close()


@given(st.lists(st.binary(max_size=90), min_size=1, max_size=6))
def test_malformed_datagrams_are_refused_counted_and_change_nothing(noise: list[bytes]) -> None:
    stages = ToyStages(2 / 400)
    serving, told = served(stages, Timeouts(stall=10.0, connect=10.0))
    plane = ScriptedArduPlane(serving.server.port)
    plane.exchange(MIDDLE)
    for piece in noise:
        plane.socket.send(piece)
    assert plane.exchange(MIDDLE)["timestamp"] == pytest.approx(2 / 400)
    tally = serving.result()
    assert (tally.malformed, tally.frames, len(stages.worlds)) == (len(noise), 2, 1)
    assert sum("a datagram from" in line for line in told) == 1
    plane.close()


def test_who_falls_silent_is_told_with_his_last_frame_and_when_he_is_back() -> None:
    serving, told = served(ToyStages(1.0), Timeouts(stall=0.05, connect=5.0))
    plane = ScriptedArduPlane(serving.server.port)
    for _ in range(4):
        plane.exchange(MIDDLE)
    plane.socket.settimeout(0.2)
    with pytest.raises(TimeoutError):
        plane.socket.recv(100)  # he says nothing, and nothing is said to him
    plane.exchange(MIDDLE)
    for _ in range(395):
        plane.exchange(MIDDLE)
    serving.result()
    name = f"127.0.0.1:{plane.socket.getsockname()[1]}"
    said = [line for line in told if "timed out" in line or "resumed" in line]
    assert said[0].endswith(f"ArduPilot at {name} timed out after frame 3; waiting")
    assert said[1].endswith("ArduPilot resumed")
    plane.close()


def test_nobody_comes_or_somebody_who_is_no_ardupilot() -> None:
    serving, _ = served(ToyStages(1.0), Timeouts(stall=0.02, connect=0.05))
    with pytest.raises(AutopilotSilent, match=r"no packet of ArduPilot received on 127.0.0.1:\d+ for 0.05 s$"):
        serving.result()
    serving, _ = served(ToyStages(1.0), Timeouts(stall=0.02, connect=1.0))
    stranger = ScriptedArduPlane(serving.server.port)
    stranger.socket.send(b"hello")
    with pytest.raises(AutopilotSilent, match=r"1 datagrams rejected"):
        serving.result()
    stranger.close()
    for url in ("tcp:127.0.0.1:9002", "udpin:nobody.invalid:9002"):
        with pytest.raises(InputError):
            ArduPilotServer(Interface(url), RIG, Pulses(), print)


# --- a flight ---------------------------------------------------------------------------------------------


def test_a_scripted_arduplane_is_thrown_climbs_and_holds_its_altitude_and_all_is_recorded() -> None:
    stages = Stages()
    serving, told = served(stages)
    plane = ScriptedArduPlane(serving.server.port)
    observed = plane.fly(PlanePilot(5.0), 10.0)
    tally = serving.result()
    late = [one for one in observed if one.time > 7.0]
    assert min(one.altitude for one in observed) > 1.5
    assert all(4.0 < one.altitude < 6.5 for one in late)
    assert all(abs(one.roll) < 0.2 and abs(one.pitch) < 0.5 for one in observed)
    assert tally.frames == 4000 and any("launched, throttle" in line for line in told)
    messages = stages.logs[0].messages
    truths = messages[truth_topics.STATE.name]
    assert len(truths) == pytest.approx(2000, abs=2) and len(messages[topics.IMU.name]) == pytest.approx(2000, abs=2)
    assert truths[-1].down == pytest.approx(-observed[-1].altitude, abs=0.05)
    plane.close()


def test_a_recorded_exchange_is_answered_as_it_was() -> None:
    """Servo packets (hex) of the scripted ArduPlane and fields of their answers: held, a repeat, thrown, flapping."""
    rows = [json.loads(line) for line in RECORDED.read_text().splitlines()]
    serving, _ = served(Stages())
    plane = ScriptedArduPlane(serving.server.port)
    for row in rows:
        plane.socket.send(bytes.fromhex(row["packet"]))
        state = read_state(plane.socket.recv(65536))
        for name, wanted in row["state"].items():
            assert state[name] == pytest.approx(wanted, rel=1e-3, abs=1e-3), (row["packet"][8:16], name)
    tally = serving.result()
    assert tally.repeats == 1 and tally.frames == len(rows) - 1
    assert rows[-1]["state"]["velocity"][0] > 5.0  # it was thrown
    plane.close()


# --- the real one -----------------------------------------------------------------------------------------


REAL = pytest.mark.skipif(
    "WINGBEAT_ARDUPLANE" not in os.environ, reason="WINGBEAT_ARDUPLANE names no ArduPlane built for SITL"
)
IN_THE_AIR = 30.0
"""m; TKOFF_ALT"""
TAKEOFF = 13
"""ArduPlane's custom mode"""
IN_THE_HAND_FOR_LONG = Scenario(duration=240.0, launch_time=math.inf, rest_time=1.0)
"""Its filter wants half a minute before it believes in a place."""


@contextmanager
def real_plane(stages: Stages, port: int, folder: Path, launch: Launch = Launch.THROTTLE) -> Iterator[Any]:
    """The binary on our world, and a ground station's connection to it; ended when left."""
    received = free_port(socket.SOCK_DGRAM)
    ground = mavutil.mavlink_connection(f"udpin:127.0.0.1:{received}", dialect="ardupilotmega")
    home = stages.scenario.home
    where = f"{math.degrees(home.latitude)},{math.degrees(home.longitude)},{home.altitude},0"
    settings = folder / "settings.parm"
    assert main(["sim", "--ardupilot", "--launch", launch.value, "--write-parameters", str(settings)]) == 0
    settings.write_text(f"{settings.read_text()}TKOFF_ALT {IN_THE_AIR:g}\n")
    words = [
        os.environ["WINGBEAT_ARDUPLANE"], "--model", "JSON:127.0.0.1", "--home", where, "--wipe", "--speedup", "5",
        "--sim-port-out", str(port), "--serial0", f"udpclient:127.0.0.1:{received}",
        "--defaults", str(settings),
    ]  # fmt: skip
    plane = subprocess.Popen(words, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield ground
    finally:
        plane.kill()
        plane.wait()
        ground.close()


@REAL
def test_a_real_arduplane_reads_the_attitude_in_the_hand(tmp_path: Path) -> None:
    """Its own attitude and place are the truth's: every field it needs was found, in the units it takes."""
    stages = Stages()
    serving, _ = served(stages, Timeouts(stall=1.0, connect=20.0))
    with real_plane(stages, serving.server.port, tmp_path) as ground:
        attitude = settled_attitude(ground)
        position = ground.recv_match(type="GLOBAL_POSITION_INT", blocking=True, timeout=60.0)
    tally = serving.result()
    assert tally.malformed == 0 and tally.frames > 400
    pitch = stages.worlds[0].vehicle.launch.pitch
    assert (attitude.roll, attitude.pitch) == pytest.approx((0.0, pitch), abs=0.05)
    home = stages.scenario.home
    assert abs(position.lat * 1e-7 - math.degrees(home.latitude)) * METRES_PER_DEGREE < 20.0


@REAL
@pytest.mark.parametrize("launch", list(Launch))
def test_a_real_arduplane_takes_off_is_thrown_and_climbs(launch: Launch, tmp_path: Path) -> None:
    """GIVEN it in the hand WHEN it arms in mode TAKEOFF THEN it is thrown, for its throttle or for its detection of
    the launch, and climbs as it says."""
    stages = Stages(IN_THE_HAND_FOR_LONG)
    serving, told = served(stages, Timeouts(stall=1.0, connect=20.0), RIG._replace(launch=launch))
    with real_plane(stages, serving.server.port, tmp_path, launch) as ground:
        settled_attitude(ground)
        settled_place(ground)
        take_off(ground)
        climbed_to(ground, 8.0)
        at_the_end = -stages.logs[0].messages[truth_topics.STATE.name][-1].down
    tally = serving.result()
    assert (tally.malformed, tally.flights) == (0, 1)
    assert sum("launched, throttle" in line for line in told) == 1
    truths = stages.logs[0].messages[truth_topics.STATE.name]
    assert at_the_end > 6.0 and max(-truth.down for truth in truths) < 2.0 * IN_THE_AIR
    assert all(math.isfinite(truth.down) for truth in truths)


def settled_place(ground: Any) -> None:
    """Wait until its filter believes in a place on the earth; two minutes of its time at 4 Hz."""
    wanted = mavutil.mavlink.EKF_POS_HORIZ_ABS
    for _ in range(480):
        report = ground.recv_match(type="EKF_STATUS_REPORT", blocking=True, timeout=60.0)
        assert report is not None, "ArduPlane said nothing of its filter for 60 s"
        if report.flags & wanted:
            return
    raise AssertionError("ArduPlane's filter has no place after two minutes of its time")


def take_off(ground: Any) -> None:
    """Mode TAKEOFF and armed, asked for once with each heartbeat of it, which is once a second of its time."""
    refusals: list[str] = []
    for _ in range(60):
        message = ground.recv_match(type=["HEARTBEAT", "STATUSTEXT"], blocking=True, timeout=60.0)
        assert message is not None, "ArduPlane said nothing for 60 s"
        if message.get_type() == "STATUSTEXT":
            refusals.append(message.text)
        elif message.custom_mode != TAKEOFF:
            ground.mav.command_long_send(1, 1, 176, 0, 1, TAKEOFF, 0, 0, 0, 0, 0)
        elif not message.base_mode & mavutil.mavlink.MAV_MODE_FLAG_SAFETY_ARMED:
            ground.mav.command_long_send(1, 1, 400, 0, 1, 21196, 0, 0, 0, 0, 0)
        else:
            return
    raise AssertionError(f"ArduPlane neither armed nor took off: {refusals}")


def climbed_to(ground: Any, height: float) -> None:
    """Wait until it says that it is ``height`` m above home and climbs; 100 s of its time at 4 Hz."""
    observed: list[float] = []
    for _ in range(400):
        message = ground.recv_match(type="GLOBAL_POSITION_INT", blocking=True, timeout=60.0)
        assert message is not None, f"ArduPlane said nothing of its place for 60 s; last heights {observed[-5:]}"
        observed.append(message.relative_alt * 1e-3)
        if observed[-1] > height and message.vz < 0:
            return
    raise AssertionError(f"ArduPlane did not climb to {height} m; last heights {observed[-20:]}")


def settled_attitude(ground: Any) -> Any:
    """ATTITUDE, asked for and waited for until the filter has converged: 15 s of the vehicle's own time."""
    while True:
        message = ground.recv_match(type=["HEARTBEAT", "ATTITUDE"], blocking=True, timeout=60.0)
        assert message is not None, "ArduPlane said nothing for 60 s"
        if message.get_type() == "HEARTBEAT":
            ground.mav.request_data_stream_send(message.get_srcSystem(), 1, 0, 4, 1)
        elif message.time_boot_ms > 15_000:
            return message
