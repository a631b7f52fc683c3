"""The bridge's codec: what goes in comes out, within the quantisation of the wire."""

from __future__ import annotations

import importlib.util
import math
import random
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega, common, development

from avionics import messages as m
from avionics.link import codec, dialect, sensor_codec
from avionics.link.dialect import mavlink
from avionics.link.framing import FrameReader, checksum, sole_payload
from avionics.link.tick_codec import decode_tick
from avionics.sensors import IMU, OTHERS
from wingbeat.samples import RangeSample

times = st.integers(0, 2**63)
singles = st.floats(-1e6, 1e6, width=32)
counts = st.integers(-(2**31), 2**31 - 1)
passages = st.integers(0, 2**32 - 1)
adc = st.lists(st.integers(0, 65535), min_size=m.BURST_LENGTH, max_size=m.BURST_LENGTH).map(tuple)
imus = st.builds(m.ImuSample, times, *[singles] * 9)
angles = st.floats(-math.pi / 2, math.pi / 2)
fixes = st.builds(
    m.GpsFix,
    times,
    st.floats(-math.pi / 2, math.pi / 2),
    st.floats(-math.pi, math.pi),
    st.floats(-500, 9000),
    *[st.floats(-300, 300)] * 3,
    *[st.floats(0, 600)] * 2,
    st.integers(0, 6),
    st.integers(0, 60),
)
commands = st.builds(m.ActuatorCommand, times, angles, angles, st.floats(0, 1), angles, angles, st.integers(0, 1))
pulses = st.tuples(*[st.integers(0, 65535)] * m.CHANNELS)
frames = st.builds(
    m.SensorFrame,
    st.just(0),
    imus,
    st.none() | st.builds(m.EncoderSample, times, *[counts] * 4, passages, passages),
    st.none() | st.builds(m.PressureSample, times, counts, counts, counts),
    st.none() | st.builds(m.AdcBurst, times, adc, adc),
    st.none() | st.builds(m.TorqueSample, times, counts, counts),
    st.none() | fixes,
    st.none() | st.builds(m.ReceiverSample, times, pulses, st.integers(0, 1), st.integers(0, 255)),
    st.none() | st.builds(RangeSample, st.integers(0, 2**32 - 1), *[st.floats(0, 200)] * 3, st.integers(0, 100)),
).map(lambda frame: frame._replace(time_us=frame.imu.time_us))


@given(frames)
def test_a_sensor_frame_arrives_as_its_quantised_self(frame: m.SensorFrame) -> None:
    reader, assembler = FrameReader(version_1=False), codec.FrameAssembler()
    arrived = [assembler.add(each) for each in reader.feed(codec.FrameWriter(1, 200).sensors(frame))]
    assert arrived[-1] == sensor_codec.quantized(frame)
    assert arrived[:-1] == [None] * (len(arrived) - 1)
    assert reader.bad_bytes == 0


@given(frames)
def test_quantising_twice_is_quantising_once(frame: m.SensorFrame) -> None:
    once = sensor_codec.quantized(frame)
    assert sensor_codec.quantized(once) == once


@given(commands)
def test_a_command_arrives_within_float32(command: m.ActuatorCommand) -> None:
    reply = codec.decode_actuators(codec.encode_actuators(command))
    assert reply is not None and reply.lockstep
    assert reply.command == codec.quantized_command(command)
    assert (reply.command.time_us, reply.command.armed) == (command.time_us, command.armed)
    for sent, got in zip(command[1:6], reply.command[1:6], strict=True):
        assert got == pytest.approx(sent, abs=1e-7)


def test_a_command_beyond_the_servos_travel_is_limited_and_a_nan_is_refused() -> None:
    wild = m.ActuatorCommand(1, 9.0, -9.0, 7.0, 0.0, 0.0, 1)
    assert codec.quantized_command(wild)[1:4] == (codec.FULL_DEFLECTION, -codec.FULL_DEFLECTION, 1.0)
    assert codec.decode_actuators(codec.encode_actuators(wild._replace(elevator=math.nan))) is None


@given(fixes)
def test_a_gps_fix_keeps_a_centimetre(fix: m.GpsFix) -> None:
    got = sensor_codec.CODECS["gps"].decode(sensor_codec.CODECS["gps"].encode(fix))
    assert got.latitude == pytest.approx(fix.latitude, abs=1e-9)
    assert got.longitude == pytest.approx(fix.longitude, abs=1e-9)
    assert got.altitude == pytest.approx(fix.altitude, abs=5.1e-4)
    for name in ("v_north", "v_east", "v_down", "horizontal_accuracy", "vertical_accuracy"):
        assert getattr(got, name) == pytest.approx(getattr(fix, name), abs=5.1e-3)
    assert (got.fix_type, got.satellites) == (fix.fix_type, fix.satellites)


def test_a_stock_decoder_reads_our_hil_sensor_and_actuators_in_the_standards_units() -> None:
    writer = codec.FrameWriter(1, 200)
    imu = m.ImuSample(5000, 1.0, 2.0, -9.81, 0.1, 0.2, 0.3, 0.2, 0.0, 0.4)
    stock = common.MAVLink(None)
    sensor = stock.parse_buffer(writer.sensors(m.SensorFrame(5000, imu)))[0]
    assert (sensor.get_type(), sensor.time_usec, sensor.id) == ("HIL_SENSOR", 5000, 0)
    assert sensor.fields_updated == 0x7 | 0x38 | 0x1C0
    assert (sensor.xacc, sensor.zgyro, sensor.zmag) == pytest.approx((1.0, 0.3, 0.4))
    sent = m.ActuatorCommand(5000, math.pi / 4, -math.pi / 4, 0.5, math.pi / 8, 0.0, 1)
    actuators = stock.parse_buffer(writer.actuators(sent))[0]
    assert actuators.controls[:6] == pytest.approx([0.5, -0.5, 0.25, 0.0, 0.5, 0.0])
    assert actuators.mode & 128 and actuators.flags == 1 and actuators.time_usec == 5000


def test_every_standard_message_has_the_standards_id_length_and_crc_extra() -> None:
    ours = {number: kind for number, kind in mavlink.mavlink_map.items() if not 53000 <= number <= 53099}
    assert len(ours) > 60
    for number, kind in ours.items():
        # Not in pymavlink's definitions: PROTOCOL_VERSION and component metadata; their CRC_EXTRA is published.
        published = {300: 217, 395: 0, 396: 50, 397: 182}
        if number in published:
            assert kind.crc_extra == published[number]
            continue
        stock = development.mavlink_map.get(number) or ardupilotmega.mavlink_map[number]
        assert (kind.msgname, kind.crc_extra, kind.unpacker.size) == (
            stock.msgname,
            stock.crc_extra,
            stock.unpacker.size,
        )


def test_the_private_ids_are_within_their_range_and_each_payload_fits_a_frame() -> None:
    private = {number for number, kind in mavlink.mavlink_map.items() if kind.msgname.startswith("WINGBEAT")}
    assert private and all(53000 <= number <= 53099 for number in private)
    assert mavlink.mavlink_map[sensor_codec.CODECS["adc"].message_id].unpacker.size == 8 + 240
    assert all(kind.unpacker.size <= 255 for kind in mavlink.mavlink_map.values())


def test_frames_are_found_between_noise_at_any_split() -> None:
    generator = random.Random(4)
    writer = codec.FrameWriter(1, 1)
    sent = [m.ActuatorCommand(number, 0.1, 0.2, 0.3, 0.0, 0.0, 1) for number in range(300)]
    data = b""
    for command in sent:
        data += generator.choice((b"", b"\xfd", b"\xfd\x20", b"noise", generator.randbytes(30)))
        data += writer.actuators(command)
    reader = FrameReader(version_1=False)
    found = []
    while data:
        size = generator.randint(1, 200)
        found += reader.feed(data[:size])
        data = data[size:]
    found += reader.give_up()
    times = [reply.command.time_us for frame in found if (reply := codec.decode_actuators(frame.payload))]
    assert times == [command.time_us for command in sent]
    assert reader.bad_bytes > 0


def test_a_damaged_frame_costs_itself_alone() -> None:
    writer = codec.FrameWriter(1, 1)
    good = [writer.actuators(m.ActuatorCommand(number, 0.1, 0.2, 0.3, 0.0, 0.0, 1)) for number in (1, 2)]
    torn = bytearray(good[0])
    torn[20] ^= 0x40
    reader = FrameReader()
    frames = reader.feed(bytes(torn) + good[1]) + reader.give_up()
    assert [frame.raw for frame in frames] == [good[1]]
    assert reader.bad_bytes == len(torn)


def test_a_foreign_message_is_passed_over_and_counted() -> None:
    foreign = common.MAVLink(None, 255, 190)
    text = common.MAVLink_landing_target_message(0, 0, 0, 1.0, 2.0, 3.0, 0.1, 0.1).pack(foreign)
    ours = codec.FrameWriter(1, 1).actuators(m.ActuatorCommand(1, 0.0, 0.0, 0.0, 0.0, 0.0, 0))
    reader = FrameReader()
    assert [frame.message_id for frame in reader.feed(text + ours)] == [codec.HIL_ACTUATOR_CONTROLS]
    assert (reader.unknown, reader.bad_bytes) == (1, 0)


def test_a_mavlink_1_frame_is_read() -> None:
    old = common.MAVLink(None, 255, 190)
    data = common.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(old, force_mavlink1=True)
    frames = FrameReader().feed(data)
    assert [(frame.message_id, frame.system) for frame in frames] == [(0, 255)]


def test_a_hundred_thousand_frames_of_garbage_raise_nothing() -> None:
    generator = random.Random(9)
    template = codec.FrameWriter(1, 1).actuators(m.ActuatorCommand(1, 0.3, 0.2, 0.1, 0.0, 0.0, 1))
    reader = FrameReader()
    for _ in range(1000):
        damaged = bytearray(template * 100)
        for place in generator.sample(range(len(damaged)), 100):
            damaged[place] = generator.randrange(256)
        reader.feed(bytes(damaged))
    reader.give_up()
    assert reader.frames > 10_000 and reader.bad_bytes > 10_000


@given(st.binary(max_size=600), st.integers(1, 60))
def test_any_bytes_in_any_pieces_raise_nothing(data: bytes, size: int) -> None:
    reader = FrameReader()
    for start in range(0, len(data), size):
        reader.feed(data[start : start + size])
    reader.give_up()
    assert reader.feed(codec.FrameWriter(1, 1).frame(0, b"\x01")) != []


@given(frames)
def test_tick_at_once_equals_tick_by_frames(frame: m.SensorFrame) -> None:
    """GIVEN the bytes of one tick WHEN they are decoded at once THEN the frame is that of the frame parser; a part of
    them, or more, is left to it."""
    writer = codec.FrameWriter(1, 200)
    data = writer.sensors(frame)
    tick = decode_tick(data)
    assert tick is not None and tick.frame == sensor_codec.quantized(frame)
    assert tick.messages == len(FrameReader(version_1=False).feed(data))
    corrupted = data[:-1] + bytes([data[-1] ^ 1])
    assert all(decode_tick(other) is None for other in (data[:-1], data + data[:1], data + data, corrupted, b""))


@given(frames)
def test_tick_bytes_are_those_of_single_messages(frame: m.SensorFrame) -> None:
    """GIVEN a tick WHEN it is encoded into one buffer THEN the bytes are those of its messages one by one."""
    together, alone = codec.FrameWriter(1, 200), codec.FrameWriter(1, 200)
    for _ in range(2):
        parts = ((sensor_codec.CODECS[each.field], getattr(frame, each.field)) for each in (*OTHERS, IMU))
        one_by_one = [alone.frame(row.message_id, row.encode(sample)) for row, sample in parts if sample is not None]
        assert together.sensors(frame) == b"".join(one_by_one)


@given(commands)
def test_answer_alone_equals_answer_by_frames(command: m.ActuatorCommand) -> None:
    data = codec.FrameWriter(1, 1).actuators(command)
    (frame,) = FrameReader(version_1=False).feed(data)
    assert sole_payload(data, codec.HIL_ACTUATOR_CONTROLS) == frame.payload
    others = (data[:-1], data + b"\0", data[:-1] + bytes([data[-1] ^ 1]), b"")
    assert all(sole_payload(other, codec.HIL_ACTUATOR_CONTROLS) is None for other in others)
    assert sole_payload(data, codec.HEARTBEAT) is None


def test_checksum_without_the_c_function(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a module that a pymavlink before 2.4.48 generated, without ``mcrf4xx``, THEN the checksum is the same."""
    specification = importlib.util.find_spec("avionics.link.framing")
    assert specification is not None and specification.loader is not None
    monkeypatch.setattr(dialect, "mavlink", SimpleNamespace(**{**vars(mavlink), "mcrf4xx": None}))
    del dialect.mavlink.mcrf4xx
    old = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(old)
    assert old.checksum(b"123456789") == checksum(b"123456789") == 0x6F91
