"""Small logs as other programs write them, and where the large real ones are."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from logs.importing.log_import import Choice, ImportReport, import_log

Tables = dict[str, tuple[Any, dict[str, Any]]]
"""time in us and columns by topic"""
ROOT = Path(__file__).parents[3]
DATA = ROOT / "tests" / "data" / "logs"
SHARED = Path(os.environ.get("WINGBEAT_SHARED", ROOT.parent / "shared")) / "data" / "logs"
needs_shared = pytest.mark.skipif(
    not SHARED.is_dir(),
    reason="the large logs are not here: set WINGBEAT_SHARED or put a folder `shared` beside the repository",
)
CODES = {"n": "4s", "N": "16s", "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B"}


def imported(source: Path, folder: Path, **options: Any) -> tuple[Path, ImportReport]:
    out = folder / f"{source.name}.mcap"
    return out, import_log(Choice(source, out, **options))


class Dataflash:
    """Writes dataflash records."""

    def __init__(self) -> None:
        self.data = b""
        self.records: list[int] = []
        """offset of each record"""
        self._formats: dict[str, tuple[int, str]] = {}
        self._add(0x80, struct.pack("<BB4s16s64s", 0x80, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"))

    def define(self, name: str, letters: str, columns: str) -> None:
        number = 129 + len(self._formats)
        self._formats[name] = number, "<" + "".join(CODES.get(letter, letter) for letter in letters)
        size = 3 + struct.calcsize(self._formats[name][1])
        head = struct.pack("<BB4s16s64s", number, size, name.encode(), letters.encode(), columns.encode())
        self._add(0x80, head)

    def write(self, name: str, *values: Any) -> None:
        number, packing = self._formats[name]
        plain = [value.encode() if isinstance(value, str) else value for value in values]
        self._add(number, struct.pack(packing, *plain))

    def number(self, name: str) -> int:
        return self._formats[name][0]

    def _add(self, number: int, body: bytes) -> None:
        self.records.append(len(self.data))
        self.data += b"\xa3\x95" + bytes([number]) + body


def new_dataflash(seconds: float = 4.0) -> Dataflash:
    """A log as of ArduPilot 4: units told, two IMUs in one message."""
    log = Dataflash()
    log.define("UNIT", "QbZ", "TimeUS,Id,Label")
    log.define("MULT", "Qbd", "TimeUS,Id,Mult")
    log.define("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
    log.define("PARM", "QNf", "TimeUS,Name,Value")
    log.define("MSG", "QZ", "TimeUS,Message")
    log.define("MODE", "QMBB", "TimeUS,Mode,ModeNum,Rsn")
    log.define("IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    log.define("ATT", "QccC", "TimeUS,Roll,Pitch,Yaw")
    log.define("BAT", "Qfff", "TimeUS,Volt,Curr,CurrTot")
    for letter, label in (("s", "s"), ("d", "deg"), ("h", "degheading"), ("E", "rad/s"), ("o", "m/s/s")):
        log.write("UNIT", 0, ord(letter), label)
    for letter, label in (("v", "V"), ("A", "A"), ("a", "Ah"), ("#", "instance"), ("-", "")):
        log.write("UNIT", 0, ord(letter), label)
    for letter, factor in (("F", 1e-6), ("C", 1e-3), ("B", 1e-2), ("-", 0.0), ("0", 1.0)):
        log.write("MULT", 0, ord(letter), factor)
    log.write("FMTU", 0, log.number("IMU"), "s#EEEooo", "F-000000")
    log.write("FMTU", 0, log.number("ATT"), "sddh", "FBBB")
    log.write("FMTU", 0, log.number("BAT"), "svAa", "F00C")
    log.write("PARM", 10, "Q_TILT_MAX", 45.0)
    log.write("MSG", 20, "ArduPlane V4.5.7 (0a1b2c3d)")
    log.write("MODE", 30, 5, 5, 1)
    for n in range(int(seconds * 50)):
        at = 1_000_000 + n * 20_000
        for instance in (0, 1):
            log.write("IMU", at, instance, 0.01 * n, 0.5, -0.25, 0.1, instance, -9.8)
        if n % 5 == 0:
            log.write("ATT", at + 1, 100 * n % 9000, -450, 27000)
        if n % 10 == 0:
            log.write("BAT", at + 2, 7.4, 12.5, 100.0)
    return log


def stamped(ground_us: int, message: Any, sender: Any) -> bytes:
    """A frame of a telemetry log behind the ground computer's clock."""
    return struct.pack(">Q", ground_us) + bytes(message.pack(sender))


def tlog(seconds: int = 20, boot_us: int = 1_700_000_000_000_000) -> bytes:
    """A plane (system 1) that was booted 5 s before its ground station (system 255) began to record."""
    plane, ground = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None, 255, 190)
    beat = mavlink.MAVLink_heartbeat_message
    out = b""
    for n in range(seconds * 10):
        boot_ms = 5000 + 100 * n
        late = boot_us + boot_ms * 1000 + (n % 3) * 7000  # the link's delay varies
        angle = 0.01 * (n % 50)
        attitude = mavlink.MAVLink_attitude_message(boot_ms, angle, -angle, 1.0, 0.1, 0.2, 0.3)
        out += stamped(late, attitude, plane)
        if n % 10 == 0:
            mode = 10 if n < 100 else 11
            out += stamped(late + 100, beat(1, 3, 128 + 1, mode, 4, 3), plane)
            out += stamped(late + 200, beat(6, 8, 0, 0, 4, 3), ground)
            status = mavlink.MAVLink_sys_status_message(0, 0, 0, 300, 7400, 1250, 80, 0, 0, 0, 0, 0, 0)
            out += stamped(late + 300, status, plane)
        if n == 30:
            out += stamped(late + 400, mavlink.MAVLink_statustext_message(4, b"Low airspeed"), plane)
            value = mavlink.MAVLink_param_value_message(b"TRIM_ARSPD_CM", 1200.0, 9, 1, 0)
            out += stamped(late + 500, value, plane)
            command = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
            out += stamped(late + 600, command, ground)
    return out


def ulog(topics: Tables) -> bytes:
    """Write a ULog of topics: time in us and columns (n,) or (n, k) of floats."""

    def message(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000) + message("B", bytes(40))
    tables = []
    for number, (name, (stamps, columns)) in enumerate(topics.items()):
        sizes = {key: 1 if values.ndim == 1 else values.shape[1] for key, values in columns.items()}
        listed = "".join(f"float{'' if n == 1 else f'[{n}]'} {key};" for key, n in sizes.items())
        out += message("F", f"{name}:uint64_t timestamp;{listed}".encode())
        fields = [(f"f{place}", "<f4", (n,)) for place, n in enumerate(sizes.values())]
        rows = np.zeros(len(stamps), [("size", "<u2"), ("kind", "u1"), ("id", "<u2"), ("timestamp", "<u8"), *fields])
        rows["size"], rows["kind"], rows["id"], rows["timestamp"] = rows.itemsize - 3, ord("D"), number, stamps
        for (field, _, size), values in zip(fields, columns.values(), strict=True):
            rows[field] = values.reshape(-1, *size)
        tables.append((stamps, rows))
    for number, name in enumerate(topics):
        out += message("A", struct.pack("<BH", 0, number) + name.encode())
    return out + interleaved(tables)


def interleaved(tables: list[tuple[Any, Any]]) -> bytes:
    """Return the bytes of records of several kinds; the order is that of the running maximum of their times."""
    times = np.concatenate([np.maximum.accumulate(stamps) for stamps, _ in tables])
    sizes = np.repeat([rows.itemsize for _, rows in tables], [len(rows) for _, rows in tables])
    order = np.argsort(times, kind="stable")
    offsets = np.empty(len(order), np.int64)
    offsets[order] = np.cumsum(sizes[order]) - sizes[order]
    data, first = np.zeros(int(sizes.sum()), np.uint8), 0
    for _, rows in tables:
        places = offsets[first : first + len(rows), None] + np.arange(rows.itemsize)
        data[places] = rows.view(np.uint8).reshape(len(rows), rows.itemsize)
        first += len(rows)
    return data.tobytes()


def dataflash(topics: Tables) -> bytes:
    """Write a dataflash log of messages: time in us and columns (n,); floats, or unsigned bytes as they are."""
    log = Dataflash()
    for name, (_, columns) in topics.items():
        letters = "".join("B" if values.dtype == np.uint8 else "f" for values in columns.values())
        log.define(name, "Q" + letters, ",".join(("TimeUS", *columns)))
    tables = []
    for name, (stamps, columns) in topics.items():
        types = [(key, "u1" if values.dtype == np.uint8 else "<f4") for key, values in columns.items()]
        rows = np.zeros(len(stamps), [("head", "<u2"), ("type", "u1"), ("TimeUS", "<u8"), *types])
        rows["head"], rows["type"], rows["TimeUS"] = 0x95A3, log.number(name), stamps
        for key, values in columns.items():
            rows[key] = values
        tables.append((stamps, rows))
    return log.data + interleaved(tables)
