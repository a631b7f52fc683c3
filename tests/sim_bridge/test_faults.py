"""Faults by name: how they are written, and what the sensors then read."""

import math

import numpy as np
import pytest

from sim_bridge.bridge.world import SimulationSilent
from sim_bridge.flight import faults
from sim_bridge.flight.faults import Fault, FaultInjector, mission_faults, parse_fault
from wingbeat.errors import InputError
from wingbeat.samples import EncoderSample, ImuSample, PressureSample, ReceiverSample, SensorFrame


def frame(tick: int) -> SensorFrame:
    """A frame whose every value tells its tick; as a 32-bit float exactly, where a sensor's is one."""
    time_us = 5_000 * (tick + 1)
    imu = ImuSample(time_us, *(tick + 0.125 * i for i in range(9)))
    pressures = PressureSample(time_us, 10_000_000 + tick, 8192 + tick, 29_000) if tick % 4 == 0 else None
    receiver = ReceiverSample(time_us, (1500, 1000 + tick), 0, 200) if tick % 4 == 0 else None
    return SensorFrame(time_us, imu, EncoderSample(time_us, tick, -tick), pressures, receiver=receiver)


def sensed(*some: Fault, ticks: int = 40) -> list[SensorFrame]:
    injector = FaultInjector(some)
    read = []
    for tick in range(ticks):
        injector.act(None, tick, 0.005 * (tick + 1))  # type: ignore[arg-type]
        read.append(injector.sense(frame(tick), tick))
    return read


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("gps_lost@12.5", Fault("gps_lost", 12.5)),
        ("mag_disturbed@3-4.5", Fault("mag_disturbed", 3.0, 4.5)),
    ],
)
def test_a_fault_is_read(text: str, fault: Fault) -> None:
    assert parse_fault(text) == fault


@pytest.mark.parametrize("name", ["mag_disturbed", "imu_saturated", "gyro_saturated", "imu_frozen", "time_backwards"])
def test_what_a_fault_makes_of_the_imu_can_be_carried_over_mavlink(name: str) -> None:
    """As 32-bit floats, a healthy sample's too: else a flight over MAVLink is not the one in one process."""
    read = sensed(Fault(name, 0.1))
    assert read[30].imu != frame(30).imu
    assert all(value == float(np.float32(value)) for one in read for value in one.imu[1:])


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("gps_lost", "NAME@T"),
        ("gps@3", "known: gps_lost, pitot_blocked"),
        ("gps_lost@soon", "is not a time in seconds"),
        ("gps_lost@5-3", "the end must be after the start"),
        ("gps_lost@5-nan", "the end must be after the start"),
        ("gps_lost@nan", "must be 0 s or more since boot, not nan"),
        ("gps_lost@inf", "must be 0 s or more since boot, not inf"),
        ("gps_lost@-1", "must be 0 s or more since boot, not -1"),
        ("gps_lost@-5-3", "must be 0 s or more since boot, not -5"),
        ("gps_lost@-", "is not a time in seconds"),
        ("gps_lost@-nan", "must be 0 s or more"),
        ("battery_low@3-5", "has no end: specify its start only"),
        ("sim_silent@3-5", "has no end: specify its start only"),
    ],
)
def test_what_cannot_fail_is_refused_in_one_line(text: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason) as refusal:
        parse_fault(text)
    assert "\n" not in str(refusal.value)


def test_a_mission_tells_its_faults(tmp_path) -> None:
    path = tmp_path / "m.toml"
    path.write_text('[[fault]]\nname = "gps_lost"\nat = 3\nuntil = 5.0\n[[fault]]\nname = "imu_frozen"\nat = 9\n')
    assert mission_faults(path) == (Fault("gps_lost", 3.0, 5.0), Fault("imu_frozen", 9.0))
    path.write_text('[[fault]]\nname = "gps_lost"\n')
    with pytest.raises(InputError, match="fault 1"):
        mission_faults(path)


def test_without_faults_nothing_changes() -> None:
    assert sensed() == [frame(tick) for tick in range(40)]


def test_a_fault_lasts_from_its_beginning_to_its_end() -> None:
    read = sensed(Fault("imu_frozen", 0.05, 0.10))
    changed = [tick for tick, one in enumerate(read) if one != frame(tick)]
    assert changed == [tick for tick in range(40) if 0.05 <= 0.005 * (tick + 1) < 0.10]
    assert {one.imu[1:] for tick, one in enumerate(read) if tick in changed} == {frame(changed[0] - 1).imu[1:]}


def test_a_blocked_pitot_reads_as_at_rest_and_the_barometer_goes_on() -> None:
    late = [one.pressures for one in sensed(Fault("pitot_blocked", 0.1))[20:] if one.pressures]
    first = frame(0).pressures
    assert first is not None
    assert {one.differential_counts for one in late} == {first.differential_counts}
    assert len({one.static_counts for one in late}) == len(late)


def test_a_dead_encoder_leaves_the_other_wing() -> None:
    late = [one.encoder for one in sensed(Fault("encoder_left_lost", 0.1))[25:]]
    assert len({one.left_counts for one in late}) == 1
    assert len({one.right_counts for one in late}) == len(late)


def test_the_clock_jumps_back_with_every_sample() -> None:
    read = sensed(Fault("time_backwards", 0.1))
    assert read[30].time_us == frame(30).time_us - faults.CLOCK_STEP_US
    for sample in (read[30].imu, read[30].encoder, read[28].pressures):
        assert sample is not None
        assert sample.time_us < 0


def test_a_saturated_accelerometer_leaves_rates_and_field() -> None:
    late = sensed(Fault("imu_saturated", 0.1))[30]
    assert all(abs(value) == float(np.float32(faults.FULL_SCALE)) for value in late.imu[1:4])
    assert late.imu[4:] == frame(30).imu[4:]


def test_a_saturated_gyro_leaves_force_and_field() -> None:
    late = sensed(Fault("gyro_saturated", 0.1))[30]
    assert all(abs(value) == float(np.float32(math.radians(2000.0))) for value in late.imu[4:7])
    assert (late.imu[1:4], late.imu[7:]) == (frame(30).imu[1:4], frame(30).imu[7:])


def test_a_transmitter_that_is_off_is_silence_and_then_its_last_frame_marked_as_lost() -> None:
    read = sensed(Fault("receiver_lost", 0.1), ticks=120)
    begin, told = 19, 19 + faults.RECEIVER_PATIENCE
    assert [one.receiver for one in read[:begin]] == [frame(tick).receiver for tick in range(begin)]
    assert {one.receiver for one in read[begin:told]} == {None}
    late = [one.receiver for one in read[told:] if one.receiver]
    held = frame(16).receiver
    assert held is not None
    assert len(late) == 10
    assert all((one.lost, one.rssi, one.pulses) == (1, 0, held.pulses) for one in late)
    assert len({one.time_us for one in late}) == len(late)


def test_a_silent_world_says_so() -> None:
    injector = FaultInjector([Fault("sim_silent", 0.1)])
    with pytest.raises(SimulationSilent, match=r"0\.1 s"):
        for tick in range(40):
            injector.act(None, tick, 0.005 * (tick + 1))  # type: ignore[arg-type]
