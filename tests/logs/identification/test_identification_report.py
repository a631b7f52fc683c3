"""From the topics of a log to the report: numbers with truths, and one clear line for what a log does not give."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from linear_ornithopter import AIRCRAFT, Flight, fly, model_of
from wing_drives import K_TAU, K_TAU0, Drives, exact, measure, simulate

from avionics import topics
from logs.identification.data.flight import FlightData, ImuCalibration
from logs.identification.models.modes import short_period_of
from logs.identification.report import POWER_TRUTH, Identification, document, identify, rows
from sim_bridge import topics as truth
from wingbeat.errors import InputError
from wingbeat.topic import Topic

FREQUENCY, DAMPING = short_period_of(model_of(Flight()).a)
TRUTHS = {
    "K_tau": K_TAU,
    "K_tau0": K_TAU0,
    "short_period_frequency": FREQUENCY,
    "short_period_damping": DAMPING,
}
DRIVES = Drives(duration=20.0)


class RecordedTopics:
    """Topics as a log gives them: columns of arrays by field name."""

    def __init__(self, tables: Mapping[str, Mapping[str, Any]]) -> None:
        self.tables = dict(tables)

    def columns(self, topic: Topic) -> Mapping[str, Any]:
        return self.tables[topic.name]

    def with_constant(self, topic: Topic, field: str) -> RecordedTopics:
        table = self.tables[topic.name]
        return RecordedTopics({**self.tables, topic.name: {**table, field: np.full_like(table[field], 0.1)}})

    def without(self, *absent: Topic) -> RecordedTopics:
        names = {topic.name for topic in absent}
        return RecordedTopics({name: table for name, table in self.tables.items() if name not in names})


def micros(time: np.ndarray) -> np.ndarray:
    return np.round(time * 1e6).astype(np.int64)


def motion_topics(flight: FlightData) -> dict[str, Mapping[str, Any]]:
    stamp = micros(flight.time)
    bias = np.full(len(stamp), 0.01)
    wing = np.mod(2 * np.pi * flight.strokes, 2 * np.pi)
    return {
        topics.IMU.name: {
            "time_us": stamp,
            "gyro_y": flight.pitch_rate + bias,
            "accel_x": flight.accel_x,
            "accel_z": flight.accel_z,
        },
        topics.ATTITUDE.name: {
            "time_us": stamp,
            "pitch": flight.pitch,
            "bias_y": bias,
        },
        topics.AIR_DATA.name: {"time_us": stamp[::4], "airspeed": flight.airspeed[::4]},
        topics.ALTITUDE.name: {"time_us": stamp[::4], "climb_rate": flight.climb_rate[::4]},
        topics.ACTUATORS.name: {"time_us": stamp, "elevator": flight.elevator},
        topics.WING.name: {"time_us": stamp, "phase": wing, "angle_left": 0 * wing, "angle_right": 0 * wing},
        topics.EXCITATION.name: {
            "time_us": stamp[::2],
            "active": flight.active[::2].astype(int),
            "manoeuvre": flight.manoeuvre[::2].astype(int),
            "elevator": flight.excitation[::2],
            "aborted": flight.aborted[::2].astype(int),
        },
    }


def integral(time: np.ndarray, rate: np.ndarray) -> np.ndarray:
    return np.concatenate(([0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(time))))


def drive_topics() -> dict[str, Mapping[str, Any]]:
    world = simulate(DRIVES)
    data, true = measure(world, DRIVES), exact(world)
    tick = float(np.median(np.diff(data.wing_time)))

    def over_the_tick(values: np.ndarray) -> np.ndarray:
        """As the world tells it: the mean over the tick that ends there, to first order its value in the middle."""
        return np.interp(true.power_time - tick / 2, true.power_time, values)

    return {
        topics.POWER.name: {"time_us": micros(data.power_time), "current": data.current, "voltage": data.voltage},
        topics.DRIVE_TORQUE.name: {
            "time_us": micros(data.torque_time),
            "left": data.torque_left,
            "right": data.torque_right,
        },
        topics.WING.name: {
            "time_us": micros(data.wing_time),
            "phase": np.mod(2 * np.pi * data.strokes, 2 * np.pi),
            "angle_left": integral(data.wing_time, data.rate_left),
            "angle_right": integral(data.wing_time, data.rate_right),
        },
        truth.WING.name: {
            "time_us": micros(true.power_time),
            "current": over_the_tick(true.current),
            "voltage": over_the_tick(true.voltage),
            "torque_left": over_the_tick(true.torque_left),
            "torque_right": over_the_tick(true.torque_right),
            "rate_left": true.rate_left,
            "rate_right": true.rate_right,
        },
    }


@pytest.fixture(scope="module")
def motion() -> RecordedTopics:
    return RecordedTopics(motion_topics(fly(Flight(seed=3))))


@pytest.fixture(scope="module")
def drive() -> RecordedTopics:
    return RecordedTopics(drive_topics())


@pytest.fixture(scope="module")
def modes(motion: RecordedTopics) -> Identification:
    return identify(motion, "modes", AIRCRAFT, lambda _: TRUTHS)


@pytest.fixture(scope="module")
def everything(motion: RecordedTopics) -> Identification:
    return identify(motion, "all", AIRCRAFT, lambda _: TRUTHS)


def numbers(result: Identification) -> dict[tuple[str, str], tuple[float, float | None]]:
    return {(r.subject, r.name): (r.estimate.value, r.truth) for r in rows(result) if r.estimate is not None}


def test_modes_from_topics(modes: Identification) -> None:
    found = numbers(modes)
    value, true = found["output error", "short_period_frequency"]
    assert true == FREQUENCY
    assert value == pytest.approx(FREQUENCY, rel=0.02)


def test_a_calibrated_imu_is_corrected_and_a_wrong_one_is_not() -> None:
    """GIVEN an accelerometer with a scale and an offset THEN its calibration gives what a perfect one gives."""
    motion = RecordedTopics(motion_topics(fly(Flight(seed=3, doublets=2))))
    imu = dict(motion.tables[topics.IMU.name])
    imu["accel_x"], imu["accel_z"] = imu["accel_x"] / 1.1 + 0.4, imu["accel_z"] / 1.15 - 0.7
    wrong = RecordedTopics({**motion.tables, topics.IMU.name: imu})
    calibration = ImuCalibration(accel_offset=(0.4, 0.0, -0.7), accel_scale=(1.1, 1.0, 1.15))
    name = ("output error", "short_period_frequency")
    perfect, corrected, left = (
        numbers(identify(source, "modes", aircraft, method="output_error"))[name][0]
        for source, aircraft in (
            (motion, AIRCRAFT),
            (wrong, AIRCRAFT._replace(imu=calibration)),
            (wrong, AIRCRAFT),
        )
    )
    assert corrected == pytest.approx(perfect, rel=1e-6)
    assert left != pytest.approx(perfect, rel=1e-3)


def test_servo_from_topics_with_the_worlds_truth_beside(drive: RecordedTopics) -> None:
    found = numbers(identify(drive, "servo", truths=lambda _: TRUTHS))
    assert found["servo torque", "K_tau"] == (pytest.approx(K_TAU, rel=0.02), K_TAU)
    value, true = found["servo power", "P_0"]
    assert true is not None
    assert value == pytest.approx(true, rel=0.02)
    assert value != true


def test_where_the_true_power_is_from_is_said_where_there_is_one(drive: RecordedTopics) -> None:
    notes = [row.note for row in rows(identify(drive, "power")) if row.name == "true values"]
    assert notes == [POWER_TRUTH] and "this flight" in POWER_TRUTH
    real = rows(identify(drive.without(truth.WING), "power"))
    assert not [row for row in real if row.note == POWER_TRUTH]


def test_power_alone_leaves_the_torque_out(drive: RecordedTopics) -> None:
    result = identify(drive, "power")
    assert result.torque is None and result.power is not None


def test_a_real_flight_has_no_truth(drive: RecordedTopics) -> None:
    result = identify(drive.without(truth.WING), "servo")
    assert {row.truth for row in rows(result)} == {None}


def test_all_gives_what_there_is_and_says_what_is_missing(everything: Identification) -> None:
    assert everything.modes is not None and everything.torque is None
    assert "/main/drive_torque" in everything.missing[0].text


def test_a_row_has_its_number_with_the_truth_or_the_reason_why_there_is_none(everything: Identification) -> None:
    found = rows(everything)
    assert {row.truth for row in found if row.name == "short_period_damping"} == {DAMPING}
    assert any(row.estimate is None and row.note.startswith("not identified: ") for row in found)


@pytest.mark.parametrize("what", ["modes", "everything"])
def test_the_document_is_strict_json(request: pytest.FixtureRequest, what: str) -> None:
    written = json.dumps(document(request.getfixturevalue(what)), allow_nan=False)
    told = json.loads(written)["modes"]
    assert told["methods"][0]["frequency"]["truth"] == FREQUENCY
    assert isinstance(told["agree"], bool)


def test_the_document_of_the_drives_is_strict_json(drive: RecordedTopics) -> None:
    parsed = json.loads(json.dumps(document(identify(drive, "servo")), allow_nan=False))
    assert {entry["name"] for entry in parsed["torque"]["estimates"]} == {"K_tau", "K_tau0"}


@pytest.mark.parametrize("topic", [topics.IMU, topics.WING, topics.ACTUATORS, topics.EXCITATION, topics.AIR_DATA])
def test_a_missing_topic_is_named_in_one_line(motion: RecordedTopics, topic: Topic) -> None:
    """GIVEN a log in which nothing else tells what the topic would have THEN it is named."""
    still = motion.with_constant(topics.ACTUATORS, "elevator") if topic is topics.EXCITATION else motion
    still = motion.with_constant(topics.IMU, "accel_z") if topic is topics.WING else still
    with pytest.raises(InputError, match=topic.name) as refusal:
        identify(still.without(topic), "modes", AIRCRAFT)
    assert "\n" not in str(refusal.value)


class DamagedTopics(RecordedTopics):
    """A log in which everything is declared, and a part of the file cannot be read."""

    topics = frozenset(topic.name for topic in topics.TOPICS)

    def columns(self, topic: Topic) -> Mapping[str, Any]:
        raise InputError("chunk at byte 496888 does not match its checksum")


@pytest.mark.parametrize("what", ["modes", "servo"])
def test_a_damaged_topic_is_not_called_missing(motion: RecordedTopics, what: str) -> None:
    with pytest.raises(InputError, match="chunk at byte 496888"):
        identify(DamagedTopics(motion.tables), what, AIRCRAFT)


@pytest.mark.parametrize(
    ("absent", "notes"),
    [
        pytest.param((topics.EXCITATION,), ("manoeuvres",), marks=pytest.mark.validate),
        pytest.param((topics.WING,), ("strokes",), marks=pytest.mark.validate),
        ((topics.EXCITATION, topics.WING, topics.AIR_DATA), ("manoeuvres", "strokes", "airspeed")),
    ],
    ids=str,
)
def test_what_a_log_of_another_program_lacks_is_taken_from_what_it_has_and_told(
    motion: RecordedTopics, absent: tuple[Topic, ...], notes: tuple[str, ...]
) -> None:
    airspeed = motion.tables[topics.AIR_DATA.name]["airspeed"]
    climb = motion.tables[topics.ALTITUDE.name]["climb_rate"]
    ground = {"time_us": motion.tables[topics.AIR_DATA.name]["time_us"], "v_east": 0 * airspeed}
    ground |= {"v_north": np.sqrt(airspeed**2 - climb**2)}
    source = RecordedTopics({**motion.tables, topics.POSITION.name: ground}).without(*absent)
    found = identify(source, "modes", AIRCRAFT)
    assert found.modes is not None and found.modes.manoeuvres == 6
    assert tuple(note.partition(":")[0] for note in found.modes.notes) == notes
    assert document(found)["modes"]["notes"] == list(found.modes.notes)
    assert {row.note for row in rows(found) if row.name in ("note", "warning")} == set(found.modes.notes)
    assert all(mode.frequency is not None for mode in found.modes.modes[:2])
    for mode in (mode for mode in found.modes.modes if mode.short_period is not None):
        assert mode.frequency.contains(FREQUENCY)
        assert mode.damping.contains(DAMPING)


def test_a_stand_without_encoders_gives_the_torque_and_says_why_no_power(drive: RecordedTopics) -> None:
    result = identify(drive.without(topics.WING, truth.WING), "servo")
    assert result.torque is not None and result.power is None
    assert {e.name: e.contains(t) for e, t in zip(result.torque.estimates, (K_TAU, K_TAU0), strict=True)} == {
        "K_tau": True,
        "K_tau0": True,
    }
    assert [(one.subject, "/main/wing" in one.text) for one in result.missing] == [("servo power", True)]


def test_a_stand_that_tells_the_wings_angle_alone_gives_the_power_too(drive: RecordedTopics) -> None:
    """GIVEN no phase THEN the strokes are counted by the angle, and the model is the same within its intervals."""
    angles = {name: values for name, values in drive.tables[topics.WING.name].items() if name != "phase"}
    told, counted = (
        identify(source, "power").power
        for source in (drive, RecordedTopics({**drive.tables, topics.WING.name: angles}))
    )
    assert told is not None and counted is not None
    for one, other in zip(told.estimates, counted.estimates, strict=True):
        assert one.name == other.name and other.contains(one.value)


def test_a_flight_without_excitation_is_told_what_to_fly(motion: RecordedTopics) -> None:
    calm = dict(motion.tables)
    calm[topics.EXCITATION.name] = {
        name: column if name == "time_us" else 0 * column for name, column in calm[topics.EXCITATION.name].items()
    }
    with pytest.raises(InputError, match="no excitation: fly an EXCITE item"):
        identify(RecordedTopics(calm), "modes", AIRCRAFT)


def test_samples_that_are_not_finite_are_passed_over(motion: RecordedTopics) -> None:
    torn = dict(motion.tables)
    imu = {name: np.array(column, dtype=float) for name, column in torn[topics.IMU.name].items()}
    imu["gyro_y"][1000:1004] = np.nan
    torn[topics.IMU.name] = imu
    found = identify(RecordedTopics(torn), "modes", AIRCRAFT, method="output_error")
    value, _ = numbers(found)["output error", "short_period_frequency"]
    assert value == pytest.approx(FREQUENCY, rel=0.03)


def test_an_unknown_subject_is_refused_with_the_known_ones(motion: RecordedTopics) -> None:
    with pytest.raises(InputError, match="servo, power, modes, aero, path, all"):
        identify(motion, "colour")
