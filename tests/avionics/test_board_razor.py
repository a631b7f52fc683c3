"""The Razor as a board: its protocol over a bad line, its axes and units, restarts, the plug pulled."""

from __future__ import annotations

import math
import os
import random
import struct
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from fake_razor import STEP, FakeRazor, Motion, level

from avionics import topics
from avionics.autopilot import Autopilot
from avionics.board.board import BoardSilent, Surroundings
from avionics.board.boards import check_address
from avionics.board.razor import WITH_SENSORS, FrameClock, RazorBoard, RazorUrl, Timeouts, parse_address
from avionics.board.razor_protocol import OUTPUTS, Reader, start_request
from avionics.messages import SensorFrame
from avionics.missions import load_mission
from avionics.vehicles import load_vehicle
from wingbeat.errors import InputError
from wingbeat.topic import Topic

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")

QUICK = Timeouts(look=0.002)


def leaning(time: float) -> Motion:
    return Motion(0.3, -0.2, 0.0, (0.1, -0.2, 0.3))


class Bench:
    """A fake Razor and the board that reads it, on the fake's clock; what the board says is kept."""

    def __init__(self, fake: FakeRazor, options: str = "", timeouts: Timeouts = QUICK, address: str = "") -> None:
        self.fake = fake
        self.reports: list[str] = []
        self.at: dict[int, Callable[[], None]] = {}
        """what happens at a turn of the fake's loop"""
        self.turn = 0
        around = Surroundings(lambda severity, text: self.reports.append(text), self._pump)
        self.board = RazorBoard((address or fake.address) + options, timeouts, lambda: self.fake.now, around)

    def _pump(self) -> None:
        self.turn += 1
        self.at.get(self.turn, lambda: None)()
        self.fake.pump()

    def read(self, count: int) -> list[SensorFrame]:
        frames = [self.board.read() for _ in range(count)]
        return [frame for frame in frames if frame is not None]


# --- the protocol ------------------------------------------------------------------------------------------


def binary_stream(frames: int, seed: int) -> tuple[list[bytes], bytes]:
    """Frames of nine floats, and the stream of them with a token after each."""
    rng = random.Random(seed)
    sent = [struct.pack("<9f", *(float(rng.randint(-300, 300)) for _ in range(9))) for _ in range(frames)]
    return sent, b"#SYNCH00\r\n" + b"".join(frame + b"#SYNCH%02d\r\n" % (n % 100) for n, frame in enumerate(sent))


def in_pieces(data: bytes, rng: random.Random) -> list[bytes]:
    pieces = []
    while data:
        size = rng.randint(1, 90)
        pieces.append(data[:size])
        data = data[size:]
    return pieces


@pytest.mark.parametrize("seed", range(5))
def test_however_a_clean_stream_is_cut_into_reads_every_frame_comes(seed: int) -> None:
    sent, stream = binary_stream(200, seed)
    reader = Reader(OUTPUTS["oscb"])
    got = [reading for piece in in_pieces(stream, random.Random(seed)) for reading in reader.feed(piece)]
    assert [round(reading.accel[0] / -9.80665 * 256.0) for reading in got if reading.accel] == [
        round(struct.unpack("<f", frame[:4])[0]) for frame in sent
    ]
    assert reader.count._replace(tokens=0) == (200, 0, 0, 0, 0)


@pytest.mark.parametrize("seed", range(8))
def test_a_lost_byte_never_becomes_a_wrong_frame_and_costs_few(seed: int) -> None:
    """GIVEN a binary stream that loses one byte in 300 WHEN it is read THEN what comes is what was sent, in order."""
    rng = random.Random(seed)
    sent, stream = binary_stream(1000, seed)
    reader, whole = Reader(OUTPUTS["oscb"]), Reader(OUTPUTS["oscb"])
    thinned = bytes(byte for byte in stream if rng.random() > 1 / 300)
    got = [reading for piece in in_pieces(thinned, rng) for reading in reader.feed(piece)]
    left = iter(whole.feed(stream))
    assert all(any(reading == true for true in left) for reading in got), (
        "a frame that was never sent, or out of turn"
    )
    assert 650 < len(got) < 900 and reader.count.lost > 100
    assert len(sent) == 1000


def test_noise_restarts_and_values_that_no_sensor_gives_are_dropped() -> None:
    reader = Reader(OUTPUTS["oscb"])
    assert reader.feed(b"rubbish #YPR=1.00,2.00,3.00\r\n#SYN") == []
    assert reader.feed(b"CH01\r\n" + struct.pack("<9f", *[1.0] * 8, math.nan) + b"#SYNCH02\r\n") == []
    assert reader.feed(struct.pack("<9f", *[1.0] * 8, 1e30) + b"#SYNCH03\r\n") == []
    assert reader.feed(b"#YPR=1.00,2.00,3.00\r\n" + b"#SYNCH04\r\n") == []
    assert (reader.count.frames, reader.count.lost, reader.count.strange) == (0, 3, 1)


def test_lines_of_text_out_of_turn_cut_or_of_another_output_make_no_frame() -> None:
    a, m, g = b"#A-C=1.00,2.00,256.00\r\n", b"#M-C=50.00,0.00,86.00\r\n", b"#G-C=0.00,-1.00,2.00\r\n"
    reader = Reader(OUTPUTS["osct"])
    assert reader.feed(a + m + g + b"#SYNCH00\r\n") == []
    assert len(reader.feed(a + m + g)) == 1
    assert reader.feed(a + g + m + g) == []
    assert reader.feed(a + b"#M-C=50.0") == []
    assert len(reader.feed(b"0\r\n" + g + a + m + g)) == 1  # the cut line broke the first of the two
    assert reader.feed(b"#YPR=1.00,2.00,3.00\r\n") == [] and reader.count.strange == 1
    assert len(reader.feed(a + m + g)) == 1
    assert reader.feed(b"x" * 10_000) == [] and reader.count.lost >= 3


def test_the_razors_own_angles_in_text_and_binary() -> None:
    text, binary = Reader(OUTPUTS["ot"]), Reader(OUTPUTS["ob"])
    (observed,) = text.feed(b"#SYNCH00\r\n#YPR=-142.28,-5.38,33.52\r\n")
    (also,) = binary.feed(b"#SYNCH00\r\n" + struct.pack("<3f", -142.28, -5.38, 33.52) + b"#SYNCH01\r\n")
    for reading in (observed, also):
        assert reading.accel is None and reading.angles is not None
        assert [math.degrees(angle) for angle in reading.angles] == pytest.approx([33.52, -5.38, -142.28])


def test_a_request_stops_chooses_starts_and_asks_for_a_token() -> None:
    assert start_request(OUTPUTS["oscb"], 7) == b"#o0#oscb#o1#s07"


# --- the board ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("output", WITH_SENSORS)
def test_every_output_in_our_units_and_axes(output: str) -> None:
    """GIVEN a Razor right wing down by 0.3 and nose down by 0.2 rad WHEN it streams THEN the sample is physics."""
    bench = Bench(FakeRazor(leaning), f",57600,{output}")
    imu = bench.read(30)[-1].imu
    g = 9.80665
    force = (-g * math.sin(0.2), -g * math.cos(0.2) * math.sin(0.3), -g * math.cos(0.2) * math.cos(0.3))
    assert imu[1:4] == pytest.approx(force, abs=2.1 * g / 256.0)
    assert imu[4:7] == pytest.approx((0.1, -0.2, 0.3), abs=0.006)
    if output == "ox":
        assert imu[7:10] == (0.0, 0.0, 0.0)
        assert bench.board.angles == pytest.approx((0.3, -0.2, 0.0), abs=1e-3)
    else:
        assert math.hypot(*imu[7:10]) == pytest.approx(0.5, abs=0.02)
        assert math.atan2(imu.mag_z, math.hypot(imu.mag_x, imu.mag_y)) > 0.5  # the field dips down in the north
        assert bench.board.angles is None
    assert bench.reports == []


def test_frames_are_20_ms_apart_on_the_sensors_clock() -> None:
    bench = Bench(FakeRazor())
    times = [frame.time_us for frame in bench.read(200)]
    assert all(after > before for before, after in pairwise(times))
    assert (times[-1] - times[0]) * 1e-6 == pytest.approx(199 * STEP, abs=2.5 * STEP)
    assert bench.board.step == pytest.approx(STEP, rel=0.02)
    assert all(15_000 < after - before < 25_000 for before, after in pairwise(times[50:]))


def test_lost_bytes_cost_their_frames_and_it_goes_on() -> None:
    fake = FakeRazor(leaning)
    fake.loss = 0.002
    bench = Bench(fake)
    frames = bench.read(400)
    assert all(abs(frame.imu.gyro_z - 0.3) < 0.01 for frame in frames)
    assert 0 < bench.board.losses.lost < 250
    # The time of lost frames passes too.
    assert frames[-1].time_us * 1e-6 == pytest.approx(fake.now, abs=0.3)
    assert any("lost" in text and "Razor at" in text for text in bench.reports)


@pytest.mark.parametrize(("output", "booting"), [("oscb", 0), ("oscb", 60), ("osct", 0), ("osrt", 60), ("ox", 0)])
def test_a_razor_that_restarts_in_the_middle_is_asked_again(output: str, booting: int) -> None:
    fake = FakeRazor(leaning)
    bench = Bench(fake, f",57600,{output}")
    bench.at[40] = lambda: fake.restart(booting)
    before, after = bench.read(30), bench.read(60)
    assert before[-1].imu.accel_z == pytest.approx(after[-1].imu.accel_z, abs=0.1)
    assert fake.requests.count(OUTPUTS[output].command) >= 2
    assert bench.board.restarts == (1 if booting == 0 else 0)
    assert bench.reports[0].endswith("restarted" if booting == 0 else ": no sensor frame for 1 s")


def test_a_boot_loader_that_eats_the_first_request_is_asked_again() -> None:
    fake = FakeRazor()
    fake.restart(80)
    assert len(Bench(fake).read(5)) == 5


def test_a_deaf_razor_an_old_firmware_and_a_silent_line_are_told_apart() -> None:
    deaf = FakeRazor()
    deaf.deaf = True
    with pytest.raises(BoardSilent, match="no response to #s: check its receive line"):
        Bench(deaf).read(1)
    with pytest.raises(BoardSilent, match="it responds, but does not support this output"):
        Bench(FakeRazor(knows_ox=False), ",57600,ox").read(1)
    mute = FakeRazor()
    mute.restart(10_000)
    with pytest.raises(BoardSilent, match="sent no frame for 6 s: no data received"):
        Bench(mute).read(1)


def test_a_pulled_plug_is_one_line_at_once() -> None:
    bench = Bench(FakeRazor())
    bench.read(5)
    bench.fake.line.close()
    with pytest.raises(BoardSilent, match=rf"^Razor at {bench.fake.line.device} disconnected: check the cable$"):
        bench.read(50)
    bench.board.close()


def test_plugged_in_again_it_goes_on(tmp_path: Path) -> None:
    """GIVEN patience with the plug WHEN it is pulled and put back elsewhere under the same name THEN it goes on."""
    device = tmp_path / "razor"
    first, second = FakeRazor(leaning), FakeRazor(leaning, seed=2)
    device.symlink_to(first.line.device)
    bench = Bench(first, address=f"razor:{device}", timeouts=QUICK._replace(loss=20.0))
    earlier = bench.read(20)

    def put_back() -> None:
        device.unlink()
        device.symlink_to(second.line.device)
        second.now = bench.fake.now
        bench.fake = second

    bench.at[30], bench.at[80] = first.line.close, put_back
    later = bench.read(40)
    assert later[-1].time_us - earlier[-1].time_us >= 40 * 20_000
    assert later[-1].imu.gyro_z == pytest.approx(0.3, abs=0.01)
    assert bench.reports[:2] == [
        f"Razor at {device} {what}" for what in ("disconnected: check the cable", "reconnected")
    ]


def test_the_flight_computers_attitude_with_an_imu_alone_and_no_alarms() -> None:
    """GIVEN a Razor turned by hand WHEN its IMU is all there is THEN the attitude is the Razor's."""

    def turned(time: float) -> Motion:
        roll = 0.5 * math.sin(time)
        return Motion(roll, 0.0, 0.0, (0.5 * math.cos(time), 0.0, 0.0))

    bench = Bench(FakeRazor(turned))
    reports: list[Any] = []

    def publish(topic: Topic, message: Any) -> None:
        if topic in (topics.EVENTS, topics.LINK_EVENTS):
            reports.append(message)

    pilot = Autopilot(load_vehicle("robo_raven_ii_d"), load_mission("circuit"), publish)
    errors = []
    for _ in range(1500):
        pilot.step(bench.read(1)[0])
        errors.append(pilot.memory.attitude.roll - turned(bench.fake.now).roll)
    assert max(abs(error) for error in errors[500:]) < math.radians(2.5)
    assert abs(pilot.memory.attitude.pitch) < math.radians(1.0)
    assert reports == []


# --- its clock ---------------------------------------------------------------------------------------------


def test_the_clock_smooths_arrivals_and_follows_a_slow_crystal() -> None:
    rng = random.Random(4)
    clock = FrameClock()
    times = [clock.time_us(100.0 + 0.0202 * n + rng.uniform(0.0, 0.016)) * 1e-6 for n in range(3000)]
    steps = [after - before for before, after in pairwise(times[1000:])]
    assert sum(steps) / len(steps) == pytest.approx(0.0202, rel=2e-3)
    assert max(steps) < 0.0225 and min(steps) > 0.018


def test_the_clock_leaps_over_frames_that_are_missing() -> None:
    clock = FrameClock()
    for n in range(100):
        clock.time_us(0.02 * n)
    assert clock.time_us(0.02 * 102, skipped=2) - 100 * 20_000 == pytest.approx(3 * 20_000, abs=100)
    assert clock.time_us(10.0) == pytest.approx(10.02e6, abs=1000)


# --- addresses ---------------------------------------------------------------------------------------------


def test_addresses() -> None:
    assert parse_address("razor:/dev/ttyUSB0") == RazorUrl("/dev/ttyUSB0", 57600, "oscb")
    assert parse_address("razor:COM3,115200") == RazorUrl("COM3", 115200, "oscb")
    assert parse_address("razor:/dev/ttyUSB0,57600,ox") == RazorUrl("/dev/ttyUSB0", 57600, "ox")


@pytest.mark.parametrize(
    ("address", "part"),
    [
        ("razor:", "is not razor:DEVICE"),
        ("razor:x,fast", "baud rate must be a number"),
        ("razor:x,0", "baud rate must be a number"),
        ("razor:x,57600,ob", "output must be one of oscb, osct, osrb, osrt, ox"),
        ("razor:x,57600,oscb,1", "is not razor:DEVICE"),
        ("serial:x,57600", "is not one of hil:tcp:HOST:PORT"),
        ("hil:udpin:0.0.0.0:1", "is not one of hil:tcp:HOST:PORT"),
        ("hil:serial:x", "serial:DEVICE,BAUD"),
        ("", "is not one of hil:tcp:HOST:PORT"),
    ],
)
def test_a_bad_address_is_one_line(address: str, part: str) -> None:
    with pytest.raises(InputError, match=part) as refused:
        check_address(address)
    assert "\n" not in str(refused.value)


def test_a_device_that_is_missing_or_in_use_is_bad_input() -> None:
    with pytest.raises(
        InputError, match=r"cannot open serial device /dev/no-such-device at 57600 baud: No such file"
    ):
        RazorBoard("razor:/dev/no-such-device")
    bench = Bench(FakeRazor(level))
    with pytest.raises(InputError, match="another program has it"):
        RazorBoard(bench.fake.address)
    bench.board.close()
