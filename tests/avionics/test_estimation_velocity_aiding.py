"""Attitude from the modelled sensors of a flapping airframe: errors, uncertainty, bad fixes, disturbed field."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from avionics import snapshot
from avionics.estimation import ahrs, velocity_aiding
from avionics.messages import GpsFix

sys.path.insert(0, str(Path(__file__).parent))

from flapping_airframe import SLOW_HAWK, Motion
from modelled_sensors import GAINS, STILL, Estimate, Sensed, calibrated, estimated, sensed, shipped

SensedFlight = tuple[Motion, list[Sensed]]
LENGTH = 32.0


@cache
def flight(bank_deg: float, seed: int = 1, units: bool = False) -> SensedFlight:
    """Noise, resolution and gyro bias of the modelled sensors; with ``units`` what calibration leaves as well."""
    spec = shipped() if units else calibrated(shipped())
    return sensed(spec, SLOW_HAWK._replace(bank=math.radians(bank_deg)), LENGTH, seed)


def altered(flight: SensedFlight, change: Callable[[float, Sensed], Sensed]) -> SensedFlight:
    """Sensors that fail: ``change`` is given the time since the throw."""
    motion, given = flight
    return motion, [change(float(t) - STILL, now) for t, now in zip(motion.time, given, strict=True)]


def flying(
    estimate: Estimate, since: float = 4.0, until: float = LENGTH
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    return (estimate.time > STILL + since) & (estimate.time < STILL + until)


def without_fix(since: float, now: Sensed) -> Sensed:
    return now._replace(fix=None)


@pytest.mark.parametrize(("bank_deg", "limit_deg"), [(0.0, 0.5), (25.0, 1.0), (-25.0, 1.0)])
@pytest.mark.parametrize("gps", [True, pytest.param(False, marks=pytest.mark.validate)])
def test_roll_and_pitch_while_flapping(bank_deg: float, limit_deg: float, gps: bool) -> None:
    """GIVEN sensor noise on a Slow Hawk THEN roll and pitch are within 0.5 degrees straight, 1.0 in turns, RMS."""
    flown = flight(bank_deg) if gps else altered(flight(bank_deg), without_fix)
    estimate = estimated(*flown)
    assert estimate.rms_deg(flying(estimate))[:2].max() < limit_deg
    assert estimate.attitudes[-1].gps_aided == int(gps)


@pytest.mark.validate
def test_told_sigma_is_that_of_many_units() -> None:
    """GIVEN eight vehicles with what their calibrations leave WHEN they fly THEN errors are as large as told."""
    ratios = []
    for seed in range(8):
        estimate = estimated(*flight(25.0 * (seed % 2), seed, units=True))
        chosen = flying(estimate)
        for axis, name in ((0, "tilt_sigma"), (1, "tilt_sigma"), (2, "heading_sigma")):
            ratios.append(estimate.error[chosen, axis] / estimate.column(name)[chosen])
    roll, pitch, yaw = (float(np.sqrt(np.mean(np.square(ratios[axis::3])))) for axis in range(3))
    assert 0.5 < math.hypot(roll, pitch) / math.sqrt(2.0) < 1.6
    assert 0.3 < yaw < 1.6


def test_sigma_grows_without_fixes_and_shrinks_again() -> None:
    lost = altered(flight(25.0), lambda since, now: now._replace(fix=None) if 10.0 < since < 20.0 else now)
    estimate, unbroken = estimated(*lost), estimated(*flight(25.0)).column("tilt_sigma")
    sigma, aided = estimate.column("tilt_sigma"), estimate.column("gps_aided")
    before, during, after = (int((STILL + at) * 200) for at in (9.0, 19.0, 30.0))
    assert sigma[during] > 1.5 * sigma[before]
    assert sigma[after] < 1.1 * unbroken[after]
    assert (aided[before], aided[during], aided[after]) == (1, 0, 1)


@pytest.mark.parametrize("glitch", [8.0, math.nan])
def test_fixes_that_jump_are_refused(glitch: float) -> None:
    """GIVEN reflected signals that shift the velocity by 8 m/s for a second THEN the attitude does not move."""

    def shift(since: float, now: Sensed) -> Sensed:
        if now.fix is None or not 15.0 < since < 16.0:
            return now
        return now._replace(fix=now.fix._replace(v_north=now.fix.v_north + glitch))

    plain, jumped = estimated(*flight(25.0)), estimated(*altered(flight(25.0), shift))
    moved = np.degrees(np.abs(plain.error - jumped.error)[flying(plain), :2])
    assert moved.max() < 0.5


def test_receiver_that_always_lies_is_left_alone() -> None:
    """GIVEN a receiver that tells of standing still THEN averages and airspeed go on telling the tilt."""

    def stand(since: float, now: Sensed) -> Sensed:
        return now if now.fix is None else now._replace(fix=now.fix._replace(v_north=0.0, v_east=0.0))

    estimate = estimated(*altered(flight(25.0), stand))
    chosen = flying(estimate, 6.0)
    assert estimate.rms_deg(chosen)[:2].max() < 3.0


def test_start_in_flight_recovers_with_fixes() -> None:
    """GIVEN a computer that boots 5 s after the throw, shaken THEN it finds up and trusts the GPS."""
    motion, given = flight(0.0)
    first = int((STILL + 5.0) * 200)
    cut = Motion(*(part[first:] for part in motion))
    estimate = estimated(cut, given[first:])
    assert np.degrees(np.abs(estimate.error[-2000:, :2])).max() < 1.5
    assert estimate.attitudes[-1].gps_aided == 1


def magnet(gauss: float, start: float, end: float) -> Callable[[float, Sensed], Sensed]:
    """A field along body y that comes with the motor's current or a magnet nearby."""

    def change(since: float, now: Sensed) -> Sensed:
        return now._replace(imu=now.imu._replace(mag_y=now.imu.mag_y + gauss)) if start < since < end else now

    return change


@pytest.mark.parametrize("gps", [True, False])
def test_strong_magnet_is_refused_and_told(gps: bool) -> None:
    """GIVEN half the earth's field again for 15 s THEN it is said, and the heading keeps within 5 degrees."""
    disturbed = altered(flight(0.0), magnet(0.3, 10.0, 25.0))
    estimate = estimated(*(disturbed if gps else altered(disturbed, without_fix)))
    told = estimate.column("magnetometer_disturbed")
    since = estimate.time - STILL
    assert not told[since < 10.9].any()
    assert told[(since > 12.0) & (since < 25.0)].all()
    assert not told[since > 26.5].any()
    assert np.degrees(np.abs(estimate.error[flying(estimate), 2])).max() < 5.0


def test_field_that_hides_from_norm_and_dip_is_caught_by_the_gps() -> None:
    """GIVEN a field across, 20 degrees of heading at hardly another norm or dip THEN only the GPS tells it apart."""
    hidden = altered(flight(25.0), magnet(0.08, 12.0, LENGTH))
    aided, alone = estimated(*hidden), estimated(*altered(hidden, without_fix))
    late = flying(aided, 25.0)
    assert aided.rms_deg(late)[2] < 5.0
    assert alone.rms_deg(late)[2] > 2.0 * aided.rms_deg(late)[2]


def test_refused_field_lets_the_heading_sigma_grow() -> None:
    estimate = estimated(*altered(flight(0.0), magnet(0.3, 10.0, LENGTH)))
    sigma = estimate.column("heading_sigma")
    assert sigma[-1] > 1.1 * sigma[int((STILL + 9.5) * 200)]


def imu_error(**errors: float) -> Callable[[float, Sensed], Sensed]:
    """Constants added to fields of the IMU sample."""

    def change(since: float, now: Sensed) -> Sensed:
        return now._replace(imu=now.imu._replace(**{name: getattr(now.imu, name) + e for name, e in errors.items()}))

    return change


@pytest.mark.parametrize("axis", ["accel_x", "accel_y"])
def test_accelerometer_offset_is_learned_in_a_turn(axis: str) -> None:
    """GIVEN 150 mg along the horizon, a tilt of 8.6 degrees at rest WHEN it turns THEN the attitude is right."""
    estimate = estimated(*altered(flight(25.0), imu_error(**{axis: 1.47})))
    assert estimate.rms_deg(flying(estimate, -1.0, 0.0))[:2].max() > 8.0
    assert estimate.rms_deg(flying(estimate, 12.0))[:2].max() < 1.5


@pytest.mark.parametrize("offset", [-1.47, 1.47])
def test_accelerometer_offset_along_body_x_is_learned_by_the_launch(offset: float) -> None:
    """GIVEN 150 mg along body x WHEN it is launched THEN the attitude is right 5 s later, without a turn."""
    estimate = estimated(*altered(flight(0.0), imu_error(accel_x=offset)))
    assert estimate.rms_deg(flying(estimate, -1.0, 0.0))[:2].max() > 8.0
    assert estimate.rms_deg(flying(estimate, 5.0))[:2].max() < 1.5


def test_accelerometer_offset_is_not_learned_from_calibrated_sensors() -> None:
    _, given = flight(25.0)
    state = ahrs.start(GAINS, given[0].imu)
    for now in given[1:]:
        state, _ = ahrs.step(GAINS, state, now.imu, now.frequency, now.airspeed, now.fix)
    assert np.abs(state.correction.accel_offset).max() < 0.05
    assert np.abs(state.correction.iron).max() < 0.01


def test_launch_turns_a_wrong_heading_to_the_course() -> None:
    """GIVEN a hard iron that turns the field at rest by 70 degrees THEN the launch shows both."""
    motion, given = flight(0.0)
    held = next(now.imu for now in given[::-1] if now.imu.time_us < (STILL - 1.0) * 1e6)
    field = np.array(held[7:10])
    up = np.array(held[1:4]) / np.linalg.norm(held[1:4])
    turned = Rotation.from_rotvec(math.radians(70.0) * up).apply(field)
    iron = dict(zip(("mag_x", "mag_y", "mag_z"), (turned - field).tolist(), strict=True))
    estimate = estimated(*altered((motion, given), imu_error(**iron)))
    assert estimate.rms_deg(flying(estimate, -1.0, 0.0))[2] > 60.0
    assert estimate.rms_deg(flying(estimate, 1.5))[2] < 5.0
    assert estimate.rms_deg(flying(estimate, 1.5))[:2].max() < 1.5
    assert not estimate.attitudes[-1].magnetometer_disturbed


def test_fix_without_a_position_corrects_nothing() -> None:
    motion, given = flight(0.0)
    none = altered((motion, given), lambda _, now: now._replace(fix=now.fix._replace(fix_type=0)) if now.fix else now)
    blind, lost = estimated(*none), estimated(*altered((motion, given), without_fix))
    assert blind.attitudes[-1].gps_aided == 0
    assert blind.error == pytest.approx(lost.error, abs=1e-9)


def test_covariance_stays_symmetric_and_positive() -> None:
    _, given = flight(25.0)
    state = ahrs.start(GAINS, given[0].imu)
    for now in given[1:]:
        state, _ = ahrs.step(GAINS, state, now.imu, now.frequency, now.airspeed, now.fix)
    p = np.array(state.aid.covariance).reshape(velocity_aiding.STATES, -1)
    assert p == pytest.approx(p.T, abs=1e-15)
    assert np.linalg.eigvalsh(p).min() > 0.0
    again = snapshot.builder(ahrs.AhrsState)(json.loads(json.dumps(state)))
    assert again == state


def test_tilt_is_found_from_the_velocity_alone() -> None:
    """GIVEN a filter at rest that is 3 degrees off and sees no gravity in its blocks THEN fixes right it."""
    tilt = math.radians(3.0)
    noise = velocity_aiding.Noise(0.001, 0.0005, 0.1, 5.0, 2.0, 0.0)
    r = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    aid = velocity_aiding.start(0, r)
    north, turned = 0.0, 0.0
    for k in range(60):
        time_us, time = 200_000 * (k + 1), 0.2 * (k + 1)
        # The force points up; the estimate holds it turned about east, so that it seems to push north.
        north += 9.81 * math.sin(tilt - turned) * 0.2
        impulse = (north, 0.0, -9.81 * 0.2 * (k + 1))
        aid = velocity_aiding.remember(aid, 0.0, time_us, impulse)
        attitude = (time, 0.0, 0.0, 0.0, time, 0.0, 0.0, 0.0, time)
        p = velocity_aiding.carried(aid, noise, time_us, impulse, attitude)
        fix = GpsFix(time_us, 0.68, -1.34, 20.0, 0.0, 0.0, 0.0, 3.0, 4.0, 3, 9)
        aid, errors = velocity_aiding.fixed(aid, p, noise, fix)
        aid = velocity_aiding.kept(aid, p, time_us, impulse, attitude)
        turned += errors.turn[1]
    assert turned == pytest.approx(tilt, abs=math.radians(0.1))
