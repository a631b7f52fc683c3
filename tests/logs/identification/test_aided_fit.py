"""An IMU's errors by a GPS's velocities: found within their intervals whatever the attitude says, or said."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from prescribed_flight import ERRORS, INPUT_NOISE, Flight, motion, truth
from promised import SEEDS, promise_kept

from avionics import topics
from logs.identification.data.experiment import Experiment
from logs.identification.data.flight import Aircraft
from logs.identification.estimators.gps_aided import (
    ATTITUDE,
    VELOCITIES,
    AidedFit,
    AidedFlight,
    aided_fit,
    ned_from_frd,
)
from logs.identification.estimators.registry import ESTIMATORS, Request
from logs.identification.models.rigid_body import INPUTS
from logs.identification.report.subjects import log_path_chapter
from logs.identification.results import Array, estimate
from logs.identification.sources.flight_path import aided_flight, identify_path, imu_truths
from logs.identification.sources.topic_table import whole_flight
from sim_bridge import topics as truth_topics
from wingbeat.errors import InputError
from wingbeat.topic import Topic

OFFSETS = np.array([ERRORS[f"bias_{name}"] for name in INPUTS])
FIX_NOISE, FIX_STEP = 0.1, 10
"""m/s; samples from fix to fix"""
STANDARD = Flight(duration=40.0, activity=0.6)


class MeasuredFlight(NamedTuple):
    """A flight as IMU and GPS told it, and what was wrong with the IMU."""

    flight: AidedFlight
    errors: Array
    """rad/s, m/s^2; (6,), mean over the flight"""


def moved(flight: Flight) -> tuple[Array, Array, Array, Array]:
    """Time, faultless inputs (N, 6), attitude (N, 3) and ground velocity (N, 3) NED of the centre of mass."""
    time, measured_flight = truth(flight)
    _, waves = motion(flight)
    every = slice(None, None, 8)
    attitude = np.column_stack([waves[name].value[every] for name in ("phi", "theta", "psi")])
    velocity = np.column_stack([waves[name].value[every] for name in "uvw"])
    ned = np.einsum("nij,nj->ni", ned_from_frd(attitude), velocity)
    return time, np.column_stack([measured_flight[name] for name in INPUTS]), attitude, ned


def measured_flight(flight: Flight, tilt: float = 0.02, scatter: float = 1.0) -> MeasuredFlight:
    """With offsets, scales and misalignments as units have, ``scatter`` times; the attitude is wrong by ``tilt``."""
    rng = np.random.default_rng(flight.seed)
    time, true, attitude, velocity = moved(flight)
    matrices = [scatter * sigma * rng.normal(size=(3, 3)) for sigma in (0.01, 0.007)]
    wrong = OFFSETS + np.hstack([true[:, :3] @ matrices[0].T, true[:, 3:] @ matrices[1].T])
    noise = flight.input_noise * np.array([INPUT_NOISE[name] for name in INPUTS])
    at = np.arange(0, len(time), FIX_STEP)
    fixes = velocity[at] + flight.noise * FIX_NOISE * rng.normal(size=(len(at), 3))
    slow = tilt * np.sin(2 * np.pi * time / 30.0)[:, None] + tilt
    inputs = true + wrong + noise * rng.normal(size=true.shape)
    made = AidedFlight(time, inputs, attitude + slow, at, fixes, flight.places.imu)
    return MeasuredFlight(made, np.mean(wrong[at[0] : at[-1]], axis=0))


def scores(fit: AidedFit, errors: Array) -> Array:
    """Differences from the truth (6,), in standard errors."""
    return np.asarray((fit.errors - errors) / np.sqrt(np.diag(fit.covariance)))


def coverage(seeds: range, flight: Flight) -> dict[str, float]:
    """Share of the 95 % intervals that hold the truth, by input."""
    held: dict[str, list[bool]] = {name: [] for name in INPUTS}
    for seed in seeds:
        made = measured_flight(flight._replace(seed=seed))
        fit = aided_fit(made.flight)
        assert fit is not None
        for place, name in enumerate(INPUTS):
            error = float(np.sqrt(fit.covariance[place, place]))
            one = estimate(name, "", float(fit.errors[place]), error)
            held[name].append(one.contains(float(made.errors[place])))
    return {name: float(np.mean(inside)) for name, inside in held.items()}


@pytest.mark.validate
def test_intervals_of_many() -> None:
    promise_kept("an IMU by a GPS's velocities", coverage(SEEDS, STANDARD))


@pytest.mark.validate
def test_the_attitude_that_was_told_has_no_part_in_it() -> None:
    """GIVEN an attitude that is 2 deg off and drifts THEN the errors are those beside a faultless one."""
    right, wrong = (aided_fit(measured_flight(STANDARD._replace(seed=7), tilt).flight) for tilt in (0.0, 0.04))
    assert right is not None and wrong is not None
    errors = np.sqrt(np.diag(right.covariance))
    np.testing.assert_allclose(wrong.errors / errors, right.errors / errors, atol=0.25)


@pytest.mark.validate
def test_without_noise_the_offsets_are_exact_to_what_scales_may_be() -> None:
    made = measured_flight(STANDARD._replace(noise=0.0, input_noise=0.0), scatter=0.0)
    fit = aided_fit(made.flight)
    assert fit is not None
    np.testing.assert_allclose(fit.errors[:3], OFFSETS[:3], atol=2e-4)
    np.testing.assert_allclose(fit.errors[3:], OFFSETS[3:], atol=0.03)


def test_the_path_is_that_of_the_truth() -> None:
    flight = STANDARD._replace(seed=2)
    made = measured_flight(flight)
    fit = aided_fit(made.flight)
    assert fit is not None
    _, _, attitude, velocity = moved(flight)
    at = made.flight.at
    assert np.sqrt(np.mean((fit.motion[:, 3:5] - attitude[at, :2]) ** 2)) < 0.01
    assert np.sqrt(np.mean((fit.predicted - velocity[at]) ** 2)) < 0.06
    assert np.mean(scores(fit, made.errors) ** 2) < 3.0
    assert fit.levels.fixes == pytest.approx(FIX_NOISE, rel=0.15)


@pytest.mark.validate
def test_straight_flight_hardly_tells_the_yaw_gyro() -> None:
    """GIVEN next to no turns and accelerations THEN its interval is wider, and holds."""
    still = measured_flight(STANDARD._replace(seed=5, activity=0.02))
    turning, straight = aided_fit(measured_flight(STANDARD._replace(seed=5)).flight), aided_fit(still.flight)
    assert turning is not None and straight is not None
    assert straight.covariance[2, 2] > 4 * turning.covariance[2, 2]
    assert abs(scores(straight, still.errors)[2]) < 3


def test_the_registry_row_is_the_fit_with_findings() -> None:
    made = measured_flight(STANDARD._replace(seed=3))
    flight = made.flight
    velocity = np.full((len(flight.time), 3), np.nan)
    velocity[flight.at] = flight.velocity
    columns = zip(
        (*INPUTS, *ATTITUDE, *VELOCITIES), np.hstack((flight.inputs, flight.attitude, velocity)).T, strict=True
    )
    one = Experiment("flight", flight.time, dict(columns), {})
    result = ESTIMATORS["gps_aided"].estimate(Request((one,), options={"arm": flight.arm}))
    fit = aided_fit(flight)
    assert fit is not None
    np.testing.assert_allclose([each.value for each in result.estimates], fit.errors)
    assert [series.output for series in result.series] == list(VELOCITIES)
    assert [each.code for each in result.findings] == ["measured_by_gps", "mean_bias"]
    without = one._replace(signals={name: values for name, values in one.signals.items() if name != "v_down"})
    with pytest.raises(InputError, match="v_down not measured"):
        ESTIMATORS["gps_aided"].estimate(Request((without,)))


# --- from a log ---------------------------------------------------------------------------------------


class Recorded:
    """Topics as columns."""

    def __init__(self, tables: dict[Topic, dict[str, Array]]) -> None:
        self.tables = {topic.name: table for topic, table in tables.items()}

    def columns(self, topic: Topic) -> dict[str, Array]:
        return self.tables.get(topic.name, {})


LATE = 0.2
"""s; age of a fix"""


def recorded(flight: Flight) -> Recorded:
    """The flight as a flight computer and the world wrote it; the IMU is at the centre of mass."""
    made = measured_flight(flight)
    time, true, attitude, velocity = moved(flight)
    us = np.round(time * 1e6)
    names = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
    angles = dict(zip(("roll", "pitch", "yaw"), made.flight.attitude.T, strict=True))
    ground = dict(zip(("v_north", "v_east", "v_down"), velocity.T, strict=True))
    fixes = dict(zip(("v_north", "v_east", "v_down"), made.flight.velocity.T, strict=True))
    rates = dict(zip(("roll_rate", "pitch_rate", "yaw_rate"), true.T[:3], strict=True))
    half = attitude.T / 2
    (sa, sb, sc), (ca, cb, cc) = np.sin(half), np.cos(half)
    quaternion = {
        "quaternion_w": ca * cb * cc + sa * sb * sc, "quaternion_x": sa * cb * cc - ca * sb * sc,
        "quaternion_y": ca * sb * cc + sa * cb * sc, "quaternion_z": ca * cb * sc - sa * sb * cc,
    }  # fmt: skip
    return Recorded({
        topics.IMU: {"time_us": us, **dict(zip(names, made.flight.inputs.T, strict=True))},
        topics.ATTITUDE: {"time_us": us, **angles, "tilt_sigma": np.full(len(us), 0.01)},
        topics.AIR_DATA: {"time_us": us, "airspeed": np.linalg.norm(velocity, axis=1)},
        topics.GPS: {"time_us": us[made.flight.at] + LATE * 1e6, **fixes},
        truth_topics.STATE: {"time_us": us, **ground, **quaternion, **rates},
    })  # fmt: skip


AT_CENTRE = STANDARD._replace(places=STANDARD.places._replace(imu=(0.0, 0.0, 0.0)))


def test_a_log_gives_the_flight_behind_its_launch_and_the_age_of_the_fixes() -> None:
    log = recorded(AT_CENTRE)
    made = aided_flight(log, whole_flight(log, "flight"), Aircraft())
    assert made.time[0] == pytest.approx(LATE + 5.0, abs=0.03)
    fixes = log.columns(topics.GPS)
    (arrived,) = fixes["time_us"][fixes["v_north"] == made.velocity[0, 0]]
    assert arrived * 1e-6 - made.time[made.at[0]] == pytest.approx(LATE, abs=0.021)


def test_the_path_of_a_log_stands_beside_its_truth() -> None:
    log = recorded(AT_CENTRE._replace(seed=4))
    fit = identify_path(log, Aircraft())
    known = imu_truths(log, Aircraft(), fit.spans)
    assert [one.name for one in fit.result.estimates] == [f"bias_{name}" for name in INPUTS]
    for one in fit.result.estimates:
        assert abs(one.value - known[one.name]) < 3 * one.standard_error
    chapter = log_path_chapter(fit)
    assert chapter is not None and len(chapter.plots) == 6
    assert [series.output for series in fit.result.series] == ["v_north", "v_east", "v_down"]


def test_without_velocities_a_filters_attitude_gives_no_numbers() -> None:
    """GIVEN no GPS and an attitude that may be off THEN each error is said not to be had, and why."""
    log = recorded(AT_CENTRE)
    del log.tables[topics.GPS.name]
    fit = identify_path(log, Aircraft())
    assert not fit.result.estimates
    withheld = {one.subject: one.code for one in fit.result.withheld}
    assert all(withheld[f"bias_{name}"] == "attitude_filter" for name in INPUTS)
    (by_attitude,) = (one for one in fit.result.findings if one.code == "by_attitude")
    assert "/sensors/gps" in by_attitude.text
    assert log_path_chapter(fit) is not None


def test_manoeuvres_that_meet_are_one_record_and_a_vertical_gyro_gives_numbers() -> None:
    """GIVEN no GPS, an attitude without a filter's error and inputs 4 s apart THEN no sample counts twice."""
    log = recorded(AT_CENTRE)
    del log.tables[topics.GPS.name]
    us = log.tables[topics.IMU.name]["time_us"]
    first, second = ((us >= begin * 1e6) & (us < begin * 1e6 + 1e6) for begin in (12.0, 17.0))
    log.tables[topics.ATTITUDE.name]["tilt_sigma"] = np.zeros(len(us))
    log.tables[topics.EXCITATION.name] = {
        "time_us": us, "active": 1.0 * (first | second), "manoeuvre": 1.0 + second, "aborted": 0.0 * us,
    }  # fmt: skip
    fit = identify_path(log, Aircraft())
    assert len(fit.spans) == 1 and "maneuver 1 to 2" in fit.records[0]
    assert fit.spans[0] == pytest.approx((7.0, 23.0), abs=0.05)
    assert {"bias_p", "bias_q", "bias_r"} <= {one.name for one in fit.result.estimates}


@pytest.mark.parametrize("gps", [True, False])
def test_a_long_wait_before_the_launch_is_no_flight(gps: bool) -> None:
    """GIVEN half of a record in the hand, with gusts on the pitot THEN the flight alone is taken."""
    log = recorded(AT_CENTRE)
    time = log.tables[topics.IMU.name]["time_us"] * 1e-6
    gusty = np.where(np.mod(time, 3.0) < 1.0, 2.0, 0.0)
    log.tables[topics.AIR_DATA.name]["airspeed"] = np.where(time < 22.0, gusty, 20.0)
    for name in ("v_north", "v_east", "v_down"):
        log.tables[topics.GPS.name][name] = log.tables[topics.GPS.name][name].copy()
        log.tables[topics.GPS.name][name][log.tables[topics.GPS.name]["time_us"] < 22.2e6] = 0.0
    if not gps:
        del log.tables[topics.GPS.name]
    assert identify_path(log, Aircraft()).spans[0][0] == pytest.approx(27.0, abs=0.5)


def test_a_log_without_a_truth_has_none() -> None:
    log = recorded(AT_CENTRE)
    del log.tables[truth_topics.STATE.name]
    assert imu_truths(log, Aircraft(), ((5.0, 30.0),)) == {}
