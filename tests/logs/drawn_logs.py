"""Drawn flights with planted faults, written as PX4, ArduPilot, own logs and tables."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import wingbeat
from avionics import topics as t
from logs.importing.counterparts import checked
from logs.importing.source import Series
from logs.recorder import McapRecorder
from wingbeat.rotation_arrays import euler_from_quaternions

sys.path.insert(0, str(Path(__file__).parent / "importing"))

from foreign_logs import Tables, dataflash, ulog

Array = NDArray[Any]
VEHICLES = ("arizona_100cm", "robo_raven_ii_d")
AXES = "xyz"
FLYING = 4.0
"""m/s; airspeed after the launch"""


class Fault(NamedTuple):
    """A fault planted in one topic at one moment."""

    code: str
    topic: str
    """as PX4 names it"""
    change: Callable[[Array, dict[str, Array], float], tuple[Array, dict[str, Array]]]
    """new times (us) and columns from these and the moment (s)"""
    is_local: bool = True
    """whether it begins at the moment"""


def drawn_flight(seed: int, duration: float = 45.0) -> Tables:
    """Fly in drawn weather; return topics as PX4 names them, from 8 s before the launch on."""
    random = np.random.default_rng(seed)
    log = wingbeat.Simulation(
        VEHICLES[seed % 2], seed=seed, wind=random.uniform(0.0, 2.0),
        turbulence=("none", "small_uav_light")[random.integers(2)],
    )  # fmt: skip
    while log.state.airspeed < FLYING:  # the launcher waits for steady air
        log.step()
    first = log.time - 8.0
    log.run(first + duration)
    imu, attitude, air, wing = log["/sensors/imu"], log["/attitude/ahrs"], log["/main/air_data"], log["/main/wing"]
    position, power, actuators = log["/main/position"], log["/power/state"], log["/mixing/actuators"]

    def of(columns: Any, every: int, **fields: Any) -> tuple[Array, dict[str, Array]]:
        stamps = np.asarray(columns["time_us"])
        kept = slice(int(np.searchsorted(stamps, first * 1e6)), None, every)
        return stamps[kept] - round(first * 1e6), {k: np.asarray(v)[kept] for k, v in fields.items()}

    def rows(columns: Any, *names: str) -> Array:
        return np.column_stack([columns[name] for name in names])

    gyro, accel, mag = ([f"{name}_{axis}" for axis in AXES] for name in ("gyro", "accel", "mag"))
    return {
        "sensor_combined": of(imu, 1, gyro_rad=rows(imu, *gyro), accelerometer_m_s2=rows(imu, *accel)),
        "vehicle_magnetometer": of(imu, 4, magnetometer_ga=rows(imu, *mag)),
        "vehicle_attitude": of(attitude, 2, q=rows(attitude, *(f"quaternion_{axis}" for axis in "wxyz"))),
        "airspeed": of(air, 1, true_airspeed_m_s=air["airspeed"]),
        "vehicle_local_position": of(
            position, 1, x=position["north"], y=position["east"], z=0.0 * position["north"],
            vx=position["v_north"], vy=position["v_east"], vz=0.0 * position["north"],
        ),
        "battery_status": of(power, 20, voltage_v=power["voltage"], current_a=power["current"]),
        "flap_frequency": of(wing, 10, frequency_hz=wing["frequency"]),
        "actuator_servos": of(actuators, 4, control=rows(actuators, "elevator", "rudder") / 0.6),
        "actuator_motors": of(actuators, 4, control=rows(actuators, "throttle")),
    }  # fmt: skip


def _kept(keep: Callable[[Array, float], Array]) -> Callable[..., Any]:
    """Leave rows out."""

    def change(time: Array, columns: dict[str, Array], at: float) -> tuple[Array, dict[str, Array]]:
        rows = keep(time * 1e-6, at)
        return time[rows], {name: values[rows] for name, values in columns.items()}

    return change


def _stamped(new: Callable[[Array, int], Array]) -> Callable[..., Any]:
    """Change time stamps from the row at the moment on."""

    def change(time: Array, columns: dict[str, Array], at: float) -> tuple[Array, dict[str, Array]]:
        return new(np.array(time), int(np.searchsorted(time, at * 1e6))), columns

    return change


def _valued(new: Callable[[Array, Array, float], Array], *names: str) -> Callable[..., Any]:
    """Change columns."""

    def change(time: Array, columns: dict[str, Array], at: float) -> tuple[Array, dict[str, Array]]:
        changed = {name: new(time * 1e-6, np.array(columns[name], float), at) for name in names}
        return time, columns | changed

    return change


def _backwards(time: Array, row: int) -> Array:
    time[row : row + 20 : 2] -= 12_000
    return time


def _repeated(time: Array, row: int) -> Array:
    time[row + 1 : row + 13 : 2] = time[row : row + 12 : 2]
    return time


def _clipped(time: Array, values: Array, at: float) -> Array:
    near = (time >= at) & (time < at + 2.0)
    low = np.percentile(values[near, 2], 25.0)
    values[near, 2] = np.maximum(values[near, 2], low)
    values[~near, 2] = np.clip(values[~near, 2], low + 0.5, None)
    return values


def _frozen(time: Array, values: Array, at: float) -> Array:
    near = (time >= at) & (time < at + 3.0)
    values[near] = values[int(np.flatnonzero(near)[0])]
    return values


def _gyro_step(time: Array, values: Array, at: float) -> Array:
    values[time >= at, 2] += 0.12
    return values


def _surface_limit(time: Array, values: Array, at: float) -> Array:
    values[(time >= at) & (time < at + 2.5), 0] = 1.0
    return values


def _sag(time: Array, values: Array, at: float) -> Array:
    return np.where((time >= at) & (time < at + 2.0), 0.7 * values, values)


def _offset(time: Array, values: Array, at: float) -> Array:
    return values + max(0.25 * float(np.percentile(values, 95)), 2.0)


FAULTS = (
    Fault("gap", "airspeed", _kept(lambda time, at: (time < at) | (time > at + 0.7))),
    Fault("rate_change", "vehicle_attitude", _kept(lambda time, at: (time < at) | (np.arange(len(time)) % 2 == 0))),
    Fault("time_backwards", "sensor_combined", _stamped(_backwards)),
    Fault("time_repeated", "vehicle_local_position", _stamped(_repeated)),
    Fault("time_skew", "vehicle_attitude", _stamped(lambda time, row: time + 30_000), False),
    Fault("clipping", "sensor_combined", _valued(_clipped, "accelerometer_m_s2")),
    Fault("frozen", "airspeed", _valued(_frozen, "true_airspeed_m_s")),
    Fault("bias_step", "sensor_combined", _valued(_gyro_step, "gyro_rad")),
    Fault("position_jump", "vehicle_local_position", _valued(lambda time, x, at: x + 12.0 * (time >= at), "x")),
    Fault("saturation", "actuator_servos", _valued(_surface_limit, "control")),
    Fault("battery_sag", "battery_status", _valued(_sag, "voltage_v")),
    Fault("rate_mismatch_flapping", "flap_frequency", _valued(lambda t, f, at: f * 8.0 / 7.5, "frequency_hz"), False),
)
CURRENT = Fault("current_offset", "battery_status", _valued(_offset, "current_a"), False)
"""for a format without a flapping frequency, and for our own, whose messages are read in the order of their times"""


def planted(tables: Tables, fault: Fault, at: float) -> Tables:
    """Return the tables with the fault."""
    time, columns = tables[fault.topic]
    return tables | {fault.topic: fault.change(time, columns, at)}


def begin(tables: Tables) -> float:
    """Return the time of the first message in s."""
    return float(min(stamps.min() for stamps, _ in tables.values())) * 1e-6


def write_px4(tables: Tables, folder: Path) -> list[Path]:
    """Write a ULog."""
    path = folder / "drawn.ulg"
    path.write_bytes(ulog(tables))
    return [path]


DATAFLASH = {
    "sensor_combined": "IMU", "vehicle_magnetometer": "MAG", "vehicle_attitude": "ATT", "airspeed": "ARSP",
    "vehicle_local_position": "XKF1", "battery_status": "BAT", "actuator_servos": "RCOU",
}  # fmt: skip


def _split(name: str, values: Array) -> dict[str, Array]:
    return {f"{name}{axis.upper()}": values[:, place] for place, axis in enumerate(AXES)}


def write_ardupilot(tables: Tables, folder: Path) -> list[Path]:
    """Write a DataFlash log."""
    made: Tables = {}
    for name, (time, c) in tables.items():
        if name == "sensor_combined":
            made["IMU"] = time, _split("Gyr", c["gyro_rad"]) | _split("Acc", c["accelerometer_m_s2"])
        elif name == "vehicle_magnetometer":
            made["MAG"] = time, _split("Mag", 1e3 * c["magnetometer_ga"])
        elif name == "vehicle_attitude":
            angles = np.degrees(np.column_stack(euler_from_quaternions(*c["q"].T)))
            made["ATT"] = time, dict(zip(("Roll", "Pitch", "Yaw"), angles.T, strict=True))
        elif name == "airspeed":
            made["ARSP"] = time, {"Airspeed": c["true_airspeed_m_s"]}
        elif name == "vehicle_local_position":
            columns = dict(zip(("PN", "PE", "PD", "VN", "VE", "VD"), c.values(), strict=True))
            made["XKF1"] = time, columns
        elif name == "battery_status":
            made["BAT"] = time, {"Volt": c["voltage_v"], "Curr": c["current_a"]}
        elif name == "actuator_servos":
            pulses = 1500.0 + 500.0 * c["control"]
            motor = np.interp(time, *(tables["actuator_motors"][0], tables["actuator_motors"][1]["control"][:, 0]))
            made["RCOU"] = (
                time,
                {"C1": pulses[:, 0], "C2": pulses[:, 1], "C3": 1000.0 + 1000.0 * motor, "C4": 0 * motor},
            )
    path = folder / "drawn.bin"
    path.write_bytes(dataflash(made))
    return [path]


SUFFIXES = {"gyro_rad": "gyro_{}_rad_s", "accelerometer_m_s2": "accel_{}_m_s2", "magnetometer_ga": "mag_{}_ga"}


def write_tables(tables: Tables, folder: Path) -> list[Path]:
    """Write one table a topic."""
    paths = []
    for name, (time, columns) in tables.items():
        flat: dict[str, Array] = {"t_s": time * 1e-6}
        for column, values in columns.items():
            if values.ndim == 1:
                flat[column] = values
            elif column in SUFFIXES:
                flat |= {SUFFIXES[column].format(axis): values[:, i] for i, axis in enumerate(AXES)}
            elif column == "q":
                flat |= {f"q_{axis}": values[:, i] for i, axis in enumerate("wxyz")}
            else:
                names = ("elevator", "rudder") if name == "actuator_servos" else ("throttle",)
                flat |= {key: values[:, i] for i, key in enumerate(names)}
        paths.append(folder / f"{name}.csv")
        rows = np.column_stack(list(flat.values()))
        np.savetxt(paths[-1], rows, "%.9g", delimiter=",", header=",".join(flat), comments="")
    return paths


OWN = {
    "sensor_combined": t.IMU, "vehicle_attitude": t.ATTITUDE, "airspeed": t.AIR_DATA,
    "vehicle_local_position": t.POSITION, "battery_status": t.POWER, "flap_frequency": t.WING,
    "actuator_servos": t.ACTUATORS,
}  # fmt: skip


def write_wingbeat(tables: Tables, folder: Path) -> list[Path]:
    """Write a log of Wingbeat; the order of the file is that of the running maximum of the times."""
    rows: list[tuple[int, Any, Any]] = []
    for name, (time, c) in tables.items():
        if name not in OWN:
            continue
        fields: dict[str, Array]
        if name == "sensor_combined":
            mag_time, mag = tables["vehicle_magnetometer"]
            field = mag["magnetometer_ga"]
            pairs = (("gyro", c["gyro_rad"]), ("accel", c["accelerometer_m_s2"]))
            fields = {f"{key}_{axis}": v[:, i] for key, v in pairs for i, axis in enumerate(AXES)}
            fields |= {f"mag_{axis}": np.interp(time, mag_time, field[:, i]) for i, axis in enumerate(AXES)}
        elif name == "vehicle_attitude":
            fields = {f"quaternion_{axis}": c["q"][:, i] for i, axis in enumerate("wxyz")}
        elif name == "airspeed":
            fields = {"airspeed": c["true_airspeed_m_s"]}
        elif name == "vehicle_local_position":
            fields = {"north": c["x"], "east": c["y"], "v_north": c["vx"], "v_east": c["vy"]}
        elif name == "battery_status":
            fields = {"voltage": c["voltage_v"], "current": c["current_a"]}
        elif name == "flap_frequency":
            fields = {"frequency": c["frequency_hz"]}
        else:
            motor_time, motor = tables["actuator_motors"]
            throttle = np.interp(time, motor_time, motor["control"][:, 0])
            fields = {"elevator": c["control"][:, 0], "rudder": c["control"][:, 1], "throttle": throttle}
        topic = OWN[name]
        series = checked(topic, Series(name, time, {}, {}), fields).series
        order = np.maximum.accumulate(series.time_us).tolist()
        columns = [values.tolist() for values in series.columns.values()]
        for at, stamp, *values in zip(order, series.time_us.tolist(), *columns, strict=True):
            rows.append((at, topic, topic.message(stamp, *values)))
    rows.sort(key=lambda row: row[0])
    path = folder / "drawn.mcap"
    with McapRecorder(path, start_epoch_ns=0, clock=lambda: 0.0) as recorder:
        for _, topic, message in rows:
            recorder.record(topic, message)
    return [path]


class Format(NamedTuple):
    """A kind of log."""

    write: Callable[[Tables, Path], list[Path]]
    names: dict[str, str]
    """of its topics, by PX4's; empty if they are the same"""
    faults: tuple[Fault, ...] = FAULTS


FORMATS = {
    "px4": Format(write_px4, {}),
    "ardupilot": Format(write_ardupilot, DATAFLASH, (*FAULTS[:-1], CURRENT)),
    "tables": Format(write_tables, {}),
    "own": Format(
        write_wingbeat,
        {name: topic.name for name, topic in OWN.items()},
        (*(one for one in FAULTS if one.code != "time_backwards"), CURRENT),
    ),
}
