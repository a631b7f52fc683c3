"""Tables of columns with a mapping: units, rates, empty cells, and what cannot be meant."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from foreign_logs import DATA, ROOT, imported

from avionics import topics
from groundstation.command.identify import UNKNOWN, identified
from logs.identification.models.modes import short_period_of
from logs.identification.report import identify
from logs.identification.sources.topic_table import ElevatorFromField
from logs.importing.csv_table import parse_table
from logs.importing.log_import import NOTES
from logs.importing.mapping import EXAMPLE, TableSection, load_mapping
from logs.importing.units import CONVERSIONS, LIMITS, conversion, limits_in
from logs.reader import open_log
from wingbeat.errors import InputError

sys.path.append(str(ROOT / "tests" / "logs" / "identification"))
from linear_ornithopter import AIRCRAFT, Flight, fly, model_of
from wing_drives import K_TAU, K_TAU0, Drives, measure, simulate

EXAMPLE_TABLE = "t,Q,Ax,F,note\n1200,90,0,100,a\n1210,-90,1,100,b\n1230,0,0.5,200,c\n"


def mapped(folder: Path, table: str, mapping: str) -> tuple[Path, Path]:
    source, chosen = folder / "table.csv", folder / "map.toml"
    source.write_text(table)
    chosen.write_text(mapping)
    return source, chosen


def test_the_example_in_the_help_imports_the_table_that_it_speaks_of(tmp_path: Path) -> None:
    source, mapping = mapped(tmp_path, EXAMPLE_TABLE, EXAMPLE)
    out, report = imported(source, tmp_path, mapping=mapping)
    assert report.dropped == ()
    with open_log(out) as log:
        imu, cell = log.columns(topics.IMU), log.columns("/csv/load_cell")
        assert imu["time_us"].tolist() == [0, 10_000, 30_000]
        assert imu["gyro_y"] == pytest.approx([math.pi / 2, -math.pi / 2, 0.0])
        assert imu["accel_x"] == pytest.approx([0.02 * 9.80665, -0.98 * 9.80665, -0.48 * 9.80665])
        assert set(imu["accel_z"]) == {-9.81} and np.isnan(imu["gyro_x"]).all()
        assert cell.units["thrust"] == "N" and cell["thrust"] == pytest.approx([0.0980665 * 10, 0.1961330 * 10])
        assert cell["time_us"].tolist() == [0, 30_000]  # 50 Hz: one row every 20 ms
        assert log.metadata[NOTES]["columns_not_mapped"] == "note"


def test_the_fixed_wing_record_opens_like_a_flown_log(tmp_path: Path) -> None:
    out, report = imported(DATA / "fixedwing_model.csv", tmp_path, mapping=DATA / "fixedwing_model.toml")
    assert report.dropped == () and report.damage == ()
    with open_log(out) as log:
        imu, attitude, command = (log.columns(t) for t in (topics.IMU, topics.ATTITUDE, topics.ACTUATORS))
        assert log.topics["/sensors/imu"].rate == pytest.approx(33.3) and log.duration == pytest.approx(60.0, abs=0.1)
        assert attitude["pitch"][0] == pytest.approx(2.0 * math.asin(0.18856), abs=1e-3)
        rate = np.gradient(attitude["pitch"], attitude.time)
        assert np.corrcoef(rate, imu["gyro_y"])[0, 1] > 0.99
        assert np.ptp(command["elevator"]) > 0.05 and command.units["elevator"] == "rad"
        assert set(command["armed"]) == {1}


def test_cells_left_empty_are_of_another_rate_and_no_loss(tmp_path: Path) -> None:
    """GIVEN a stand that samples force twice as often as voltage THEN each topic has its own rows."""
    table = "t,V,T\n0,7.4,1\n1,,2\n2,7.3,3\n3,,nan\n"
    mapping = (
        '[time]\ncolumn = "t"\n[topics."/power/state"]\nvoltage = { column = "V", unit = "V" }\n'
        '[topics."/main/drive_torque"]\nleft = { column = "T", unit = "mN m" }\n'
    )
    source, chosen = mapped(tmp_path, table, mapping)
    out, report = imported(source, tmp_path, mapping=chosen)
    assert report.dropped == ()
    with open_log(out) as log:
        assert log.columns(topics.POWER).time.tolist() == [0.0, 2.0]
        assert log.columns(topics.DRIVE_TORQUE)["left"].tolist() == [0.001, 0.002, 0.003]


def test_a_load_cell_stand_gives_the_torque_constant_that_its_drives_have(tmp_path: Path) -> None:
    """An imported stand goes into identification as a flown log does: the truth lies in the 95 % interval."""
    data = measure(simulate(Drives(duration=25.0)), Drives(duration=25.0))
    step = data.wing_time[1] - data.wing_time[0]
    angles = [np.degrees(np.cumsum(rate) * step) for rate in (data.rate_left, data.rate_right)]
    phase = np.degrees(2.0 * np.pi * (data.strokes % 1.0))
    slow = {
        "I": (data.power_time, data.current * 1e3),
        "U": (data.power_time, data.voltage),
        "L": (data.torque_time, data.torque_left * 1e3),
        "R": (data.torque_time, data.torque_right * 1e3),
    }
    cells = {
        name: dict(zip(np.round(at * 1e3, 3).tolist(), v.tolist(), strict=True)) for name, (at, v) in slow.items()
    }
    fast = zip(np.round(data.wing_time * 1e3, 3).tolist(), phase, *angles, strict=True)
    rows = {at: [f"{value:.9g}" for value in values] for at, *values in fast}
    times = sorted({*rows, *(at for column in cells.values() for at in column)})
    lines = ["ms;phase;left;right;I;U;L;R"]
    for at in times:
        told = [f"{column[at]:.9g}" if at in column else "" for column in cells.values()]
        lines.append(";".join([f"{at:.3f}", *rows.get(at, ["", "", ""]), *told]))
    mapping = """
[time]
column = "ms"
unit = "ms"
[table]
delimiter = ";"
[topics."/main/wing"]
phase = { column = "phase", unit = "deg" }
angle_left = { column = "left", unit = "deg" }
angle_right = { column = "right", unit = "deg" }
[topics."/main/drive_torque"]
left = { column = "L", unit = "mN m" }
right = { column = "R", unit = "mN m" }
[topics."/power/state"]
current = { column = "I", unit = "mA" }
voltage = { column = "U", unit = "V" }
"""
    source, chosen = mapped(tmp_path, "\n".join(lines), mapping)
    out, _ = imported(source, tmp_path, mapping=chosen)
    with open_log(out) as log:
        found = identify(log, "servo")
    assert found.torque is not None
    estimates = {estimate.name: estimate for estimate in found.torque.estimates}
    assert estimates["K_tau"].contains(K_TAU) and estimates["K_tau0"].contains(K_TAU0)


FLIGHT_MAPPING = """
[time]
column = "t"
[topics."/sensors/imu"]
gyro_y = { column = "pitch_rate", unit = "deg/s" }
accel_x = { column = "accel_x", unit = "g" }
accel_z = { column = "accel_z", unit = "g" }
gyro_x = { column = "roll_rate", unit = "deg/s" }
gyro_z = { column = "yaw_rate", unit = "deg/s" }
accel_y = { column = "accel_y", unit = "g" }
[topics."/attitude/ahrs"]
pitch = { column = "pitch", unit = "deg" }
roll = { column = "roll", unit = "deg" }
[topics."/main/air_data"]
airspeed = { column = "airspeed", unit = "km/h" }
[topics."/main/altitude"]
climb_rate = { column = "climb_rate", unit = "m/s" }
[topics."/mixing/actuators"]
elevator = { column = "elevator", unit = "deg" }
[topics."/main/wing"]
phase = { column = "phase", unit = "rev" }
angle_left = { value = 0.0, unit = "rad" }
angle_right = { value = 0.0, unit = "rad" }
[topics."/guidance/excitation"]
active = { column = "active" }
manoeuvre = { column = "manoeuvre" }
elevator = { column = "excitation", unit = "deg" }
aborted = { column = "aborted" }
"""


def without(*removed_topics: str) -> str:
    """The mapping without some of its topics."""
    first, *sections = FLIGHT_MAPPING.split("[topics.")
    return "[topics.".join([first, *(part for part in sections if part.split('"')[1] not in removed_topics)])


def flight_as_table(folder: Path, mapping: str, flight: Flight) -> Path:
    """A flight as a table with degrees, g and km/h, imported by its mapping."""
    data = fly(flight)
    columns = {
        "t": data.time,
        "pitch_rate": np.degrees(data.pitch_rate),
        "accel_x": data.accel_x / 9.80665,
        "accel_z": data.accel_z / 9.80665,
        "pitch": np.degrees(data.pitch),
        **dict.fromkeys(("roll", "roll_rate", "yaw_rate", "accel_y"), np.zeros(len(data.time))),
        "airspeed": data.airspeed * 3.6,
        "climb_rate": data.climb_rate,
        "elevator": np.degrees(data.elevator),
        "phase": data.strokes % 1.0,
        "active": data.active,
        "manoeuvre": data.manoeuvre,
        "excitation": np.degrees(data.excitation),
        "aborted": data.aborted,
    }
    lines = [",".join(columns)]
    lines += [",".join(f"{value:.12g}" for value in row) for row in zip(*columns.values(), strict=True)]
    source, chosen = mapped(folder, "\n".join(lines), mapping)
    out, report = imported(source, folder, mapping=chosen)
    assert report.dropped == ()
    return out


@pytest.mark.parametrize(
    ("mapping", "doublets", "notes"),
    [
        (FLIGHT_MAPPING, 2, []),
        pytest.param(without("/guidance/excitation"), 4, ["manoeuvres"], marks=pytest.mark.validate),
        pytest.param(
            without("/guidance/excitation", "/main/wing"), 4, ["manoeuvres", "strokes"], marks=pytest.mark.validate
        ),
    ],
    ids=["whole", "without excitation", "without excitation and wing"],
)
def test_a_flapping_flight_from_a_table_gives_the_mode_that_it_has(
    tmp_path: Path, mapping: str, doublets: int, notes: list[str]
) -> None:
    """The true short period lies in the interval of every method; the two with a physical model must give one."""
    flight = Flight(doublets=doublets)
    with open_log(flight_as_table(tmp_path, mapping, flight)) as log:
        found = identify(log, "modes", AIRCRAFT).modes
    frequency, damping = short_period_of(model_of(flight).a)
    assert found is not None and [note.partition(":")[0] for note in found.notes] == notes
    assert all(mode.frequency is not None for mode in found.modes[:2])
    for mode in (mode for mode in found.modes if mode.short_period is not None):
        assert mode.frequency.contains(frequency)
        assert mode.damping.contains(damping)


def test_an_imported_log_does_not_tell_its_aircraft_and_the_report_says_so(tmp_path: Path) -> None:
    """GIVEN a log without a vehicle's file THEN --vehicle tells where the IMU is, and what is assumed is told."""
    with open_log(flight_as_table(tmp_path, FLIGHT_MAPPING, Flight(doublets=2))) as log:
        assumed, told = identified(log, "modes").modes, identified(log, "modes", "robo_raven_ii_d").modes
    assert assumed is not None and told is not None
    assert assumed.notes == (UNKNOWN,) and told.notes == ()
    found = [{derivative.name for derivative in modes.modes[0].derivatives} for modes in (assumed, told)]
    assert found[0] - found[1] == {"tail_time_constant"}


PULSE_MAPPING = (
    without("/guidance/excitation", "/mixing/actuators")
    + """
[topics."/csv/servos"]
pulse = { column = "elevator", scale = 10.0, offset = 1500.0 }
"""
)


def test_the_elevator_can_be_made_of_a_pulse_width(tmp_path: Path) -> None:
    """GIVEN a servo's pulses alone THEN a scale makes an angle of them, and one that is wrong gives the same mode."""
    flight = Flight(doublets=4)
    per_unit = math.radians(0.1)  # ten microseconds a degree
    with open_log(flight_as_table(tmp_path, PULSE_MAPPING, flight)) as log:
        with pytest.raises(InputError, match="--elevator makes it"):
            identify(log, "modes", AIRCRAFT)
        right, wrong = (
            identify(
                ElevatorFromField(log, "/csv/servos", "pulse", per_unit * factor),
                "modes",
                AIRCRAFT,
                method="output_error",
            ).modes
            for factor in (1.0, 2.0)
        )
        noted = identified(log, "modes", "robo_raven_ii_d", ("/csv/servos.pulse", str(per_unit))).modes
    assert right is not None and wrong is not None and noted is not None
    assert noted.notes[-1].startswith("elevator: /csv/servos.pulse at 0.00174")
    one, other = right.modes[0], wrong.modes[0]
    assert one.frequency is not None and other.frequency is not None
    assert one.frequency.contains(short_period_of(model_of(flight).a)[0])
    assert other.frequency.value == pytest.approx(one.frequency.value, rel=1e-3)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("/csv/servos.pulse", "much"), "rad per unit"),
        (("/csv/servos.pulse", "0"), "rad per unit"),
        (("pulse", "1"), "TOPIC.FIELD"),
        (("/csv/servos.width", "1"), "no number width; it has: time_us, pulse"),
        (("/csv/servo.pulse", "1"), r"has no topic /csv/servo \(meant '/csv/servos'\?\); it has"),
    ],
)
def test_an_elevator_that_cannot_be_made_is_told_in_one_line(
    tmp_path: Path, words: tuple[str, str], reason: str
) -> None:
    out = flight_as_table(tmp_path, PULSE_MAPPING, Flight(doublets=1))
    with open_log(out) as log, pytest.raises(InputError, match=reason) as raised:
        identified(log, "modes", None, words)
    assert "\n" not in str(raised.value)


def test_a_real_record_without_an_input_says_what_it_lacks(tmp_path: Path) -> None:
    """The fixed-wing record has neither wings that flap nor an elevator that moves quickly."""
    out, _ = imported(DATA / "fixedwing_model.csv", tmp_path, mapping=DATA / "fixedwing_model.toml")
    with open_log(out) as log, pytest.raises(InputError, match="/main/altitude") as raised:
        identify(log, "modes")
    assert "\n" not in str(raised.value)


def test_cells_that_are_no_number_and_rows_out_of_range_are_told(tmp_path: Path) -> None:
    table = "Q,Ax\n1,0\n99999,0\noops,0\n2,\n"
    mapping = (
        '[time]\nrate = 10.0\n[topics."/sensors/imu"]\n'
        'gyro_y = { column = "Q", unit = "deg/s" }\naccel_x = { column = "Ax", unit = "g" }\n'
    )
    source, chosen = mapped(tmp_path, table, mapping)
    out, report = imported(source, tmp_path, mapping=chosen)
    assert report.damage == ("1 cell without a number",)
    assert {(one.reason, one.rows) for one in report.dropped} == {
        ("gyro_y out of range", 1),
        ("gyro_y not finite", 1),
        ("accel_x not finite", 1),
    }
    with open_log(out) as log:
        assert log.columns(topics.IMU).time.tolist() == [0.0]


WHOLE = '[time]\nrate = 10.0\n[topics."/sensors/imu"]\ngyro_y = { column = "Q", unit = "deg/s" }\n'


@pytest.mark.parametrize(
    ("mapping", "reason"),
    [
        ("nonsense", "not valid TOML"),
        ("[time]\nrate = 1.0\n", "no topic in it"),
        (WHOLE.replace("rate = 10.0", ""), "either a column or a rate"),
        (WHOLE.replace("rate = 10.0", "rate = -1.0"), "above 0"),
        (WHOLE.replace("rate = 10.0", 'column = "Q"\nunit = "m"'), "not a unit of time"),
        (WHOLE.replace("[time]", "[times]"), r"unknown key times"),
        (WHOLE.replace("rate = 10.0", "rate = 10.0\nzero = 1"), "unknown key time.zero"),
        (WHOLE.replace('"Q"', '"P"'), "no column 'P'; it has: Q"),
        (WHOLE.replace("gyro_y", "gyro_q"), "no such field; it has: accel_x"),
        (WHOLE.replace("deg/s", "deg"), "gyro_y is in rad/s; a column in 'deg' cannot be that"),
        (WHOLE.replace("deg/s", "furlong"), "unit 'furlong' is not known; known: "),
        (WHOLE.replace("/sensors/imu", "/sensors/nose"), "topic /sensors/nose is not known"),
        (WHOLE.replace('unit = "deg/s"', 'unit = "deg/s", gain = 2'), "unknown key topics./sensors/imu.gyro_y.gain"),
        (WHOLE.replace('unit = "deg/s"', 'unit = "deg/s", scale = "two"'), "must be a number"),
        (WHOLE.replace('{ column = "Q", unit = "deg/s" }', "3"), "must be { column"),
        (WHOLE + "rate = 0\n", "topics./sensors/imu.rate = 0 must be above 0 Hz"),
        (WHOLE.replace('"deg/s"', '["s"]'), r"unit \['s'\] is not known; known: "),
        (WHOLE.replace('"Q"', '["F"]'), r"no column \['F'\]; it has: Q"),
        (WHOLE.replace("rate = 10.0", 'column = ["t"]'), r"no column \['t'\]; it has: Q"),
        (WHOLE.replace("rate = 10.0", "rate = 1" + 400 * "0"), "an integer has more than 64 bits"),
        (WHOLE.replace("rate = 10.0", "rate = 1e400"), "time.rate must be a finite number"),
        (WHOLE.replace("rate = 10.0", "rate = " + 10_000 * "["), "not valid TOML"),
        (WHOLE + 'rate = { column = "Q" }\n', "rate: the topic has no such field"),
    ],
)
def test_a_mapping_that_cannot_be_meant_is_refused_in_one_line(tmp_path: Path, mapping: str, reason: str) -> None:
    source, chosen = mapped(tmp_path, "Q\n1\n2\n", mapping)
    with pytest.raises(InputError, match=reason) as error:
        imported(source, tmp_path, mapping=chosen)
    assert "\n" not in str(error.value)
    assert sorted(tmp_path.iterdir()) == sorted((source, chosen))


def test_a_table_without_a_mapping_or_without_rows_is_refused(tmp_path: Path) -> None:
    source, chosen = mapped(tmp_path, "Q\n", WHOLE)
    with pytest.raises(InputError, match="no row of numbers"):
        imported(source, tmp_path, mapping=chosen)
    with pytest.raises(InputError, match="needs --map"):
        imported(source, tmp_path)
    source.write_bytes(b"\xff\xfe\0Q")
    with pytest.raises(InputError, match="not text in UTF-8"):
        imported(source, tmp_path, mapping=chosen)
    with pytest.raises(InputError, match="cannot read mapping"):
        load_mapping(tmp_path / "none.toml")


def test_units_agree_with_each_other() -> None:
    assert conversion("Wh").factor == 3600.0 and conversion("mAh").factor == pytest.approx(3.6)
    assert conversion("rpm").factor == pytest.approx(1.0 / 60.0) and conversion("kn").factor == pytest.approx(
        0.5144, abs=1e-4
    )
    for name, known in CONVERSIONS.items():
        limits = limits_in(name)
        if known.unit in LIMITS:
            assert limits is not None
            back = tuple(value * known.factor + known.offset for value in limits)
            assert back == pytest.approx(LIMITS[known.unit])


def test_rows_that_are_short_of_cells_are_told(tmp_path: Path) -> None:
    table = "t,F,note\n0,1,a\n0.1,2,b\n0.2\n0.3,4\n0.4,5,c\n"
    mapping = '[time]\ncolumn = "t"\n[topics."/csv/cell"]\nthrust = { column = "F", unit = "N" }\n'
    source, chosen = mapped(tmp_path, table, mapping)
    out, report = imported(source, tmp_path, mapping=chosen)
    assert "2 rows with fewer cells than there are names of columns" in report.damage
    with open_log(out) as log:
        assert log.columns("/csv/cell")["thrust"].tolist() == [1.0, 2.0, 4.0, 5.0]


def test_a_table_of_another_encoding_says_which(tmp_path: Path) -> None:
    table, mapping = mapped(
        tmp_path, "", '[time]\ncolumn = "t"\n[topics."/csv/a"]\npitch = { column = "pitch °", unit = "deg" }\n'
    )
    table.write_bytes("t,pitch °\n0,90\n1,45\n".encode("latin-1"))
    with pytest.raises(InputError, match=r'not text in UTF-8: set \[table\] encoding = "latin-1"'):
        imported(table, tmp_path, mapping=mapping)
    text = mapping.read_text()
    for encoding in ("elvish", "hex"):
        mapping.write_text(f'{text}[table]\nencoding = "{encoding}"\n')
        with pytest.raises(InputError, match=f"encoding '{encoding}' is not known"):
            imported(table, tmp_path, mapping=mapping)
    mapping.write_text(f'{text}[table]\nencoding = "latin-1"\n')
    with open_log(imported(table, tmp_path, mapping=mapping)[0]) as log:
        assert log.columns("/csv/a")["pitch"] == pytest.approx([math.pi / 2, math.pi / 4])


def test_of_two_columns_of_one_name_none_is_meant(tmp_path: Path) -> None:
    """Beside them the table is read."""
    mapping = '[time]\ncolumn = "t"\n[topics."/csv/stand"]\nforce = { column = "F", unit = "N" }\n'
    source, chosen = mapped(tmp_path, "t,F,F\n0,1,2\n1,3,4\n", mapping)
    with pytest.raises(InputError, match="several columns 'F'"):
        imported(source, tmp_path, mapping=chosen)
    source.write_text("t,F,G,G\n0,1,2,3\n1,3,4,5\n")
    out, _ = imported(source, tmp_path, mapping=chosen)
    with open_log(out) as log:
        assert log.columns("/csv/stand")["force"].tolist() == [1.0, 3.0]


def test_a_field_may_be_called_rate(tmp_path: Path) -> None:
    mapping = '[time]\ncolumn = "t"\n[topics."/csv/stand"]\nrate = { column = "f", unit = "rpm" }\n'
    source, chosen = mapped(tmp_path, "t,f\n0,60\n1,120\n", mapping)
    out, _ = imported(source, tmp_path, mapping=chosen)
    with open_log(out) as log:
        assert log.columns("/csv/stand")["rate"].tolist() == [1.0, 2.0]


def test_a_table_of_blanks_without_names_and_with_fortran_s_exponents() -> None:
    read = parse_table(b" 0.0  1.0D+02\n 1.0   2.5d-1 \n", TableSection(delimiter="whitespace", names=False))
    assert {name: column.tolist() for name, column in read.columns.items()} == {"1": [0.0, 1.0], "2": [100.0, 0.25]}
