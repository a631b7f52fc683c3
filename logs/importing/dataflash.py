"""ArduPilot's dataflash logs (``.bin``): every record behind two magic bytes, its format told in the file.

Records have no checksum. One is taken only where another record, or the end of the file, follows it; bytes between
them are counted as damage. Formats: https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics import topics as t
from avionics.messages import CHANNELS, Event, Severity
from avionics.quantities import BadInput, counted
from logs.importing.counterparts import (
    DRY_AIR,
    Columns,
    Counterpart,
    View,
    ground_velocity,
    pulse_array,
    true_airspeed,
)
from logs.importing.source import Array, Series, Source

MAGIC = b"\xa3\x95"
HEAD = 3
"""bytes; magic and the number of the format"""
FORMAT = 0x80
"""number of the format of formats"""
_CODES: dict[str, tuple[str, float]] = {
    "a": ("(32,)<i2", 1.0), "b": ("i1", 1.0), "B": ("u1", 1.0), "h": ("<i2", 1.0), "H": ("<u2", 1.0),
    "i": ("<i4", 1.0), "I": ("<u4", 1.0), "f": ("<f4", 1.0), "d": ("<f8", 1.0), "g": ("<f2", 1.0),
    "n": ("S4", 1.0), "N": ("S16", 1.0), "Z": ("S64", 1.0), "M": ("u1", 1.0), "q": ("<i8", 1.0), "Q": ("<u8", 1.0),
    "c": ("<i2", 1e2), "C": ("<u2", 1e2), "e": ("<i4", 1e2), "E": ("<u4", 1e2), "L": ("<i4", 1e7),
}  # fmt: skip
"""NumPy type of each letter, and what the stored number is divided by."""
_FMT = np.dtype([("type", "u1"), ("length", "u1"), ("name", "S4"), ("format", "S16"), ("columns", "S64")])
_OWN_TABLES = ("FMT", "UNIT", "MULT", "FMTU", "PARM", "MSG")
"""messages that say something of the file, and are not data"""
_UNITS = {
    "deglatitude": "deg",
    "deglongitude": "deg",
    "degheading": "deg",
    "Gauss": "gauss",
    "Ohm": "ohm",
    "W.h": "Wh",
    "W.s": "J",
    "A.s": "C",
    "Watt": "W",
}
"""ArduPilot's names of units that have another here."""
_ANGLES = dict.fromkeys(("Roll", "Pitch", "Yaw", "DesRoll", "DesPitch", "DesYaw"), "deg")
_FILTER = _ANGLES | dict.fromkeys(("VN", "VE", "VD"), "m/s") | dict.fromkeys(("PN", "PE", "PD"), "m")
_BATTERY = {"Volt": "V", "VoltR": "V", "Curr": "A", "CurrTot": "mAh", "EnrgTot": "Wh"}
_PLACE = {"Lat": "deg", "Lng": "deg", "Alt": "m"}
_INERTIAL = dict.fromkeys(("GyrX", "GyrY", "GyrZ"), "rad/s") | dict.fromkeys(("AccX", "AccY", "AccZ"), "m/s^2")
UNTOLD: Mapping[str, Mapping[str, str]] = {
    "ATT": _ANGLES,
    "AHR2": _ANGLES | _PLACE,
    "POS": _PLACE,
    "IMU": _INERTIAL,
    "IMU2": _INERTIAL,
    "IMU3": _INERTIAL,
    "EKF1": _FILTER,
    "NKF1": _FILTER,
    "XKF1": _FILTER,
    "MAG": dict.fromkeys(("MagX", "MagY", "MagZ", "OfsX", "OfsY", "OfsZ"), "mgauss"),
    "BARO": {"Alt": "m", "Press": "Pa", "Temp": "degC", "CRt": "m/s"},
    "ARSP": {"Airspeed": "m/s", "DiffPress": "Pa", "Temp": "degC"},
    "GPS": _PLACE | {"Spd": "m/s", "GCrs": "deg", "VZ": "m/s"},
    "CURR": {"Volt": "cV", "Curr": "cA", "CurrTot": "mAh"},
    "BAT": _BATTERY,
}
"""Units of logs older than 2018, which tell none."""
_WEEK_NS, _GPS_EPOCH_NS = 604_800 * 10**9, 315_964_800 * 10**9
_LEAPS = ((1135, 14), (1356, 15), (1695, 16), (1851, 17), (1930, 18))
"""GPS week from which so many leap seconds hold."""


class Kind(NamedTuple):
    """A format as the file tells it."""

    name: str
    record: np.dtype[np.void]
    """of the whole record, head included"""
    codes: Mapping[str, str]
    """letter of each column"""


class Records(NamedTuple):
    """What the bytes come to."""

    kinds: Mapping[int, Kind]
    places: Mapping[int, list[int]]
    """offsets of the whole records, by format"""
    damage: tuple[str, ...]


def is_dataflash(head: bytes) -> bool:
    """Whether a file that begins so is a dataflash log."""
    return head[:HEAD] == MAGIC + bytes([FORMAT])


def read_dataflash(data: bytes) -> Source:
    """Read a dataflash log; what is damaged is left out and told in ``damage``.

    Raises:
        BadInput: there is no whole record with a time in it.
    """
    records = find_records(data)
    tables = {
        kind.name: _columns(data, kind, records.places[number])
        for number, kind in records.kinds.items()
        if records.places.get(number)
    }
    units = _units(tables, records.kinds)
    clock = _clock(records, tables)
    series: dict[str, Series] = {}
    for number, kind in records.kinds.items():
        columns = tables.get(kind.name)
        if kind.name not in _OWN_TABLES and columns and clock is not None:
            times = clock.of(kind.name, columns, records.places[number])
            series |= _instances(_scaled(kind.name, times, columns, units.get(kind.name, {})))
    if not series:
        raise BadInput("there is no whole record with a time in it")
    texts = _texts(records, tables, clock)
    return Source(
        "dataflash", series, _vehicle(texts), _epoch_ns(series), (*texts, *_happened(series)),
        _parameters(tables), damage=records.damage,
    )  # fmt: skip


def find_records(data: bytes) -> Records:
    """Where the records stand, whichever are whole."""
    kinds: dict[int, Kind] = {FORMAT: Kind("FMT", _record(_FMT), {})}
    places: dict[int, list[int]] = {}
    lost: list[tuple[int, int]] = []
    used, at, cut = len(data.rstrip(b"\0\xff")), 0, ""
    while at < used:
        kind = kinds.get(data[at + 2]) if data.startswith(MAGIC, at) and at + 2 < len(data) else None
        end = at + HEAD if kind is None else at + kind.record.itemsize
        if end > len(data) and MAGIC.startswith(data[at : at + 2]):
            cut = f"cut off in the middle of a record, {counted(len(data) - at, 'byte')} before the end"
            break
        if kind is not None and (end >= used or MAGIC.startswith(data[end : end + 2])):
            places.setdefault(data[at + 2], []).append(at)
            if data[at + 2] == FORMAT:
                _learn(data, at, kinds)
            at = end
            continue
        at = _skip(data, at, lost)
    size = sum(last - first for first, last in lost)
    told = f"{counted(size, 'byte')} in {counted(len(lost), 'place')} that are no whole record" if lost else ""
    return Records(kinds, places, tuple(filter(None, (told, cut))))


def _skip(data: bytes, at: int, lost: list[tuple[int, int]]) -> int:
    """The next place where a record may begin; what lies before it is added to ``lost``."""
    after = data.find(MAGIC, at + 1)
    after = len(data) if after < 0 else after
    begin = lost.pop()[0] if lost and lost[-1][1] == at else at
    lost.append((begin, after))
    return after


def _record(body: np.dtype[np.void]) -> np.dtype[np.void]:
    return np.dtype([("/head", f"S{HEAD}"), *((name, body.fields[name][0]) for name in body.names or ())])  # type: ignore[index]


def _learn(data: bytes, at: int, kinds: dict[int, Kind]) -> None:
    """Take a format into ``kinds``; one that contradicts itself, or one from before, is not."""
    row = np.frombuffer(data, _record(_FMT), 1, at)[0]
    name, letters, listed = (_text(row[key]) for key in ("name", "format", "columns"))
    columns = [column.strip() for column in listed.split(",") if column.strip()]
    if len(columns) != len(letters) or len(set(columns)) != len(columns):
        return
    taken = int(row["type"]) in kinds or name in (kind.name for kind in kinds.values())
    if taken or not re.fullmatch(r"\w{1,4}", name, re.ASCII) or any(letter not in _CODES for letter in letters):
        return
    types = [(column, _CODES[letter][0]) for column, letter in zip(columns, letters, strict=True)]
    record = _record(np.dtype(types)) if types else np.dtype([("/head", f"S{HEAD}")])
    if record.itemsize == int(row["length"]):
        kinds[int(row["type"])] = Kind(name, record, dict(zip(columns, letters, strict=True)))


def _text(value: bytes) -> str:
    return bytes(value).partition(b"\0")[0].decode("utf-8", "replace")


def _columns(data: bytes, kind: Kind, places: list[int]) -> Columns:
    """Columns of all records of a kind, as stored but for the divisor of their letter."""
    size = kind.record.itemsize
    rows = np.frombuffer(b"".join(data[at : at + size] for at in places), kind.record)
    return {
        name: _decoded(rows[name], kind.codes.get(name, "")) for name in kind.record.names or () if name != "/head"
    }


def _decoded(values: Array, letter: str) -> Array:
    if values.dtype.kind == "S":
        return np.array([_text(value) for value in values], object)
    divisor = _CODES[letter][1] if letter else 1.0
    return np.array(values) if divisor == 1.0 else values / divisor


def _times(name: str, columns: Columns) -> NDArray[np.int64] | None:
    """us since boot; of old logs in ``TimeMS``, which in their GPS messages is that of the GPS week."""
    column, factor = ("T", 1000) if name.startswith("GPS") and "T" in columns else ("TimeMS", 1000)
    if "TimeUS" in columns:
        column, factor = "TimeUS", 1
    values = columns.get(column)
    if values is None or values.dtype.kind not in "iu":
        return None
    return np.minimum(values, np.uint64(2**62 // factor)).astype(np.int64) * factor


class Clock(NamedTuple):
    """Where in the file it was what time."""

    places: list[int]
    time_us: NDArray[np.int64]

    def of(self, name: str, columns: Columns, places: list[int]) -> NDArray[np.int64]:
        """us since boot; of records without a time, that of the last one before them that has one."""
        times = _times(name, columns)
        if times is not None:
            return times
        last = np.searchsorted(self.places, places, side="right") - 1
        return np.asarray(self.time_us[np.maximum(last, 0)], np.int64)


def _clock(records: Records, tables: Mapping[str, Columns]) -> Clock | None:
    """By the message with a time that there is most of; None without any."""
    clocks = []
    for number, places in records.places.items():
        kind = records.kinds[number]
        times = _times(kind.name, tables[kind.name])
        if kind.name not in _OWN_TABLES and times is not None:
            clocks.append(Clock(places, times))
    return max(clocks, key=lambda clock: len(clock.places), default=None)


Told = Mapping[str, tuple[str, float]]
"""Unit and multiplier of each column; under ``#`` the name of the column that counts sensors."""


def _units(tables: Mapping[str, Columns], kinds: Mapping[int, Kind]) -> dict[str, Told]:
    """What the file tells of units, by message; nothing in logs older than 2018."""
    labels = {_letter(one): str(label) for one, label in _rows(tables, "UNIT", "Id", "Label")}
    factors = {_letter(one): float(by) for one, by in _rows(tables, "MULT", "Id", "Mult")} | {"-": 1.0, "?": 1.0}
    found: dict[str, Told] = {}
    for number, ids, by in _rows(tables, "FMTU", "FmtType", "UnitIds", "MultIds"):
        kind = kinds.get(int(number))
        if kind is not None:
            found[kind.name] = _units_of(kind, (str(ids), str(by)), labels, factors)
    return found


def _units_of(kind: Kind, told: tuple[str, str], labels: Mapping[str, str], factors: Mapping[str, float]) -> Told:
    found: dict[str, tuple[str, float]] = {}
    for (column, letter), unit, factor in zip(kind.codes.items(), *told, strict=False):
        if unit == "#":
            found["#"] = column, 1.0
        else:
            # The divisor of these letters is the multiplier.
            by = 1.0 if letter in "cCeEL" else factors.get(factor, 1.0)
            found[column] = labels.get(unit, ""), by if np.isfinite(by) and by else 1.0
    return found


def _rows(tables: Mapping[str, Columns], name: str, *columns: str) -> Iterator[tuple[Any, ...]]:
    """Rows of some columns of a message; none where the file lacks one."""
    table = tables.get(name, {})
    if all(column in table for column in columns):
        yield from zip(*(table[column].tolist() for column in columns), strict=True)


def _letter(number: Any) -> str:
    return chr(int(number) & 127) if isinstance(number, int) else ""


def _scaled(name: str, times: NDArray[np.int64], columns: Columns, told: Told) -> Series:
    """A series in the units that the file tells, or that logs of its time had."""
    out: Columns = {}
    units = {column: unit for column, unit in UNTOLD.get(name, {}).items() if column in columns} if not told else {}
    for column, values in columns.items():
        unit, factor = told.get(column, ("", 1.0))
        out[column] = values if factor == 1.0 or values.dtype.kind not in "iuf" else values * factor
        if unit:
            units[column] = _UNITS.get(unit, unit)
    own = [column for column in ("TimeUS", "TimeMS") if column in out and not (name[:3] == "GPS" and "T" in out)]
    for column in own:
        del out[column]
    instance = told.get("#", ("", 1.0))[0]
    return Series(name, times, out, units | ({"#": instance} if instance else {}))


def _instances(series: Series) -> dict[str, Series]:
    """A message that several sensors write, as one series for each: ``IMU``, ``IMU_1``."""
    column = series.units.get("#", "I" if series.name in ("IMU", "BARO", "MAG", "GPS", "XKF1", "NKF1") else "")
    units = {name: unit for name, unit in series.units.items() if name != "#"}
    series = series._replace(units=units)
    numbers = series.columns.get(column)
    if numbers is None:
        numbers = series.columns.get("C") if series.name in ("XKF1", "NKF1") else None
    if numbers is None or numbers.dtype.kind not in "iu":
        return {series.name: series}
    found = {}
    for place, number in enumerate(np.unique(numbers).tolist()):
        name = series.name if not place else f"{series.name}_{number}"
        found[name] = series.taken(numbers == number)._replace(name=name)
    return found


def _texts(records: Records, tables: Mapping[str, Columns], clock: Clock | None) -> tuple[Event, ...]:
    number = next((number for number, kind in records.kinds.items() if kind.name == "MSG"), -1)
    texts = tables.get("MSG", {}).get("Message")
    if texts is None or clock is None:
        return ()
    stamps = clock.of("MSG", tables["MSG"], records.places[number]).tolist()
    return tuple(Event(at, Severity.INFO, "vehicle", str(text)) for at, text in zip(stamps, texts, strict=True))


def _happened(series: Mapping[str, Series]) -> Iterator[Event]:
    """Modes, events and errors, in ArduPilot's numbers."""
    for name, severity, text, wanted in (
        ("MODE", Severity.INFO, "mode {}", ("Mode",)),
        ("EV", Severity.INFO, "event {}", ("Id",)),
        ("ERR", Severity.ERROR, "error {} of subsystem {}", ("ECode", "Subsys")),
    ):
        one = series.get(name)
        if one is not None and all(column in one.columns for column in wanted):
            rows = zip(*(one.columns[column].tolist() for column in wanted), strict=True)
            for at, row in zip(one.time_us.tolist(), rows, strict=True):
                yield Event(at, severity, "vehicle", text.format(*row))


def _parameters(tables: Mapping[str, Columns]) -> dict[str, float]:
    told = _rows(tables, "PARM", "Name", "Value")
    return {str(name): value for name, value in told if name and isinstance(value, float) and np.isfinite(value)}


def _vehicle(texts: tuple[Event, ...]) -> str:
    """What the log says of its firmware, as ``ArduCopter V3.3-dev``."""
    return next((event.text for event in texts if event.text.startswith(("Ardu", "APM", "Blimp", "Rover"))), "")


def _epoch_ns(series: Mapping[str, Series]) -> int:
    """ns since 1970 of the boot, by the first fix in three dimensions; 0 where there is none."""
    fixes = series.get("GPS")
    if fixes is None or "Status" not in fixes.columns:
        return 0
    week, within = (
        next((name for name in names if name in fixes.columns), "") for names in (("GWk", "Week"), ("GMS", "TimeMS"))
    )
    good = np.flatnonzero(fixes.columns["Status"] >= 3)
    if not len(good) or not week or not within:
        return 0
    first = good[len(good) // 2]
    weeks = int(fixes.columns[week][first])
    leaps = max((seconds for since, seconds in _LEAPS if weeks >= since), default=13)
    factor = 10**9 if fixes.units.get(within) == "s" else 10**6
    in_week = round(float(fixes.columns[within][first]) * factor)
    epoch = _GPS_EPOCH_NS + weeks * _WEEK_NS + in_week - leaps * 10**9 - int(fixes.time_us[first]) * 1000
    return max(epoch, 0)


# --- what the project's own topics are made of ------------------------------------------------------------


def _imu(view: View) -> Columns:
    columns = {f"accel_{axis}": view[f"Acc{axis.upper()}"] for axis in "xyz"}
    columns |= {f"gyro_{axis}": view[f"Gyr{axis.upper()}"] for axis in "xyz"}
    return columns | {f"mag_{axis}": view.held("MAG", f"Mag{axis.upper()}") for axis in "xyz"}


def _attitude(view: View) -> Columns:
    rates = {
        f"{name}_rate": view.held("IMU", f"Gyr{axis}") for name, axis in (("roll", "X"), ("pitch", "Y"), ("yaw", "Z"))
    }
    return {"roll": view["Roll"], "pitch": view["Pitch"], "yaw": view["Yaw"]} | rates


def _air_data(view: View) -> Columns:
    pressure, temperature = view.held("BARO", "Press"), view.held("BARO", "Temp")
    density = pressure / (DRY_AIR * temperature)
    return {
        "airspeed": true_airspeed(view["Airspeed"], density),
        "dynamic_pressure": view.get("DiffPress"),
        "static_pressure": pressure,
        "temperature": temperature,
        "density": density,
        "pressure_altitude": view.held("BARO", "Alt"),
    }


def _altitude(view: View) -> Columns:
    return {"altitude": view["Alt"], "climb_rate": view.get("CRt")}


def _filter_altitude(view: View) -> Columns:
    return {"altitude": -view["PD"], "climb_rate": -view["VD"]}


def _position(view: View) -> Columns:
    named = {"north": "PN", "east": "PE", "v_north": "VN", "v_east": "VE"}
    place = {"latitude": view.held("POS", "Lat"), "longitude": view.held("POS", "Lng")}
    return {field: view[column] for field, column in named.items()} | place


def _power(view: View) -> Columns:
    voltage, current = view["Volt"], view["Curr"]
    return {
        "voltage": voltage,
        "current": current,
        "power": voltage * current,
        "charge": view.get("CurrTot"),
        "energy": view.get("EnrgTot"),
        "resistance": view.get("Res"),
    }


def _gps(view: View) -> Columns:
    north, east = ground_velocity(view["Spd"], view["GCrs"])
    status = view["Status"]
    return {
        "latitude": view["Lat"],
        "longitude": view["Lng"],
        "altitude": view["Alt"],
        "v_north": north,
        "v_east": east,
        "v_down": view.get("VZ"),
        "horizontal_accuracy": view.held("GPA", "HAcc"),
        "vertical_accuracy": view.held("GPA", "VAcc"),
        "fix_type": np.where(status >= 2, status, 0),
        "satellites": view.get("NSats"),
    }


def _receiver(view: View) -> Columns:
    pulses = pulse_array(view, [f"C{number}" for number in range(1, CHANNELS + 1)], CHANNELS)
    return {"pulses": pulses, "rssi": np.full(len(pulses), 255)}


_NAVIGATION_FILTERS = ("XKF1", "NKF1", "EKF1")
COUNTERPARTS = (
    Counterpart(t.IMU, "IMU", _imu),
    Counterpart(t.ATTITUDE, "ATT", _attitude),
    Counterpart(t.AIR_DATA, "ARSP", _air_data),
    *(Counterpart(t.ALTITUDE, name, _filter_altitude) for name in _NAVIGATION_FILTERS),
    Counterpart(t.ALTITUDE, "BARO", _altitude),
    *(Counterpart(t.POSITION, name, _position) for name in _NAVIGATION_FILTERS),
    Counterpart(t.POWER, "BAT", _power),
    Counterpart(t.POWER, "CURR", _power),
    Counterpart(t.GPS, "GPS", _gps),
    Counterpart(t.RECEIVER, "RCIN", _receiver),
)
"""In the order in which they are tried."""
