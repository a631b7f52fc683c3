"""ArduPilot's dataflash logs (``.bin``): times, units, sensors of one kind, texts, parameters."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.importing.checks import boots
from logs.importing.counterparts import Columns
from logs.importing.dataflash_records import Kind, Records, columns_of, find_records
from logs.importing.source import History, Series, Source
from wingbeat.errors import InputError
from wingbeat.message import Event, Severity

_OWN_TABLES = ("FMT", "UNIT", "MULT", "FMTU", "PARM", "MSG")
"""messages that describe the file and contain no data"""
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
"""ArduPilot unit names that differ from those of Wingbeat."""
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
"""Units of logs older than 2018, which contain none."""
_WEEK_NS, _GPS_EPOCH_NS = 604_800 * 10**9, 315_964_800 * 10**9
_LEAPS = ((1135, 14), (1356, 15), (1695, 16), (1851, 17), (1930, 18))
"""GPS week from which each number of leap seconds is valid."""


def read_dataflash(data: bytes) -> list[Source]:
    """Read a dataflash log; damaged parts are omitted and listed in ``damage``.

    Returns:
        one source for each boot, in the order of the file.

    Raises:
        InputError: no complete record with a time.
    """
    records = find_records(data)
    tables = _tables(data, records)
    units = _units(tables, records.kinds)
    parts = _boots(records, tables)
    whole = tables if len(parts) == 1 else None
    sources = [_source(whole or _tables(data, part), part, units) for part in parts]
    found = [one for one in sources if one is not None]
    if not found:
        raise InputError("there is no whole record with a time in it")
    return found


def _source(tables: Mapping[str, Columns], records: Records, units: Mapping[str, Told]) -> Source | None:
    """Return the records of one boot; None without a time in them."""
    clock = _clock(records, tables)
    series: dict[str, Series] = {}
    for number, kind in records.kinds.items():
        columns = tables.get(kind.name)
        if kind.name not in _OWN_TABLES and columns and clock is not None:
            times = clock.of(kind.name, columns, records.places[number])
            series |= _instances(_scaled(kind.name, times, columns, units.get(kind.name, {})))
    if not series:
        return None
    texts, values = _texts(records, tables, clock), _parameters(tables)
    return Source(
        "dataflash", series, _vehicle(texts), _epoch_ns(series), (*texts, *_happened(series)),
        values.initial, tuple(values.changes), damage=records.damage,
    )  # fmt: skip


def _tables(data: bytes, records: Records) -> dict[str, Columns]:
    return {
        kind.name: columns_of(data, kind, records.places[number])
        for number, kind in records.kinds.items()
        if number in records.places
    }


def _boots(records: Records, tables: Mapping[str, Columns]) -> list[Records]:
    """Return the records of each boot."""
    places, stamps = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for number, kind in records.kinds.items():
        times = _times(kind.name, tables[kind.name]) if kind.name in tables else None
        if times is not None:
            places.append(records.places[number])
            stamps.append(times)
    every, times = np.concatenate(places), np.concatenate(stamps)
    order = np.argsort(every, kind="stable")
    first = boots(times[order]) if len(every) else [0]
    edges = [0, *every[order][first[1:]].tolist(), 2**62]
    return [
        records._replace(
            places={
                number: part
                for number, some in records.places.items()
                if len(part := some[slice(*np.searchsorted(some, (begin, end)))])
            }
        )
        for begin, end in itertools.pairwise(edges)
    ]


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
    """Times by location in the file."""

    places: NDArray[np.int64]
    time_us: NDArray[np.int64]

    def of(self, name: str, columns: Columns, places: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return us since boot; a record without a time has that of the previous record with one."""
        times = _times(name, columns)
        if times is not None:
            return times
        last = np.searchsorted(self.places, places, side="right") - 1
        return np.asarray(self.time_us[np.maximum(last, 0)], np.int64)


def _clock(records: Records, tables: Mapping[str, Columns]) -> Clock | None:
    """Build the clock from the most frequent message with a time; None without any."""
    clocks = []
    for number, places in records.places.items():
        kind = records.kinds[number]
        times = _times(kind.name, tables.get(kind.name, {}))
        if kind.name not in _OWN_TABLES and times is not None:
            clocks.append(Clock(places, times))
    return max(clocks, key=lambda clock: len(clock.places), default=None)


Told = Mapping[str, tuple[str, float]]
"""Unit and multiplier of each column; under ``#`` the name of the column that counts sensors."""


def _units(tables: Mapping[str, Columns], kinds: Mapping[int, Kind]) -> dict[str, Told]:
    """Return the units in the file, by message; empty for logs older than 2018."""
    labels = {_letter(one): str(label) for one, label in _rows(tables, "UNIT", "Id", "Label")}
    factors = {_letter(one): float(by) for one, by in _rows(tables, "MULT", "Id", "Mult")} | {"-": 1.0, "?": 1.0}
    found: dict[str, Told] = {}
    for number, ids, by in _rows(tables, "FMTU", "FmtType", "UnitIds", "MultIds"):
        kind = kinds.get(int(number))
        if kind is not None:
            found[kind.name] = _units_of(kind, (str(ids), str(by)), labels, factors)
    return found


def _units_of(
    kind: Kind, definitions: tuple[str, str], labels: Mapping[str, str], factors: Mapping[str, float]
) -> Told:
    found: dict[str, tuple[str, float]] = {}
    for (column, letter), unit, factor in zip(kind.codes.items(), *definitions, strict=False):
        if unit == "#":
            found["#"] = column, 1.0
        else:
            # The divisor of these letters is the multiplier.
            by = 1.0 if letter in "cCeEL" else factors.get(factor, 1.0)
            found[column] = labels.get(unit, ""), by if np.isfinite(by) and by else 1.0
    return found


def _rows(tables: Mapping[str, Columns], name: str, *columns: str) -> Iterator[tuple[Any, ...]]:
    """Return the rows of some columns of a message; empty if the file lacks one."""
    table = tables.get(name, {})
    if all(column in table for column in columns):
        yield from zip(*(table[column].tolist() for column in columns), strict=True)


def _letter(number: Any) -> str:
    return chr(int(number) & 127) if isinstance(number, int) else ""


def _scaled(name: str, times: NDArray[np.int64], columns: Columns, definitions: Told) -> Series:
    """Convert a series with the units of the file, or with those of older logs."""
    out: Columns = {}
    units = (
        {column: unit for column, unit in UNTOLD.get(name, {}).items() if column in columns}
        if not definitions
        else {}
    )
    for column, values in columns.items():
        unit, factor = definitions.get(column, ("", 1.0))
        out[column] = values if factor == 1.0 or values.dtype.kind not in "iuf" else values * factor
        if unit:
            units[column] = _UNITS.get(unit, unit)
    imported = [column for column in ("TimeUS", "TimeMS") if column in out and not (name[:3] == "GPS" and "T" in out)]
    for column in imported:
        del out[column]
    instance = definitions.get("#", ("", 1.0))[0]
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
    """Return modes, events and errors, with ArduPilot's numbers."""
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


def _parameters(tables: Mapping[str, Columns]) -> History:
    """Return the first value of each parameter, and different ones later with their times."""
    table, values = tables.get("PARM", {}), History()
    times = _times("PARM", table)
    stamps = itertools.repeat(0) if times is None else times.tolist()
    for at, (name, value) in zip(stamps, _rows(tables, "PARM", "Name", "Value"), strict=False):
        if name and isinstance(value, float) and np.isfinite(value):
            values.add(at, str(name), value)
    return values


def _vehicle(texts: tuple[Event, ...]) -> str:
    """Return the firmware in the log, such as ``ArduCopter V3.3-dev``."""
    return next((event.text for event in texts if event.text.startswith(("Ardu", "APM", "Blimp", "Rover"))), "")


def _epoch_ns(series: Mapping[str, Series]) -> int:
    """Return the boot time in ns since 1970 from the first 3D fix; 0 without one."""
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
