"""Several topics on one time base."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer
from recorded import FIXED_TOPICS, flight, random_message, record

from avionics import messages as m
from avionics import topics
from avionics.state import zero
from logs.layout import layout_of
from logs.reader import Log, open_log
from logs.schema import descriptor_set
from sim_bridge import topics as truth
from wingbeat.errors import InputError
from wingbeat.topic import Topic


def log_of(path: Path, topic: Topic, times_us: list[int], fill: Callable[[float], dict[str, Any]]) -> Log:
    """A log of one topic whose fields follow from the time in s."""
    source = random.Random(1)
    messages = [random_message(topic, time, source)._replace(**fill(time * 1e-6)) for time in times_us]
    return open_log(record(path / "a.mcap", [(topic, message) for message in messages]))


def every(step_us: int, count: int) -> list[int]:
    return [step_us * (n + 1) for n in range(count)]


def wrapped(angle: float) -> float:
    return math.remainder(angle, math.tau)


def test_rows_are_the_messages_of_the_first_topic(tmp_path: Path) -> None:
    log = open_log(record(tmp_path / "a.mcap", flight(2.0, (topics.IMU, topics.ATTITUDE, topics.POWER))))
    table = log.aligned([topics.POWER, "/attitude/ahrs.roll", "/sensors/imu.gyro_x"])
    power = log.columns(topics.POWER)
    assert np.allclose(table.time, power.time, atol=1e-12)
    assert np.array_equal(table["/power/state.voltage"], power["voltage"])
    assert list(table)[-2:] == ["/attitude/ahrs.roll", "/sensors/imu.gyro_x"]
    assert table.units["/sensors/imu.gyro_x"] == "rad/s" and "/power/state.time_us" not in table


@pytest.mark.parametrize("topic", FIXED_TOPICS, ids=lambda topic: topic.name)
def test_a_topic_at_its_own_times_is_as_it_was_recorded(tmp_path: Path, topic: Topic) -> None:
    log = open_log(record(tmp_path / "a.mcap", flight(2.0, (topic,))))
    columns, table = log.columns(topic), log.aligned([topic])
    for name in columns:
        if name != "time_us" and not name.startswith("quaternion"):
            assert np.array_equal(table[f"{topic.name}.{name}"], columns[name]), name


def test_numbers_are_linear_between_messages_and_unknown_beyond(tmp_path: Path) -> None:
    log = log_of(tmp_path, topics.AIR_DATA, every(20_000, 50), lambda t: {"airspeed": 3.0 + 2.0 * t})
    table = log.aligned(["/main/air_data.airspeed"], rate=1000.0, start=0.0, end=2.0)
    speed = table["/main/air_data.airspeed"]
    known = (table.time >= 0.02) & (table.time <= 1.0)
    assert len(table.time) == 2000 and np.allclose(speed[known], 3.0 + 2.0 * table.time[known], atol=1e-12)
    assert np.isnan(speed[~known]).all()


@given(turns=st.floats(-0.45, 0.45), first=st.floats(-10.0, 10.0))
@settings(max_examples=30, deadline=None)
def test_an_angle_takes_the_shorter_way_round(
    tmp_path_factory: pytest.TempPathFactory, turns: float, first: float
) -> None:
    """GIVEN a yaw that turns evenly through its wrap THEN between two messages it is where it was."""
    true = lambda t: first + turns * math.tau * t / 0.005  # noqa: E731
    path = tmp_path_factory.mktemp("yaw")
    log = log_of(path, topics.ATTITUDE, every(5_000, 60), lambda t: {"yaw": wrapped(true(t))})
    table = log.aligned(["/attitude/ahrs.yaw"], rate=1000.0)
    yaw = table["/attitude/ahrs.yaw"]
    apart = np.exp(1j * yaw) - np.exp(1j * np.array([true(t) for t in table.time]))
    assert np.max(np.abs(apart)) < 1e-6
    assert np.all(np.abs(yaw) <= math.pi + 1e-12)


def test_a_phase_stays_between_zero_and_two_pi(tmp_path: Path) -> None:
    log = log_of(tmp_path, topics.WING, every(5_000, 200), lambda t: {"phase": (25.0 * t) % math.tau})
    table = log.aligned(["/main/wing.phase"], rate=1700.0)
    phase = table["/main/wing.phase"]
    assert np.all((phase >= 0.0) & (phase < math.tau))
    assert np.allclose(np.exp(1j * phase), np.exp(25j * table.time), atol=1e-9)


def test_an_angle_whose_description_tells_no_range_is_a_number_like_others(tmp_path: Path) -> None:
    log = log_of(tmp_path, topics.WING, every(5_000, 3), lambda t: {"angle_left": 3.1 if t < 0.01 else -3.1})
    assert log.aligned(["/main/wing.angle_left"], rate=400.0)["/main/wing.angle_left"][1] == pytest.approx(0.0)


def test_quaternions_keep_their_length_and_sign(tmp_path: Path) -> None:
    """GIVEN a body that turns about its z axis, every third quaternion written with the other sign."""

    def attitude(t: float) -> dict[str, Any]:
        sign = -1.0 if round(t / 0.005) % 3 == 0 else 1.0
        parts = (sign * math.cos(2.0 * t), 0.0, 0.0, sign * math.sin(2.0 * t))
        return {f"quaternion_{axis}": part for axis, part in zip("wxyz", parts, strict=True)}

    log = log_of(tmp_path, truth.STATE, every(5_000, 800), attitude)
    table = log.aligned([truth.STATE], rate=900.0)
    rows = np.column_stack([table[f"/truth/state.quaternion_{axis}"] for axis in "wxyz"])
    assert np.allclose(np.linalg.norm(rows, axis=1), 1.0, atol=1e-12)
    assert np.all(np.sum(rows[1:] * rows[:-1], axis=1) > 0.99)
    angle = 2.0 * np.unwrap(np.arctan2(rows[:, 3], rows[:, 0]))
    turned = angle - angle[0] - 4.0 * (table.time - table.time[0])
    assert np.max(np.abs(turned)) < 1e-5


def test_a_quaternion_in_an_array(tmp_path: Path) -> None:
    """As PX4 writes them: the field ``q`` of four numbers, here every second with the other sign."""
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/vehicle_attitude", "json", 0)
        for n in range(100):
            q = (-1.0) ** n * np.array([math.cos(0.02 * n), 0.0, math.sin(0.02 * n), 0.0])
            writer.add_message(channel, n * 10**7, json.dumps({"q": q.tolist()}).encode(), n)
        writer.finish()
    table = open_log(path).aligned(["/vehicle_attitude"], rate=333.0)
    found = table["/vehicle_attitude.q"]
    expected = np.column_stack([np.cos(2.0 * table.time), np.sin(2.0 * table.time)])
    assert found.shape == (len(table.time), 4) and np.allclose(found[:, [0, 2]], expected, atol=1e-5)


def test_one_part_of_a_quaternion_is_that_of_the_whole(tmp_path: Path) -> None:
    log = open_log(record(tmp_path / "a.mcap", flight(0.5, (topics.ATTITUDE,))))
    whole = log.aligned([topics.ATTITUDE], rate=777.0)
    part = log.aligned(["/attitude/ahrs.quaternion_x"], rate=777.0)
    assert list(part) == ["/attitude/ahrs.quaternion_x"]
    assert np.array_equal(part["/attitude/ahrs.quaternion_x"], whole["/attitude/ahrs.quaternion_x"])


def test_states_and_counts_are_the_last_messages(tmp_path: Path) -> None:
    log = log_of(
        tmp_path,
        topics.NAVIGATION,
        every(50_000, 20),
        lambda t: {"mode": m.Mode.AUTO if t < 0.5 else m.Mode.LAND, "item": round(t * 20)},
    )
    table = log.aligned([topics.NAVIGATION], rate=1000.0, start=0.05)
    assert table["/guidance/navigation.mode"].dtype == np.int64
    changed = table["/guidance/navigation.mode"] == m.Mode.LAND
    assert np.array_equal(changed, table.time >= 0.5 - 1e-9)
    assert np.array_equal(table["/guidance/navigation.item"], np.floor(table.time * 20 + 1e-6))
    assert table.labels["/guidance/navigation.mode"][int(m.Mode.LAND)] == "LAND"


def test_a_missing_whole_number_is_not_zero(tmp_path: Path) -> None:
    log = log_of(tmp_path, topics.NAVIGATION, every(50_000, 20), lambda t: {"item": 3})
    item = log.aligned(["/guidance/navigation.item"], rate=100.0, start=0.0)["/guidance/navigation.item"]
    assert np.isnan(item[:5]).all() and np.all(item[5:] == 3.0)


def test_what_comes_at_a_change_holds_until_the_next(tmp_path: Path) -> None:
    sticks = [
        (topics.PILOT, zero(m.PilotInput)._replace(time_us=t, source=s)) for t, s in ((100_000, 1), (900_000, 3))
    ]
    imu = [(topics.IMU, zero(m.ImuSample)._replace(time_us=t)) for t in every(5_000, 400)]
    log = open_log(record(tmp_path / "a.mcap", sorted(sticks + imu, key=lambda pair: pair[1].time_us)))
    table = log.aligned([topics.IMU, "/inputs/pilot.source"])
    source = table["/inputs/pilot.source"]
    assert np.array_equal(np.isnan(source), table.time < 0.1)
    assert set(source[(table.time >= 0.1) & (table.time < 0.9)]) == {1.0} and set(source[table.time >= 0.9]) == {3.0}


@pytest.mark.parametrize(("gap", "hole"), [(None, True), (0.2, True), (0.4, False)])
def test_nothing_is_known_in_a_gap(tmp_path: Path, gap: float | None, hole: bool) -> None:
    times = [t for t in every(10_000, 200) if not 500_000 < t < 800_000]
    log = log_of(tmp_path, topics.POWER, times, lambda t: {"voltage": t})
    table = log.aligned([topics.POWER], rate=1000.0, gap=gap)
    inside = (table.time > 0.5 + 1e-9) & (table.time < 0.8 - 1e-9)
    for field in ("voltage", "clipped"):
        assert np.array_equal(np.isnan(table[f"/power/state.{field}"]), inside & hole)


def test_times_that_repeat_or_run_backwards(tmp_path: Path) -> None:
    """The file's log time is in order, the messages' own is not: as after a restart or from a slow link."""
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/a", "json", 0)
        for n, (time_us, value) in enumerate([(1, 1.5), (3, 3.5), (2, 2.5), (2, 20.5), (4, 4.5)]):
            writer.add_message(channel, n, json.dumps({"time_us": time_us * 1000, "x": value}).encode(), n)
        writer.finish()
    table = open_log(path).aligned(["/a"])
    assert table.time.tolist() == pytest.approx([0.001, 0.002, 0.003, 0.004])
    assert table["/a.x"].tolist() == [1.5, 20.5, 3.5, 4.5]


def test_texts_and_nested_fields_and_topics_with_dots(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        one = writer.register_channel("/a.b", "json", 0)
        two = writer.register_channel("/a", "json", 0)
        for n in range(10):
            document = {"b": {"c": n + 0.5}, "name": f"n{n}", "on": n > 4}
            writer.add_message(one, n * 10**8, json.dumps(document).encode(), n)
            writer.add_message(two, n * 10**8 + 10**7, json.dumps({"x": n}).encode(), n)
        writer.finish()
    table = open_log(path).aligned(["/a.x", "/a.b.b.c", "/a.b.name", "/a.b.on"], end=0.85)
    assert table["/a.b.b.c"].tolist() == pytest.approx([n + 0.6 for n in range(9)])
    assert table["/a.b.name"].tolist() == [f"n{n}" for n in range(9)]
    assert table["/a.b.on"].tolist() == [n > 4 for n in range(9)]


def test_a_window_uses_the_messages_beside_it(tmp_path: Path) -> None:
    log = log_of(tmp_path, topics.GPS, every(200_000, 20), lambda t: {"altitude": 10.0 * t})
    table = log.aligned(["/sensors/gps.altitude"], rate=100.0, start=1.05, end=1.15)
    assert table.time == pytest.approx(1.05 + 0.01 * np.arange(10))
    assert table["/sensors/gps.altitude"] == pytest.approx(10.0 * table.time)


def test_the_times_of_two_tables_of_one_rate_agree(tmp_path: Path) -> None:
    log = open_log(record(tmp_path / "a.mcap", flight(1.0, (topics.IMU, topics.ADC))))
    whole, part = log.aligned([topics.IMU], 300.0), log.aligned([topics.ADC], 300.0, 0.41, 0.72)
    assert np.isin(part.log_time_ns, whole.log_time_ns).all() and len(part.time) == 93
    assert part["/sensors/adc.voltage_counts"].shape == (93, 60)


def test_a_topic_without_a_message_is_unknown_everywhere(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    layout = layout_of(m.DriveTorque)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(layout.name, "protobuf", descriptor_set(layout))
        one, _ = (writer.register_channel(name, "protobuf", schema) for name in ("/one", "/none"))
        for n in range(5):
            writer.add_message(one, n, layout.encode(m.DriveTorque(n * 10_000, 1.0, 2.0)), n)
        writer.finish()
    table = open_log(path).aligned(["/one.left", "/none.left"], rate=100.0)
    assert table["/one.left"].tolist() == [1.0] * 5 and np.isnan(table["/none.left"]).all()
    assert len(open_log(path).aligned(["/none", "/one"]).time) == 0
    assert len(open_log(path).aligned(["/one"], start=5.0, end=4.0).time) == 0


@pytest.mark.parametrize(
    ("requested_topics", "options", "part"),
    [
        ([], {}, "no topic to align"),
        (["/nowhere"], {}, "no topic /nowhere; it has: /sensors/imu"),
        (["/sensors/imu.volume"], {}, "/sensors/imu has no field volume; it has: time_us, accel_x"),
        (["/sensors/imu"], {"rate": 0.0}, "the rate of a table must be above 0, not 0"),
        (["/sensors/imu"], {"rate": math.nan}, "the rate of a table must be above 0, not nan"),
        (["/sensors/imu"], {"gap": -1.0}, "the longest gap of a table must be above 0"),
        (["/sensors/imu"], {"rate": 1e-300}, "the rate of a table must be at least 1e-06 Hz, not 1e-300"),
        (["/sensors/imu"], {"rate": 5.0, "end": 1e300}, "5 Hz over 4.6.*e[+]09 s are .* rows"),
        (["/sensors/imu"], {"rate": 5.0, "start": math.nan}, "nan s is no time"),
        (["/sensors/imu"], {"rate": 1e12}, "1e[+]12 Hz over 0.49.* s are 4.9.*e[+]11 rows"),
    ],
)
def test_what_cannot_be_aligned_is_one_line(
    tmp_path: Path, requested_topics: list[str], options: dict[str, float], part: str
) -> None:
    log = open_log(record(tmp_path / "a.mcap", flight(0.5, (topics.IMU,))))
    with pytest.raises(InputError, match=part):
        log.aligned(requested_topics, **options)
