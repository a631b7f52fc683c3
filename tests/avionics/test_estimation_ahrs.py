"""The attitude filter under flapping, in turns, at the launch, with a disturbed field and with bad samples."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from avionics.estimation import ahrs
from avionics.messages import Attitude, ImuSample
from wingbeat.quaternions import dcm_from_quaternion

sys.path.insert(0, str(Path(__file__).parent))

from flapping_airframe import (
    FIELD_NED,
    ROBO_RAVEN,
    SLOW_HAWK,
    Airframe,
    Array,
    Motion,
    fly,
    inclination_error_deg,
    rotation_matrices,
)

GAINS = ahrs.AhrsGains()
STILL = 6.0
components = st.floats(-3.0, 3.0)
vectors = st.tuples(components, components, components)


def estimated(
    motion: Motion,
    airframe: Airframe,
    gains: ahrs.AhrsGains = GAINS,
    observed: float = 1.0,
    stationary: float = STILL,
) -> list[Attitude]:
    """Attitudes over a motion; the wing is measured from half a second after it started, times ``observed``."""
    state = ahrs.start(gains, motion.samples[0])
    attitudes = [ahrs.attitude(state)]
    noise = 0.2 * np.random.default_rng(7).standard_normal(len(motion.time))
    for k, imu in enumerate(motion.samples[1:], start=1):
        frequency = airframe.frequency * observed if motion.time[k] > stationary + 0.5 else 0.0
        airspeed = max(0.0, float(motion.airspeed[k] + noise[k]))
        state, attitude = ahrs.step(gains, state, imu, frequency, airspeed)
        attitudes.append(attitude)
    return attitudes


def inclination(motion: Motion, attitudes: list[Attitude]) -> Array:
    return inclination_error_deg(motion.euler, np.array([a[7:11] for a in attitudes]))


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def at_rest(seconds: float, field: tuple[float, float, float], rate: float = 200.0) -> list[ImuSample]:
    samples = range(round(seconds * rate))
    return [ImuSample(round(k * 1e6 / rate), 0.0, 0.0, -9.80665, 0.0, 0.0, 0.0, *field) for k in samples]


@pytest.mark.parametrize("airframe", [SLOW_HAWK, ROBO_RAVEN], ids=["slow_hawk", "robo_raven"])
@pytest.mark.parametrize("phase", [0.0, 0.5 * math.pi, math.pi])
def test_straight_flight_keeps_the_inclination(airframe: Airframe, phase: float) -> None:
    """GIVEN an airframe shaken by several g WHEN it flies straight THEN the tilt stays within a degree."""
    airframe = airframe._replace(phase=phase)
    motion = fly(airframe, 36.0, STILL)
    error = inclination(motion, estimated(motion, airframe))
    assert rms(error[motion.time > STILL + 3.0]) < 1.0


@pytest.mark.parametrize("airframe", [SLOW_HAWK, ROBO_RAVEN], ids=["slow_hawk", "robo_raven"])
@pytest.mark.parametrize("bank_deg", [-25.0, 25.0])
def test_turn_keeps_the_inclination(airframe: Airframe, bank_deg: float) -> None:
    """GIVEN a coordinated turn WHEN the pitot tells the airspeed THEN the tilt stays within 1.5 degrees."""
    airframe = airframe._replace(bank=math.radians(bank_deg))
    motion = fly(airframe, 36.0, STILL)
    error = inclination(motion, estimated(motion, airframe))
    assert rms(error[motion.time > STILL + 3.0]) < 1.5


def test_turn_without_pitot_is_what_the_airspeed_is_for() -> None:
    """GIVEN a turn WHEN no airspeed is known THEN the centripetal acceleration tilts the estimate by degrees."""
    airframe = SLOW_HAWK._replace(bank=math.radians(25.0))
    motion = fly(airframe, 36.0, STILL)
    blind = motion._replace(airspeed=np.full_like(motion.airspeed, -10.0))
    error = inclination(motion, estimated(blind, airframe))
    assert rms(error[motion.time > 20.0]) > 2.0


@pytest.mark.parametrize("observed", [0.9, 0.97, 1.03, 1.1])
def test_wrong_wing_period_is_forgiven(observed: float) -> None:
    """GIVEN a wing period that is 3 or 10 % off THEN the triangular weight still holds the tilt."""
    motion = fly(SLOW_HAWK, 30.0, STILL)
    error = inclination(motion, estimated(motion, SLOW_HAWK, observed=observed))
    assert rms(error[motion.time > STILL + 3.0]) < 1.5


def test_hand_launch_does_not_throw_the_attitude_off() -> None:
    """GIVEN a throw to 9 m/s within 0.4 s WHEN the wings start with it THEN the tilt stays within 3 degrees."""
    motion = fly(SLOW_HAWK, 12.0, STILL)
    error = inclination(motion, estimated(motion, SLOW_HAWK))
    launch = (motion.time > STILL - 0.1) & (motion.time < STILL + 4.0)
    assert error[launch].max() < 3.0


def test_hand_launch_without_pitot() -> None:
    """GIVEN the same throw WHEN the pitot is blocked THEN the limits keep the tilt within 10 degrees."""
    motion = fly(SLOW_HAWK, 12.0, STILL)
    blind = motion._replace(airspeed=np.full_like(motion.airspeed, -10.0))
    error = inclination(motion, estimated(blind, SLOW_HAWK))
    assert error[motion.time > STILL].max() < 10.0


def test_start_in_flight_recovers() -> None:
    """GIVEN a flight computer that boots in flight, upside down by its first sample THEN it finds up again."""
    motion = fly(SLOW_HAWK, 30.0)
    error = inclination(motion, estimated(motion, SLOW_HAWK, stationary=0.0))
    assert error[0] > 90.0
    assert error[motion.time > 15.0].max() < 5.0


def test_gyro_bias_is_learned_at_rest_and_kept_in_flight() -> None:
    motion = fly(SLOW_HAWK, 30.0, STILL)
    attitudes = estimated(motion, SLOW_HAWK)
    at_launch = attitudes[round((STILL - 0.5) * SLOW_HAWK.rate)]
    assert np.degrees(at_launch[11:14]) == pytest.approx([0.5, 0.5, 0.5], abs=0.1)
    assert np.degrees(attitudes[-1][11:14]) == pytest.approx([0.5, 0.5, 0.5], abs=0.1)


def test_gyro_bias_is_learned_while_flapping() -> None:
    """GIVEN a rest too noisy to be one WHEN the aircraft flies THEN the corrections teach the bias."""
    gains = GAINS._replace(rest_rate=0.0)
    motion = fly(SLOW_HAWK, 90.0, STILL)
    bias = np.degrees(estimated(motion, SLOW_HAWK, gains)[-1][11:14])
    assert bias == pytest.approx([0.5, 0.5, 0.5], abs=0.2)


def test_alignment_at_standstill_takes_the_gyro_offset() -> None:
    """GIVEN a gyro 20 deg/s off WHEN it is aligned THEN attitude and limit are right."""
    offset = math.radians(20.0)
    samples = [imu._replace(gyro_x=offset, gyro_z=-offset) for imu in at_rest(4.0, (0.2, 0.0, 0.42))]
    state = ahrs.align(GAINS, samples[0], 1.5)
    assert state.correction.window == 1.5
    for imu in samples[1:]:
        state, attitude = ahrs.step(GAINS, state, imu)
    assert (attitude.roll, attitude.pitch, attitude.yaw) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    assert attitude[11:14] == pytest.approx((offset, 0.0, -offset))
    assert ahrs.aligned(GAINS, state, (offset + 0.9 * GAINS.bias_limit, 0.0, -offset))
    assert not ahrs.aligned(GAINS, state, (0.0, 0.0, 0.0))


def test_bias_is_limited() -> None:
    motion = fly(SLOW_HAWK._replace(bias_deg=20.0), 20.0, STILL)
    attitudes = estimated(motion, SLOW_HAWK)
    assert max(abs(b) for a in attitudes for b in a[11:14]) <= GAINS.bias_limit


def test_heading_and_vertical_acceleration() -> None:
    airframe = SLOW_HAWK._replace(bank=0.3)
    motion = fly(airframe, 30.0, STILL)
    attitudes = estimated(motion, airframe)
    yaw = np.unwrap([a.yaw for a in attitudes])
    settled = motion.time > STILL + 3.0
    assert rms(np.degrees(yaw - motion.euler[:, 2])[settled]) < 1.5
    shaken = np.array([a.accel_down for a in attitudes]) - motion.accel_down
    assert abs(np.mean(shaken[settled])) < 0.1
    assert rms(shaken[settled]) < 0.5


def test_declination_turns_the_heading() -> None:
    stationary = at_rest(1.0, (0.2, 0.0, 0.42))
    state = ahrs.start(GAINS._replace(declination=0.1), stationary[0])
    assert ahrs.attitude(state).yaw == pytest.approx(0.1)
    for imu in stationary[1:]:
        state, attitude = ahrs.step(GAINS._replace(declination=0.1), state, imu)
    assert attitude.yaw == pytest.approx(0.1, abs=1e-6)


def test_disturbed_field_is_refused_and_a_lasting_one_believed() -> None:
    """GIVEN a magnet that doubles and turns the field THEN the heading holds, until the patience is at its end."""
    magnet = (0.0, 0.5, 0.8)
    gains = GAINS._replace(mag_timeout=30.0)
    state = ahrs.start(gains, at_rest(0.01, (0.2, 0.0, 0.42))[0])
    yaws = []
    for imu in at_rest(120.0, magnet, 50.0)[1:]:
        state, attitude = ahrs.step(gains, state, imu)
        yaws.append(attitude.yaw)
    assert yaws[29 * 50] == pytest.approx(0.0, abs=1e-6)
    assert yaws[-1] == pytest.approx(-0.5 * math.pi, abs=0.1)


def test_vertical_disturbance_moves_neither_heading_nor_tilt() -> None:
    state = ahrs.start(GAINS, at_rest(0.01, (0.2, 0.0, 0.42))[0])
    for imu in at_rest(20.0, (0.2, 0.0, 0.43))[1:]:
        state, attitude = ahrs.step(GAINS, state, imu)
    assert (attitude.roll, attitude.pitch, attitude.yaw) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_without_magnetometer_the_heading_is_the_gyro() -> None:
    state = ahrs.start(GAINS, at_rest(0.01, (0.0, 0.0, 0.0))[0])
    for imu in at_rest(4.0, (0.0, 0.0, 0.0))[1:]:
        state, attitude = ahrs.step(GAINS, state, imu._replace(gyro_z=0.3))
    assert attitude.yaw == pytest.approx(0.3 * 3.995, abs=1e-3)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize("field", ["accel_x", "gyro_y", "mag_z"])
def test_bad_sample_changes_nothing(bad: float, field: str) -> None:
    samples = at_rest(0.1, (0.2, 0.0, 0.42))
    state = ahrs.start(GAINS, samples[0])
    after, attitude = ahrs.step(GAINS, state, samples[1]._replace(**{field: bad}))
    assert after == state
    assert all(math.isfinite(value) for value in attitude)


def test_time_going_backwards_changes_nothing() -> None:
    samples = at_rest(0.1, (0.2, 0.0, 0.42))
    state, _ = ahrs.step(GAINS, ahrs.start(GAINS, samples[0]), samples[5])
    assert ahrs.step(GAINS, state, samples[2])[0] == state
    assert ahrs.step(GAINS, state, samples[5])[0] == state


def test_gap_in_the_samples_starts_a_new_block() -> None:
    samples = at_rest(2.0, (0.2, 0.0, 0.42))
    state = ahrs.start(GAINS, samples[0])
    for imu in samples[1:100]:
        state, _ = ahrs.step(GAINS, state, imu)
    state, _ = ahrs.step(GAINS, state, samples[300])
    assert state.block.span == pytest.approx(ahrs.LONGEST_STEP)


@pytest.mark.parametrize("force", [(0.0, 0.0, 0.0), (math.nan, 0.0, 0.0)])
def test_start_without_gravity_is_level(force: tuple[float, float, float]) -> None:
    imu = ImuSample(0, *force, 0.0, 0.0, 0.0, 0.2, 0.0, 0.4)
    attitude = ahrs.attitude(ahrs.start(GAINS, imu))
    assert (attitude.roll, attitude.pitch) == pytest.approx((0.0, 0.0))


def test_state_survives_json() -> None:
    motion = fly(ROBO_RAVEN, 1.0)
    state = ahrs.start(GAINS, motion.samples[0])
    for imu in motion.samples[1:]:
        state, _ = ahrs.step(GAINS, state, imu, 4.0, 6.0)
    plain = json.loads(json.dumps(state))
    assert plain == json.loads(json.dumps(plain))
    assert tuple(plain[1]) == state.r


@given(roll=st.floats(-3.1, 3.1), pitch=st.floats(-1.5, 1.5), yaw=st.floats(-3.1, 3.1))
def test_start_finds_any_attitude(roll: float, pitch: float, yaw: float) -> None:
    r = rotation_matrices(np.array([[roll, pitch, yaw]]))[0]
    force, field = r.T @ np.array([0.0, 0.0, -9.80665]), r.T @ FIELD_NED
    state = ahrs.start(GAINS, ImuSample(0, *force.tolist(), 0.0, 0.0, 0.0, *field.tolist()))
    assert np.array(state.r).reshape(3, 3) == pytest.approx(r, abs=1e-9)
    attitude = ahrs.attitude(state)
    assert np.array(dcm_from_quaternion(attitude[7:11])).reshape(3, 3) == pytest.approx(r, abs=1e-9)


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.validate)])
def test_slow_turning_and_translation_keep_inclination_and_bias(seed: int) -> None:
    """GIVEN a hand that turns and moves a sensor with 0.2 % scale error THEN 1 degree, and no bias is learned.

    An attitude error of seconds ago came from another body axis than the one that points there at the end.
    """
    rate, rng = 100.0, np.random.default_rng(seed)
    t = np.arange(round(90.0 * rate)) / rate
    moving = np.clip(t - 5.0, 0.0, 1.0)[:, np.newaxis]
    body = np.stack(
        [1.8 * np.sin(1.1 * t + 1.0), 0.7 * np.sin(0.7 * t) - 1.2, np.sin(0.9 * t + 2.0)], axis=1
    ) * moving  # fmt: skip
    turns = [Rotation.identity()]
    for step in Rotation.from_rotvec(body[1:] / rate):
        turns.append(turns[-1] * step)
    attitude = Rotation.concatenate(turns)
    swing = ((0.5, 1.7), (0.9, 2.6), (1.4, 4.1))
    acceleration = moving * sum(a * np.sin(w * t[:, np.newaxis] + rng.uniform(0.0, 6.28, 3)) for a, w in swing)
    force = attitude.inv().apply(acceleration - [0.0, 0.0, 9.80665])
    field = attitude.inv().apply(np.tile(FIELD_NED, (len(t), 1)))
    gyro = 1.002 * body + rng.normal(0.0, 0.003, body.shape)
    samples = [
        ImuSample(round(1e6 * time), *values)
        for time, values in zip(t.tolist(), np.hstack([force, gyro, field]).tolist(), strict=True)
    ]
    state, down, bias = ahrs.start(GAINS, samples[0]), [(0.0, 0.0, 1.0)], [(0.0, 0.0, 0.0)]
    for imu in samples[1:]:
        state, _ = ahrs.step(GAINS, state, imu)
        down.append(state.r[6:9])
        bias.append(state.correction.bias)
    cosine = np.sum(attitude.as_matrix()[:, 2] * np.array(down), axis=1)
    assert rms(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))[t > 20.0]) < 1.0
    assert np.degrees(np.abs(bias).max()) < 0.2
