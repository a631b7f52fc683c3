"""The signals of a log, whatever program wrote it, for the checks."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics import topics as t
from logs.importing import log_import
from logs.importing.checks import nearly_ordered, sound
from logs.importing.counterparts import make_all
from logs.importing.source import Series, Source
from logs.importing.ulog import unit_of
from logs.importing.units import CONVERSIONS
from logs.reader import open_log
from wingbeat.errors import InputError
from wingbeat.topic import Topic

Array = NDArray[np.float64]
LOG_SUFFIX = ".mcap"


class Signal(NamedTuple):
    """One measured quantity."""

    topic: str
    """as in the source log"""
    name: str
    """of the quantity, for texts"""
    time: Array
    """(n,) s; since the log's first message, increasing"""
    values: Array
    """(n, k) SI"""

    def between(self, start: float, end: float) -> Signal:
        """Return the part between two times."""
        inside = slice(np.searchsorted(self.time, start), np.searchsorted(self.time, end, side="right"))
        return self._replace(time=self.time[inside], values=self.values[inside])


class RawTopic(NamedTuple):
    """A topic as it was logged."""

    name: str
    time: Array
    """(n,) s; since the log's first message, in the order of the file"""
    columns: Mapping[str, NDArray[Any]]


class LogData(NamedTuple):
    """Everything that the checks read."""

    name: str
    kind: str
    """format of the source"""
    duration: float
    """s"""
    raw: tuple[RawTopic, ...]
    signals: Mapping[str, Signal]
    """by role, see `ROLES`"""
    damage: tuple[str, ...] = ()
    """of the file, one line each"""
    boots: int = 1
    """of the vehicle in the file; the one with the most data is checked"""


ROLES: dict[str, tuple[tuple[Topic[Any], tuple[str, ...]], ...]] = {
    "gyro": ((t.IMU, ("gyro_x", "gyro_y", "gyro_z")),),
    "accel": ((t.IMU, ("accel_x", "accel_y", "accel_z")),),
    "mag": ((t.IMU, ("mag_x", "mag_y", "mag_z")),),
    "attitude": ((t.ATTITUDE, ("roll", "pitch", "yaw")),),
    "airspeed": ((t.AIR_DATA, ("airspeed",)),),
    "altitude": ((t.ALTITUDE, ("altitude",)),),
    "position": ((t.POSITION, ("north", "east")),),
    "velocity": ((t.POSITION, ("v_north", "v_east")),),
    "gps_velocity": ((t.GPS, ("v_north", "v_east")),),
    "voltage": ((t.POWER, ("voltage",)),),
    "current": ((t.POWER, ("current",)),),
    "flap_frequency": ((t.WING, ("frequency",)),),
    "flap_angle": ((t.WING, ("angle_left", "angle_right")),),
    "surfaces": ((t.ACTUATORS, ("elevator", "rudder")),),
    "throttle": ((t.ACTUATORS, ("throttle",)),),
}
"""Wingbeat topics and fields of each role"""
PATTERNS: dict[str, tuple[str, ...]] = {
    "gyro": (r"(?:gyro|gyr|ang_vel|omega)_?{axis}(?:_rad_s|_deg_s|_dps)?",),
    "accel": (r"(?:accel|acc|acc_b)_?{axis}(?:_m_s2|_g)?",),
    "mag": (r"mag_?{axis}(?:_ga|_gauss|_ut)?",),
    "quaternion": (r"q_?{quaternion}",),
    "position": (r"(?:pos_)?{axis}(?:_m)?",),
    "velocity": (r"v_?{axis}(?:_m_s)?",),
    "airspeed": (r"(?:true|indicated)?_?(?:airspeed|indicated)(?:_m_s)?", r"indicated_m_s"),
    "voltage": (r"voltage(?:_v)?", r"volt"),
    "current": (r"current(?:_reported)?(?:_a)?", r"curr"),
    "flap_frequency": (r"flap(?:ping)?_?(?:frequency)?_?(?:hz)?",),
    "surfaces": (
        r"elevator(?:_norm|_rad)?",
        r"(?:elevon|servo).*",
    ),
    "throttle": (
        r"throttle(?:_norm)?",
        r"motor(?:_norm)?",
    ),
}
"""patterns of the column names of tables, by role"""
FOREIGN: dict[str, tuple[tuple[str, tuple[str, ...]], ...]] = {
    "surfaces": (
        ("actuator_servos", ("control",)), ("actuator_controls_0", ("control",)),
        ("AETR", ("Ail", "Elev", "Rudd")), ("RCOU", ("C1", "C2", "C4")),
    ),
    "throttle": (("actuator_motors", ("control",)), ("AETR", ("Thr",)), ("RCOU", ("C3",))),
    "airspeed": (("airspeed", ("indicated_airspeed_m_s",)),),
    "flap_frequency": (
        ("flap_frequency", ("frequency_hz",)), ("flap_frequency", ("flap_frequency_hz",)),
        ("flap_frequency", ("frequency",)), ("flap_frequency", ("flap_frequency",)),
        ("flapping_frequency", ("frequency",)),
    ),
}  # fmt: skip
"""topics of PX4 and ArduPilot and their columns, by role, beside the Wingbeat topics made of them"""
PULSES = "RCOU"
"""topic with pulse widths in us; the throttle is usually channel 3"""
TIME_COLUMNS = re.compile(r"(?:t|time|timestamp|time_us|timestamp_us|time_usec|timeus)(?:_(s|ms|us|ns))?", re.I)
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def read_log(paths: Sequence[Path], mapping: Path | None = None) -> LogData:
    """Read one log for the checks; several tables are topics of one log.

    Args:
        paths: one log (.mcap, .ulg, .bin, .tlog, .csv), or several tables with a common clock.
        mapping: columns of a table, see ``wingbeat log import --help``.

    Raises:
        InputError: a file cannot be read, or has no data.
    """
    if not paths:
        raise InputError("which log?")
    first = paths[0]
    if len(paths) > 1 or (first.suffix.lower() == ".csv" and mapping is None):
        return _of_tables(paths)
    if first.suffix.lower() == LOG_SUFFIX:
        return _of_recording(first)
    data = log_import.read_bytes(first)
    try:
        sources = log_import.read_source(log_import.Choice(first, first, mapping), data)
    except InputError as error:
        raise InputError(f"{first}: {error} (also .mcap, and .csv without a map)") from None
    source = max(sources, key=lambda one: sum(len(series.time_us) for series in one.series.values()))
    return of_source(first.name, source)._replace(boots=len(sources))


def of_source(name: str, source: Source) -> LogData:
    """Return the signals of a log as an importer read it.

    Raises:
        InputError: no valid row.
    """
    known = log_import.FORMATS[source.format]
    with np.errstate(all="ignore"):
        whole = {key: sound(one, key, source.checksummed)[0] for key, one in source.series.items()}
        whole = {key: one for key, one in whole.items() if len(one.time_us)}
        made = [*source.made, *make_all(known.counterparts, whole)[0]]
    if not whole and not made:
        raise InputError(f"{name}: no row of it can be true")
    begin, end = _span([one.time_us for one in whole.values()] or [one.series.time_us for one in made])
    raw = [RawTopic(key, _seconds(one.time_us, begin), one.columns) for key, one in source.series.items()]
    by_role = _by_role((one.topic, one.source, one.series) for one in made)
    signals = {role: _shifted(signal, begin) for role, signal in by_role}
    for role, signal in _of_autopilot(whole):
        signals.setdefault(role, _shifted(signal, begin))
    return LogData(name, known.name, (end - begin) * 1e-6, tuple(raw), signals, source.damage)


def _of_autopilot(series: Mapping[str, Series]) -> Iterator[tuple[str, Signal]]:
    for role, choices in FOREIGN.items():
        for topic, columns in choices:
            one = series.get(topic)
            if one is None or any(column not in one.columns for column in columns):
                continue
            parts = [np.asarray(one.columns[column], float) for column in columns]
            values = np.column_stack([part if part.ndim == 2 else part[:, None] for part in parts])
            if topic == PULSES:
                middle, half = (1000.0, 1000.0) if role == "throttle" else (1500.0, 500.0)
                values = (values - middle) / half
            finite = np.isfinite(values)
            used = finite.any(axis=0) & (np.where(finite, values, 0.0).std(axis=0) > 0.0)
            if used.any():
                yield role, _ordered(topic, role, one.time_us, values[:, used])
                break


def _of_recording(path: Path) -> LogData:
    wanted = {topic.name for fields in ROLES.values() for topic, _ in fields}
    raw, found = [], []
    with open_log(path) as log:
        damage = tuple(map(str, log.damage))
        for name, info in log.topics.items():
            if info.messages == 0 or not name.startswith("/") or name.startswith(("/view/", "/truth/")):
                continue
            try:
                columns = log.columns(name)
            except InputError:
                continue
            plain = {key: values for key, values in columns.items() if key != "time_us" and values.dtype != object}
            stamps = np.asarray(columns["time_us"] if "time_us" in columns.fields else columns.time * 1e6, np.int64)
            raw.append((name, stamps, plain))
            if name in wanted:
                topic = next(one for fields in ROLES.values() for one, _ in fields if one.name == name)
                found.append((topic, name, Series(name, stamps, plain, columns.units)))
    if not raw:
        raise InputError(f"{path}: no topic with numbers")
    begin, end = _span([stamps for _, stamps, _ in raw])
    signals = {role: _shifted(signal, begin) for role, signal in _by_role(found)}
    foreign = {name.rpartition("/")[2]: Series(name, stamps, plain, {}) for name, stamps, plain in raw}
    for role, signal in _of_autopilot(foreign):
        signals.setdefault(role, _shifted(signal, begin))
    topics = tuple(RawTopic(name, _seconds(stamps, begin), plain) for name, stamps, plain in raw)
    return LogData(path.name, "Wingbeat", (end - begin) * 1e-6, topics, signals, damage)


def _of_tables(paths: Sequence[Path]) -> LogData:
    """Read tables: the first column with the name of a time is the clock, the file's stem the topic."""
    tables = []
    for path in paths:
        if path.suffix.lower() != ".csv":
            raise InputError(f"{path}: only tables can be checked together, one log at a time otherwise")
        tables.append(_table(path))
    common = _unit_of_time([table.clock for table in tables if not table.unit])
    raw: dict[str, Series] = {}
    for table in tables:
        stamps = np.rint(table.clock * _SECONDS[table.unit or common] * 1e6).astype(np.int64)
        units = {name: unit_of(name.lower()) for name in table.columns}
        raw[table.name] = Series(table.name, stamps, table.columns, units)
    begin, end = _span([one.time_us for one in raw.values()])
    signals = {role: _shifted(signal, begin) for role, signal in _by_name(raw)}
    topics = tuple(RawTopic(one.name, _seconds(one.time_us, begin), one.columns) for one in raw.values())
    name = paths[0].name if len(paths) == 1 else f"{len(paths)} tables"
    return LogData(name, "table", (end - begin) * 1e-6, topics, signals)


class _Table(NamedTuple):
    """Columns of one file."""

    name: str
    clock: Array
    """(n,); in ``unit``"""
    unit: str
    """of the clock, as in its name; empty if that does not tell"""
    columns: dict[str, NDArray[Any]]


def _table(path: Path) -> _Table:
    import pandas as pd

    try:
        frame = pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from None
    numbers = frame.select_dtypes("number")
    clock = next((name for name in numbers if TIME_COLUMNS.fullmatch(str(name).strip())), None)
    if clock is None:
        raise InputError(f"{path}: no column with the name of a time (t_s, time, timestamp ...)")
    match = TIME_COLUMNS.fullmatch(str(clock).strip())
    values = numbers[clock].to_numpy(float)
    finite = np.isfinite(values)
    if not finite.any():
        raise InputError(f"{path}: no row has a time")
    columns = {str(name).strip(): numbers[name].to_numpy()[finite] for name in numbers if name != clock}
    return _Table(path.stem, values[finite], (match[1] or "").lower() if match else "", columns)


def _unit_of_time(clocks: Sequence[Array]) -> str:
    """Return the common unit of clocks: the largest that puts every period between 0.2 ms and 2 s."""
    steps = [float(np.median(np.abs(np.diff(clock)))) for clock in clocks if len(clock) > 1]
    for unit, factor in _SECONDS.items():
        if all(2e-4 <= step * factor <= 2.0 for step in steps):
            return unit
    return "s"


def _span(times: Iterable[NDArray[np.int64]]) -> tuple[int, int]:
    """Return the first and the last plausible time in us."""
    plausible = [one[nearly_ordered(one)] for one in times if len(one)]
    kept = [one for one in plausible if len(one)]
    return min(int(one.min()) for one in kept), max(int(one.max()) for one in kept)


def _by_role(made: Iterable[tuple[Topic[Any], str, Series]]) -> Iterator[tuple[str, Signal]]:
    series = {topic: (source, one) for topic, source, one in made}
    for role, choices in ROLES.items():
        for topic, fields in choices:
            if topic not in series:
                continue
            source, one = series[topic]
            if all(field in one.columns for field in fields):
                values = np.column_stack([np.asarray(one.columns[field], float) for field in fields])
                if np.isfinite(values).any():
                    yield role, _ordered(source, role, one.time_us, values)
                    break


def _by_name(series: Mapping[str, Series]) -> Iterator[tuple[str, Signal]]:
    """Find roles by the names of topics and columns."""
    for role, patterns in PATTERNS.items():
        for pattern in patterns:
            found = next(_matches(series, role, pattern), None)
            if found is not None:
                yield ("attitude" if role == "quaternion" else role), found
                break


def _matches(series: Mapping[str, Series], role: str, pattern: str) -> Iterator[Signal]:
    for name, one in series.items():
        if role in ("position", "velocity") and "position" not in name.lower():
            continue  # x, y and z are names of anything
        numbers = {key: np.asarray(values) for key, values in one.columns.items() if values.dtype.kind in "iuf"}
        if "{" in pattern:
            key = "quaternion" if "{quaternion}" in pattern else "axis"
            parts = ("w0", "x1", "y2", "z3") if key == "quaternion" else ("x", "y", "z")
            names = [_named(numbers, pattern.format(**{key: f"[{part}]"})) for part in parts]
            if not all(names):
                continue
        else:
            wanted = role == "flap_frequency" and re.search(r"flap", name, re.I)
            names = [_named(numbers, pattern)] if not wanted else [_named(numbers, pattern) or _frequency(numbers)]
            if not names[0]:
                continue
            if role == "surfaces":
                names = [key for key in numbers if re.fullmatch(pattern, key, re.I)]
        values = np.column_stack([_si(numbers[key], key) for key in names if key])
        if role == "quaternion":
            values = _angles(values)
        if len(one.time_us) > 10 and np.isfinite(values).any():
            yield _ordered(name, role, one.time_us, values)


def _named(columns: Mapping[str, Any], pattern: str) -> str | None:
    return next((name for name in columns if re.fullmatch(pattern, name, re.I)), None)


def _frequency(columns: Mapping[str, Any]) -> str | None:
    return next((name for name in columns if re.search(r"freq|hz", name, re.I)), None)


def _si(values: NDArray[Any], column: str) -> Array:
    lower = column.lower()
    unit = unit_of(lower)
    if not unit:
        unit = "g" if lower.endswith("_g") else ""
    known = CONVERSIONS.get(unit, CONVERSIONS[""])
    return np.asarray(np.asarray(values, float) * known.factor + known.offset, np.float64)


def _angles(quaternion: Array) -> Array:
    from wingbeat.rotation_arrays import euler_from_quaternions

    roll, pitch, yaw = euler_from_quaternions(*quaternion.T)
    return np.column_stack((roll, pitch, yaw))


def _ordered(topic: str, name: str, time_us: NDArray[np.int64], values: Array) -> Signal:
    """Return a signal in order of time, without repeated stamps and unknown values."""
    kept = nearly_ordered(time_us) & np.isfinite(values).all(axis=1)
    times, rows = np.unique(time_us[kept], return_index=True)
    return Signal(topic, name, times.astype(float), values[kept][rows])


def _seconds(time_us: NDArray[np.int64], begin: int) -> Array:
    return np.asarray((time_us - begin) * 1e-6, np.float64)


def _shifted(signal: Signal, begin: int) -> Signal:
    return signal._replace(time=(signal.time - begin) * 1e-6)
