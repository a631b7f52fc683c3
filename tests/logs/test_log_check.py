"""`wingbeat log check`: planted faults are found with topic and time, clean flights have none."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import wingbeat
from groundstation.command.main import dispatch
from logs.checks.findings import CODES, SEVERITIES, Finding
from logs.checks.log_data import of_source
from logs.checks.run import check, check_log
from logs.importing.source import Series, Source
from wingbeat.errors import InputError

Columns = dict[str, NDArray[Any]]
Tables = dict[str, tuple[NDArray[np.int64], Columns]]
"""time in us and columns by topic, as PX4 logs them"""


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Tables:
    """Return a clean flight of 45 s in the topics of PX4."""
    path = tmp_path_factory.mktemp("check") / "flight.mcap"
    log = wingbeat.fly("arizona_100cm", duration=45.0, log=path).log
    imu, attitude, air = log["/sensors/imu"], log["/attitude/ahrs"], log["/main/air_data"]
    position, power, wing = log["/main/position"], log["/power/state"], log["/main/wing"]
    actuators, gps = log["/mixing/actuators"], log["/sensors/gps"]
    altitude = log["/main/altitude"]

    def of(columns: Any, every: int, **fields: Any) -> tuple[NDArray[np.int64], Columns]:
        stamps = np.round(columns.time * 1e6).astype(np.int64)[::every]
        return stamps, {name: np.asarray(values)[::every] for name, values in fields.items()}

    def rows(columns: Any, *names: str) -> NDArray[np.float64]:
        return np.column_stack([columns[name] for name in names])

    axes = [f"{name}_{axis}" for name in ("gyro", "accel", "mag") for axis in "xyz"]
    return {
        "sensor_combined": of(imu, 1, gyro_rad=rows(imu, *axes[:3]), accelerometer_m_s2=rows(imu, *axes[3:6])),
        "vehicle_magnetometer": of(imu, 4, magnetometer_ga=rows(imu, *axes[6:])),
        "vehicle_attitude": of(attitude, 2, q=rows(attitude, *(f"quaternion_{axis}" for axis in "wxyz"))),
        "airspeed": of(air, 1, true_airspeed_m_s=air["airspeed"], indicated_airspeed_m_s=air["airspeed"]),
        "vehicle_local_position": of(
            position, 1, x=position["north"], y=position["east"], z=-altitude["altitude"][: len(position.time)],
            vx=position["v_north"], vy=position["v_east"], vz=-altitude["climb_rate"][: len(position.time)],
        ),
        "battery_status": of(power, 20, voltage_v=power["voltage"], current_a=power["current"]),
        "flap_frequency": of(wing, 10, frequency_hz=wing["frequency"]),
        "actuator_servos": of(actuators, 4, control=rows(actuators, "elevator", "rudder") / 0.6),
        "actuator_motors": of(actuators, 4, control=rows(actuators, "throttle")),
        "vehicle_gps_position": of(
            gps, 1, latitude_deg=np.degrees(gps["latitude"]), longitude_deg=np.degrees(gps["longitude"]),
            altitude_msl_m=gps["altitude"], vel_n_m_s=gps["v_north"], vel_e_m_s=gps["v_east"],
            vel_d_m_s=gps["v_down"], fix_type=gps["fix_type"], satellites_used=gps["satellites"],
        ),
    }  # fmt: skip


def findings(tables: Tables) -> list[Finding]:
    """Check tables as an imported ULog."""
    series = {name: Series(name, stamps, columns, {}) for name, (stamps, columns) in tables.items()}
    return [one for one in check(of_source("flight.ulg", Source("ulog", series))).findings if one.severity != "info"]


def changed(tables: Tables, topic: str, column: str, change: Callable[[NDArray[Any], NDArray[Any]], Any]) -> Tables:
    """Return the tables with one column changed by a function of time in s and values."""
    stamps, columns = tables[topic]
    values = change(stamps * 1e-6, np.array(columns[column], float))
    return tables | {topic: (stamps, columns | {column: values})}


def begin(tables: Tables) -> float:
    """Return the time of the first message in s."""
    return float(min(stamps[0] for stamps, _ in tables.values())) * 1e-6


def after(time: NDArray[Any], at: float, values: NDArray[Any], change: NDArray[Any]) -> NDArray[Any]:
    """Return ``change`` from a time on."""
    return np.where((time >= at)[:, None] if values.ndim == 2 else time >= at, change, values)


def plant_gap(tables: Tables, at: float) -> tuple[Tables, str, str]:
    stamps, columns = tables["airspeed"]
    kept = (stamps < at * 1e6) | (stamps > (at + 0.7) * 1e6)
    return tables | {"airspeed": (stamps[kept], {k: v[kept] for k, v in columns.items()})}, "gap", "airspeed"


def plant_rate_change(tables: Tables, at: float) -> tuple[Tables, str, str]:
    stamps, columns = tables["vehicle_attitude"]
    kept = (stamps < at * 1e6) | (np.arange(len(stamps)) % 2 == 0)
    changed_topic = stamps[kept], {k: v[kept] for k, v in columns.items()}
    return tables | {"vehicle_attitude": changed_topic}, "rate_change", "vehicle_attitude"


def plant_backwards(tables: Tables, at: float) -> tuple[Tables, str, str]:
    stamps, columns = tables["sensor_combined"]
    first = int(np.searchsorted(stamps, at * 1e6))
    stamps = stamps.copy()
    stamps[first : first + 20 : 2] -= 12_000
    return tables | {"sensor_combined": (stamps, columns)}, "time_backwards", "sensor_combined"


def plant_repeated(tables: Tables, at: float) -> tuple[Tables, str, str]:
    stamps, columns = tables["vehicle_local_position"]
    first = int(np.searchsorted(stamps, at * 1e6))
    stamps = stamps.copy()
    stamps[first + 1 : first + 13 : 2] = stamps[first : first + 12 : 2]
    return tables | {"vehicle_local_position": (stamps, columns)}, "time_repeated", "vehicle_local_position"


def plant_skew(tables: Tables, at: float) -> tuple[Tables, str, str]:
    stamps, columns = tables["vehicle_attitude"]
    return tables | {"vehicle_attitude": (stamps + 30_000, columns)}, "time_skew", "vehicle_attitude"


def plant_clipping(tables: Tables, at: float) -> tuple[Tables, str, str]:
    def clip(time: NDArray[Any], values: NDArray[Any]) -> NDArray[Any]:
        near = (time >= at) & (time < at + 2.0)
        low = np.percentile(values[near, 2], 25.0)
        values[near, 2] = np.maximum(values[near, 2], low)
        values[~near, 2] = np.clip(values[~near, 2], low + 1.0, None)
        return values

    return changed(tables, "sensor_combined", "accelerometer_m_s2", clip), "clipping", "sensor_combined"


def plant_frozen(tables: Tables, at: float) -> tuple[Tables, str, str]:
    def freeze(time: NDArray[Any], values: NDArray[Any]) -> NDArray[Any]:
        near = (time >= at) & (time < at + 3.0)
        values[near] = values[int(np.flatnonzero(near)[0])]
        return values

    tables = changed(tables, "airspeed", "indicated_airspeed_m_s", freeze)
    return changed(tables, "airspeed", "true_airspeed_m_s", freeze), "frozen", "airspeed"


def plant_ratio(tables: Tables, at: float) -> tuple[Tables, str, str]:
    def scale(time: NDArray[Any], values: NDArray[Any]) -> NDArray[Any]:
        return values * 8.0 / 7.5

    return changed(tables, "flap_frequency", "frequency_hz", scale), "rate_mismatch_flapping", "flap_frequency"


def plant_current(tables: Tables, at: float) -> tuple[Tables, str, str]:
    return changed(tables, "battery_status", "current_a", lambda _, i: i + 3.0), "current_offset", "battery_status"


def plant_gyro_offset(tables: Tables, at: float) -> tuple[Tables, str, str]:
    offset = np.array((0.0, 0.08, 0.0))
    return changed(tables, "sensor_combined", "gyro_rad", lambda _, w: w + offset), "gyro_offset", "sensor_combined"


def plant_bias_step(tables: Tables, at: float) -> tuple[Tables, str, str]:
    step = np.array((0.0, 0.0, 0.12))
    planted = changed(tables, "sensor_combined", "gyro_rad", lambda t, w: after(t, at, w, w + step))
    return planted, "bias_step", "sensor_combined"


def plant_sign(tables: Tables, at: float) -> tuple[Tables, str, str]:
    signs = np.array((1.0, -1.0, 1.0))
    return changed(tables, "sensor_combined", "gyro_rad", lambda _, w: w * signs), "sign", "sensor_combined"


def plant_unit(tables: Tables, at: float) -> tuple[Tables, str, str]:
    return changed(tables, "sensor_combined", "gyro_rad", lambda _, w: np.degrees(w)), "unit", "sensor_combined"


def plant_interference(tables: Tables, at: float) -> tuple[Tables, str, str]:
    stamps, power = tables["battery_status"]

    def disturb(time: NDArray[Any], values: NDArray[Any]) -> NDArray[Any]:
        current = np.interp(time, stamps * 1e-6, power["current_a"])
        return values + np.outer(current, (0.0, 0.01, 0.03))

    return (
        changed(tables, "vehicle_magnetometer", "magnetometer_ga", disturb),
        "magnetic_interference",
        "sensor_combined",
    )


def plant_jump(tables: Tables, at: float) -> tuple[Tables, str, str]:
    planted = changed(tables, "vehicle_local_position", "x", lambda t, x: after(t, at, x, x + 12.0))
    return planted, "position_jump", "vehicle_local_position"


def plant_saturation(tables: Tables, at: float) -> tuple[Tables, str, str]:
    def keep_at_limit(time: NDArray[Any], values: NDArray[Any]) -> NDArray[Any]:
        values[(time >= at) & (time < at + 2.5), 0] = 1.0
        return values

    return changed(tables, "actuator_servos", "control", keep_at_limit), "saturation", "actuator_servos"


def plant_vibration(tables: Tables, at: float) -> tuple[Tables, str, str]:
    noise = np.random.default_rng(1)

    def shake(time: NDArray[Any], values: NDArray[Any]) -> NDArray[Any]:
        return after(time, at, values, values + noise.normal(0.0, 8.0, values.shape))

    return changed(tables, "sensor_combined", "accelerometer_m_s2", shake), "vibration", "sensor_combined"


def plant_sag(tables: Tables, at: float) -> tuple[Tables, str, str]:
    def sag(time: NDArray[Any], values: NDArray[Any]) -> NDArray[Any]:
        return np.where((time >= at) & (time < at + 2.0), 0.7 * values, values)

    return changed(tables, "battery_status", "voltage_v", sag), "battery_sag", "battery_status"


PLANTS = [value for name, value in sorted(globals().items()) if name.startswith("plant_")]
LOCAL = {
    "gap", "rate_change", "time_backwards", "time_repeated", "frozen", "bias_step", "position_jump", "saturation",
    "battery_sag", "clipping",
}  # fmt: skip
"""codes of faults with a beginning"""


def test_a_clean_flight_has_no_error_and_no_warning(flight: Tables) -> None:
    """GIVEN a clean flight WHEN checked THEN there is nothing to tell."""
    assert findings(flight) == []


@pytest.mark.parametrize(
    "at", [pytest.param(21.3, marks=pytest.mark.validate), 27.9, pytest.param(33.6, marks=pytest.mark.validate)]
)
@pytest.mark.parametrize("plant", PLANTS, ids=[plant.__name__ for plant in PLANTS])
def test_a_planted_fault_is_found(
    flight: Tables, plant: Callable[[Tables, float], tuple[Tables, str, str]], at: float
) -> None:
    """GIVEN one fault WHEN checked THEN its code, topic and time, and at most one other finding."""
    tables, code, topic = plant(flight, at)
    found = findings(tables)
    match = [one for one in found if (one.code, one.topic) == (code, topic)]
    assert match, found
    if code in LOCAL:
        assert min(abs(one.start - (at - begin(tables))) for one in match) < 0.5, match
    assert len({one.code for one in found} - {code}) <= 1, found


def test_a_wing_that_was_never_valid(flight: Tables) -> None:
    """GIVEN a wing phase whose flag is never set WHEN checked THEN it is named."""
    stamps = flight["flap_frequency"][0]
    phase = {"phase": np.zeros(len(stamps)), "valid": np.zeros(len(stamps), np.uint8)}
    (found,) = findings(flight | {"wing_phase": (stamps, phase)})
    assert (found.code, found.topic, found.severity) == ("never_valid", "wing_phase", "error")


def test_every_code_has_a_meaning_and_a_remedy_and_is_documented() -> None:
    """GIVEN the codes WHEN the reference is read THEN each is in it."""
    page = (Path(__file__).parents[2] / "docs" / "log_check.md").read_text(encoding="utf-8")
    for code, entry in CODES.items():
        assert entry.meaning and entry.remedy
        assert f"`{code}`" in page
    assert all(f"`{severity}`" in page for severity in SEVERITIES)


def test_command_tells_in_a_table_and_in_json(
    flight: Tables, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """GIVEN tables with a wrong gear ratio WHEN the command runs THEN the text and the JSON name it."""
    paths = []
    for name in ("sensor_combined", "flap_frequency"):
        stamps, columns = flight[name]
        flat = {"time_us": stamps}
        for column, values in columns.items():
            if values.ndim == 2:
                kind = "gyro" if "gyro" in column else "accel"
                unit = "rad_s" if kind == "gyro" else "m_s2"
                flat |= {f"{kind}_{axis}_{unit}": values[:, i] for i, axis in enumerate("xyz")}
            else:
                flat[column] = values * 8.0 / 7.5
        paths.append(str(tmp_path / f"{name}.csv"))
        np.savetxt(paths[-1], np.column_stack(list(flat.values())), delimiter=",", header=",".join(flat), comments="")
    assert dispatch(["log", "check", *paths]) == 0
    text = capsys.readouterr().out
    assert "rate_mismatch_flapping" in text and "gear ratio" in text
    page = tmp_path / "check.html"
    assert dispatch(["log", "check", *paths, "--report", str(page), "--json"]) == 0
    assert "rate_mismatch_flapping" in page.read_text(encoding="utf-8")
    document = json.loads(capsys.readouterr().out)
    (found,) = [one for one in document["findings"] if one["severity"] == "error"]
    assert found["code"] == "rate_mismatch_flapping" and found["topic"] == "flap_frequency"
    assert found["value"] == pytest.approx(8.0 / 7.5, abs=0.01)
    assert math.isfinite(found["start"]) and found["end"] > found["start"]


def test_tables_with_one_clock_in_milliseconds_and_degrees(flight: Tables, tmp_path: Path) -> None:
    """GIVEN tables of two rates on a clock in ms WHEN checked THEN their length and units are right."""
    stamps, columns = flight["sensor_combined"]
    imu = {"time": stamps * 1e-3}
    imu |= {f"gyro_{axis}_deg_s": np.degrees(columns["gyro_rad"][:, i]) for i, axis in enumerate("xyz")}
    imu |= {f"accel_{axis}_m_s2": columns["accelerometer_m_s2"][:, i] for i, axis in enumerate("xyz")}
    slow, power = flight["battery_status"]
    battery = {"TIME": slow * 1e-3, "voltage_V": power["voltage_v"], "current_A": power["current_a"]}
    paths = [tmp_path / "imu.csv", tmp_path / "battery.csv"]
    for path, table in zip(paths, (imu, battery), strict=True):
        np.savetxt(path, np.column_stack(list(table.values())), delimiter=",", header=",".join(table), comments="")
    report = check_log(paths)
    assert report.log.duration == pytest.approx((stamps[-1] - stamps[0]) * 1e-6, abs=0.2)
    assert [one for one in report.findings if one.severity != "info"] == []
    assert report.log.signals["gyro"].values == pytest.approx(columns["gyro_rad"], abs=1e-6)


def test_clip_counters_count_from_where_they_rise(flight: Tables) -> None:
    """GIVEN a counter that reaches 3, and bits WHEN checked THEN the moments of clipping."""
    stamps = flight["battery_status"][0]
    at = begin(flight) + 20.0
    counter = 3 * (stamps > at * 1e6).astype(np.int64)
    (found,) = findings(flight | {"vehicle_imu_status": (stamps, {"accel_clipping": counter})})
    assert found.code == "clipping" and abs(found.start - 20.0) < 0.3 and found.end - found.start < 0.5


@pytest.mark.validate
@pytest.mark.parametrize("vehicle", ["robo_raven_ii_d", "ulg_ornithopter"])
def test_flights_with_vibration_have_no_error(vehicle: str, tmp_path: Path) -> None:
    """GIVEN flights with the vibration of the vehicle WHEN checked THEN no other warning than theirs."""
    path = tmp_path / "flight.mcap"
    wingbeat.fly(vehicle, vibration=1.0, duration=40.0, log=path)
    codes = {one.code for one in check_log([path]).findings if one.severity != "info"}
    assert codes <= {"vibration", "magnetic_interference"}  # both are in the vehicle file


def test_a_file_that_is_cut_off_is_an_error(tmp_path: Path) -> None:
    """GIVEN a recording without its end WHEN checked THEN the damage is told."""
    path = tmp_path / "flight.mcap"
    wingbeat.fly("arizona_100cm", duration=12.0, log=path)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-200_000])
    assert "damaged" in {one.code for one in check_log([cut]).findings if one.severity == "error"}


def test_bad_input_is_one_line(tmp_path: Path) -> None:
    """GIVEN a table without a time, or a missing file WHEN checked THEN one line says so."""
    table = tmp_path / "x.csv"
    table.write_text("a,b\n1,2\n", encoding="utf-8")
    empty = tmp_path / "empty.csv"
    empty.write_text("time,a\n", encoding="utf-8")
    for path in (table, empty, tmp_path / "missing.ulg"):
        with pytest.raises(InputError) as error:
            check_log([path])
        assert "\n" not in str(error.value)
