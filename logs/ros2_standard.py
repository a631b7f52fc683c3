"""Standard ROS messages from our tables, in the frames of REP 103: `WORLD` is ENU, `BODY` FLU."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.columns import Array, Columns
from logs.poses import enu_from_flu
from wingbeat.quaternions import frd_from_ned

WORLD, BODY = "odom", "base_link"
TESLA_PER_GAUSS = 1e-4
Tables = Mapping[str, Columns]


class Series(NamedTuple):
    """Messages of one ROS topic."""

    topic: str
    kind: str
    """-; ``package/msg/Name``"""
    definition: str | None
    """-; text of a message type that ROS does not have"""
    times: NDArray[np.int64]
    """ns; since 1970"""
    message: Callable[[Any, int], Any]
    """builds the message of a row from the types by name"""


ATTITUDE = ("quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z")
RATES = ("roll_rate", "pitch_rate", "yaw_rate")


def _table(tables: Tables, topic: str, fields: Iterable[str]) -> Columns | None:
    """Return a table with messages if it has all the fields."""
    columns = tables.get(topic)
    if columns is None or not len(columns.log_time_ns) or any(field not in columns for field in fields):
        return None
    return columns


def _stamps(columns: Columns) -> list[int]:
    """Return the times of the measurements in ns since 1970."""
    return [int(time) for time in columns.boot_ns + np.rint(columns.time * 1e9).astype(np.int64)]


def stamp(types: Any, time_ns: int) -> Any:
    """Build a builtin_interfaces/Time from ns since 1970."""
    return types["builtin_interfaces/msg/Time"](*divmod(time_ns, 1_000_000_000))


def _header(types: Any, time_ns: int, frame: str) -> Any:
    return types["std_msgs/msg/Header"](stamp(types, time_ns), frame)


def _vector(types: Any, values: Iterable[float]) -> Any:
    return types["geometry_msgs/msg/Vector3"](*map(float, values))


def _quaternion(types: Any, wxyz: Sequence[float]) -> Any:
    w, x, y, z = map(float, wxyz)
    return types["geometry_msgs/msg/Quaternion"](x, y, z, w)


def _rows(columns: Columns, *names: str) -> Array:
    return np.column_stack([columns[name] for name in names]).astype(float)


def _flu(frd: Array) -> Array:
    return frd * (1.0, -1.0, -1.0)


def _enu_from_flu(quaternions: Array) -> Array:
    """Convert (n, 4) quaternions of r_ned_from_frd to those of r_enu_from_flu."""
    parts: Any = quaternions.T
    return np.column_stack(enu_from_flu(parts))


def _latest(columns: Columns, times: Array) -> Array:
    """Return the row of the last message at or before each time (s), -1 before the first."""
    return np.searchsorted(columns.time, times, side="right") - 1


def _diagonal(size: int, *values: float) -> Array:
    matrix = np.zeros((size, size))
    for i, value in enumerate(values):
        matrix[i, i] = value
    return matrix.ravel()


UNKNOWN = np.array([-1.0, *[0.0] * 8])
"""orientation covariance of a sensor_msgs/Imu without an orientation"""


def _imu(topic: str, tables: Tables) -> Series | None:
    """Return specific force and angular rate of `/sensors/imu` with the attitude of `/attitude/ahrs`."""
    names = ("accel_x", "accel_y", "accel_z"), ("gyro_x", "gyro_y", "gyro_z")
    columns = _table(tables, "/sensors/imu", (*names[0], *names[1]))
    if columns is None:
        return None
    accel, gyro = (_flu(_rows(columns, *three)) for three in names)
    attitude = _table(tables, "/attitude/ahrs", ATTITUDE)
    turned = None if attitude is None else _enu_from_flu(_rows(attitude, *ATTITUDE))
    before = np.full(len(accel), -1) if attitude is None else _latest(attitude, columns.time)
    stamps = _stamps(columns)

    def message(types: Any, row: int) -> Any:
        known = turned is not None and before[row] >= 0
        return types["sensor_msgs/msg/Imu"](
            _header(types, stamps[row], BODY),
            _quaternion(types, turned[before[row]] if turned is not None and known else (1.0, 0.0, 0.0, 0.0)),
            np.zeros(9) if known else UNKNOWN,
            _vector(types, gyro[row]),
            np.zeros(9),
            _vector(types, accel[row]),
            np.zeros(9),
        )

    return Series(topic, "sensor_msgs/msg/Imu", None, columns.log_time_ns, message)


def _field(topic: str, tables: Tables) -> Series | None:
    """Return the magnetic field in tesla."""
    columns = _table(tables, "/sensors/imu", ("mag_x", "mag_y", "mag_z"))
    if columns is None:
        return None
    field, stamps = TESLA_PER_GAUSS * _flu(_rows(columns, "mag_x", "mag_y", "mag_z")), _stamps(columns)

    def message(types: Any, row: int) -> Any:
        header = _header(types, stamps[row], BODY)
        return types["sensor_msgs/msg/MagneticField"](header, _vector(types, field[row]), np.zeros(9))

    return Series(topic, "sensor_msgs/msg/MagneticField", None, columns.log_time_ns, message)


def _fix(topic: str, tables: Tables) -> Series | None:
    """Return fixes of the receiver; the altitude is above mean sea level, because the geoid is unknown."""
    columns = _table(tables, "/sensors/gps", ("latitude", "longitude", "altitude", "fix_type"))
    if columns is None:
        return None
    place, stamps = np.degrees(_rows(columns, "latitude", "longitude")), _stamps(columns)
    accuracy = [columns.get(f"{axis}_accuracy", np.zeros(len(stamps))) for axis in ("horizontal", "vertical")]

    def message(types: Any, row: int) -> Any:
        horizontal, vertical = (float(values[row]) ** 2 for values in accuracy)
        fixed = 0 if columns["fix_type"][row] >= 2 else -1
        return types["sensor_msgs/msg/NavSatFix"](
            _header(types, stamps[row], BODY),
            types["sensor_msgs/msg/NavSatStatus"](fixed, 1),
            *map(float, place[row]),
            float(columns["altitude"][row]),
            _diagonal(3, horizontal, horizontal, vertical),
            2 if horizontal > 0.0 else 0,
        )

    return Series(topic, "sensor_msgs/msg/NavSatFix", None, columns.log_time_ns, message)


def _pressure(topic: str, tables: Tables) -> Series | None:
    columns = _table(tables, "/main/air_data", ("static_pressure",))
    if columns is None:
        return None
    stamps = _stamps(columns)

    def message(types: Any, row: int) -> Any:
        pressure = float(columns["static_pressure"][row])
        return types["sensor_msgs/msg/FluidPressure"](_header(types, stamps[row], BODY), pressure, 0.0)

    return Series(topic, "sensor_msgs/msg/FluidPressure", None, columns.log_time_ns, message)


def _battery(topic: str, tables: Tables) -> Series | None:
    """Return the battery; its current is negative when it discharges."""
    columns = _table(tables, "/power/state", ("voltage", "current"))
    if columns is None:
        return None
    stamps, nothing = _stamps(columns), float("nan")
    remaining = columns.get("battery_remaining", np.full(len(stamps), nothing))

    def message(types: Any, row: int) -> Any:
        current = float(columns["current"][row])
        return types["sensor_msgs/msg/BatteryState"](
            header=_header(types, stamps[row], BODY),
            voltage=float(columns["voltage"][row]),
            temperature=nothing,
            current=-current,
            charge=nothing,
            capacity=nothing,
            design_capacity=nothing,
            percentage=float(remaining[row]),
            power_supply_status=2 if current > 0.0 else 0,
            power_supply_health=0,
            power_supply_technology=0,
            present=True,
            cell_voltage=np.zeros(0, np.float32),
            cell_temperature=np.zeros(0, np.float32),
            location="",
            serial_number="",
        )

    return Series(topic, "sensor_msgs/msg/BatteryState", None, columns.log_time_ns, message)


class Motion(NamedTuple):
    """Pose and velocity by row: ENU and FLU."""

    times: NDArray[np.int64]
    """ns; log times"""
    stamps: list[int]
    position: Array
    quaternion: Array
    """(w, x, y, z)"""
    velocity: Array
    """m/s; in body axes"""
    rates: Array
    """rad/s"""
    variance: Array
    """m^2; of the position, 0 if unknown"""


def _motion(columns: Columns, ned: Array, v_ned: Array, attitude: Array, rates: Array, variance: Array) -> Motion:
    columns_of: Any = (attitude.T, v_ned.T)  # the rotation is of floats, and holds for arrays too
    velocity = np.column_stack(frd_from_ned(*columns_of))
    return Motion(
        columns.log_time_ns,
        _stamps(columns),
        ned[:, [1, 0, 2]] * (1.0, 1.0, -1.0),
        _enu_from_flu(attitude),
        _flu(velocity),
        _flu(rates),
        variance,
    )


def _estimate(tables: Tables) -> Motion | None:
    """Return the estimated motion at the times of `/main/position`, once all estimators have one."""
    places = _table(tables, "/main/position", ("north", "east", "v_north", "v_east"))
    height = _table(tables, "/main/altitude", ("altitude", "climb_rate"))
    attitude = _table(tables, "/attitude/ahrs", (*ATTITUDE, *RATES))
    if places is None or height is None or attitude is None:
        return None
    at, up = _latest(attitude, places.time), _latest(height, places.time)
    kept = (at >= 0) & (up >= 0) & (places.get("valid", np.ones(len(at))) > 0)
    if not kept.any():
        return None
    places, at, up = _kept(places, kept), at[kept], up[kept]
    nothing = np.zeros(len(at))
    across, along = places.get("position_variance", nothing), height.get("altitude_variance")
    return _motion(
        places,
        np.column_stack((places["north"], places["east"], -height["altitude"][up])),
        np.column_stack((places["v_north"], places["v_east"], -height["climb_rate"][up])),
        _rows(attitude, *ATTITUDE)[at],
        _rows(attitude, *RATES)[at],
        np.column_stack((across, across, nothing if along is None else along[up])),
    )


def _truth(tables: Tables) -> Motion | None:
    place, velocity = ("north", "east", "down"), ("v_north", "v_east", "v_down")
    columns = _table(tables, "/truth/state", (*place, *velocity, *ATTITUDE, *RATES))
    if columns is None:
        return None
    ned, v_ned, attitude, rates = (_rows(columns, *names) for names in (place, velocity, ATTITUDE, RATES))
    return _motion(columns, ned, v_ned, attitude, rates, np.zeros((len(ned), 3)))


def _kept(columns: Columns, rows: Array) -> Columns:
    fields = {name: values[rows] for name, values in columns.fields.items()}
    return Columns(columns.topic, fields, columns.units, columns.log_time_ns[rows], columns.boot_ns)


def _odometry(topic: str, motion: Motion | None) -> Series | None:
    if motion is None:
        return None

    def message(types: Any, row: int) -> Any:
        pose = types["geometry_msgs/msg/Pose"](
            types["geometry_msgs/msg/Point"](*map(float, motion.position[row])),
            _quaternion(types, motion.quaternion[row]),
        )
        twist = types["geometry_msgs/msg/Twist"](
            _vector(types, motion.velocity[row]), _vector(types, motion.rates[row])
        )
        return types["nav_msgs/msg/Odometry"](
            _header(types, motion.stamps[row], WORLD),
            BODY,
            types["geometry_msgs/msg/PoseWithCovariance"](pose, _diagonal(6, *motion.variance[row])),
            types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
        )

    return Series(topic, "nav_msgs/msg/Odometry", None, motion.times, message)


def _transforms(topic: str, tables: Tables) -> Series | None:
    """Return the transform from WORLD to BODY: the estimate, or the truth without one."""
    motion = _estimate(tables) or _truth(tables)
    if motion is None:
        return None

    def message(types: Any, row: int) -> Any:
        transform = types["geometry_msgs/msg/Transform"](
            _vector(types, motion.position[row]), _quaternion(types, motion.quaternion[row])
        )
        header = _header(types, motion.stamps[row], WORLD)
        return types["tf2_msgs/msg/TFMessage"]([types["geometry_msgs/msg/TransformStamped"](header, BODY, transform)])

    return Series(topic, "tf2_msgs/msg/TFMessage", None, motion.times, message)


STANDARD: Mapping[str, Callable[[str, Tables], Series | None]] = {
    "/imu/data": _imu,
    "/imu/mag": _field,
    "/gps/fix": _fix,
    "/pressure": _pressure,
    "/battery_state": _battery,
    "/odom": lambda topic, tables: _odometry(topic, _estimate(tables)),
    "/truth/odom": lambda topic, tables: _odometry(topic, _truth(tables)),
    "/tf": _transforms,
}
"""standard ROS topics and what builds them from our tables"""
