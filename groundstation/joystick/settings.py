"""Settings of joysticks: a TOML file with one table for each device."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from groundstation.joystick.actions import Action, ActionKind, Assignments, parse_action
from groundstation.joystick.axes import MIN_TRAVEL, Axis, deflection, throttle_full_travel, throttle_upper_half
from groundstation.joystick.device import DeviceInfo, Reading
from groundstation.joystick.sticks import Sticks
from wingbeat.documents import parse_toml
from wingbeat.errors import DocumentError, InputError
from wingbeat.text import did_you_mean, read_error_text

STICKS = ("roll", "pitch", "yaw", "throttle")
OPTIONAL_STICKS = ("yaw",)
KEYS = ("name", "guid", *STICKS, "buttons", "switches")
FULL, UPPER_HALF = "full", "upper_half"
MAX_NUMBER = 255
"""-; largest number of an axis or button"""
POSITIONS = (2, 6)
"""-; least and largest number of positions of a switch"""
LIMITS: Mapping[str, tuple[float, float]] = {
    "min": (-1.0, 1.0),
    "center": (-1.0, 1.0),
    "max": (-1.0, 1.0),
    "deadzone": (0.0, 0.5),
    "expo": (0.0, 1.0),
}


class Settings(NamedTuple):
    """Settings of one device."""

    name: str
    """-; as the system reports it"""
    guid: str
    """-; of the model, empty for every device of this name"""
    roll: Axis
    pitch: Axis
    yaw: Axis | None
    """None for a device without a yaw axis: the yaw stick is centered"""
    throttle: Axis
    throttle_upper_half: bool = False
    """whether the throttle stick centers itself, and only its upper half is used"""
    assignments: Assignments = Assignments()

    def sticks(self, reading: Reading) -> Sticks:
        """Compute the deflections of the sticks."""
        raw = reading.axes
        throttle = throttle_upper_half if self.throttle_upper_half else throttle_full_travel
        return Sticks(
            deflection(self.roll, raw[self.roll.axis]),
            deflection(self.pitch, raw[self.pitch.axis]),
            0.0 if self.yaw is None else deflection(self.yaw, raw[self.yaw.axis]),
            throttle(self.throttle, raw[self.throttle.axis]),
        )

    def axes(self) -> dict[str, Axis]:
        """The axes that are assigned, by the name of the stick."""
        axes = {"roll": self.roll, "pitch": self.pitch, "yaw": self.yaw, "throttle": self.throttle}
        return {name: axis for name, axis in axes.items() if axis is not None}


def default_path() -> Path:
    """Return the settings file in the user's configuration folder."""
    if sys.platform == "darwin":
        folder = Path.home() / "Library" / "Application Support"
    elif sys.platform == "win32":
        folder = Path(os.environ.get("APPDATA") or Path.home() / "AppData" / "Roaming")
    else:
        folder = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
    return folder / "wingbeat" / "joystick.toml"


def load_settings(path: Path, must_exist: bool = True) -> tuple[Settings, ...]:
    """Read a settings file; empty if there is none and none is required.

    Raises:
        InputError: missing or unreadable file, syntax error, unknown key or action, value out of range.
    """
    if not must_exist and not path.exists():
        return ()
    try:
        return parse_settings(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read joystick settings {path}: {read_error_text(error)}") from None
    except (DocumentError, _InvalidValue) as error:
        raise InputError(f"{path}: {error}") from None


def find_settings(entries: Iterable[Settings], info: DeviceInfo) -> Settings | None:
    """Return the settings of a device: those with its GUID, else those with its name and no GUID; None without."""
    entries = tuple(entries)
    by_guid = (one for one in entries if one.guid and one.guid == info.guid)
    by_name = (one for one in entries if not one.guid and one.name == info.name)
    return next(by_guid, next(by_name, None))


def check_capabilities(settings: Settings, info: DeviceInfo) -> None:
    """Compare the numbers of axes and buttons in the settings with the device.

    Raises:
        InputError: the device has fewer.
    """
    used = max((*(axis.axis for axis in settings.axes().values()), *settings.assignments.switches))
    if used >= info.axes:
        raise InputError(f"joystick {info.name}: its settings use axis {used}, it has axes 0 to {info.axes - 1}")
    button = max(settings.assignments.buttons, default=-1)
    if button >= info.buttons:
        raise InputError(f"joystick {info.name}: its settings use button {button}, it has {info.buttons} buttons")


class _InvalidValue(ValueError):
    """A value that cannot be used; the message is one line without the name of the file."""


def parse_settings(text: str) -> tuple[Settings, ...]:
    """Parse the text of a settings file.

    Raises:
        DocumentError: syntax error.
        ValueError: a value that cannot be used.
    """
    document = parse_toml(text)
    _check_keys("", document, ("device",))
    tables = document.get("device", [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise _InvalidValue("device must be written as [[device]], one table for each device")
    entries = tuple(_device(number, table) for number, table in enumerate(tables, 1))
    keys = [(one.guid or one.name) for one in entries]
    for key in keys:
        if keys.count(key) > 1:
            raise _InvalidValue(f"{key!r} has {keys.count(key)} tables [[device]]; keep one")
    return entries


def _device(number: int, table: Mapping[str, Any]) -> Settings:
    where = f"device {number}"
    _check_keys(where, table, KEYS)
    name, guid = (_text(where, key, table.get(key, "")) for key in ("name", "guid"))
    if not name and not guid:
        raise _InvalidValue(f"{where} needs a name or a guid, see wingbeat gcs joystick --list")
    where = f"device {name or guid}"
    axes = {key: _axis(f"{where}: {key}", table[key], key) for key in STICKS if key in table}
    for key in STICKS:
        if key not in axes and key not in OPTIONAL_STICKS:
            raise _InvalidValue(f"{where}: table [device.{key}] is missing")
    assignments = Assignments(_buttons(where, table.get("buttons", {})), _switches(where, table.get("switches", {})))
    _check_unique(where, axes, assignments.switches)
    half = table["throttle"].get("range", FULL) == UPPER_HALF
    return Settings(name, guid, axes["roll"], axes["pitch"], axes.get("yaw"), axes["throttle"], half, assignments)


def _check_unique(where: str, axes: Mapping[str, Axis], switches: Iterable[int]) -> None:
    users: dict[int, str] = {}
    uses = [*((axis.axis, stick) for stick, axis in axes.items()), *((axis, "a switch") for axis in switches)]
    for axis, user in uses:
        if axis in users:
            raise _InvalidValue(f"{where}: axis {axis} is assigned to {users[axis]} and to {user}")
        users[axis] = user


def _axis(where: str, table: Any, stick: str) -> Axis:
    if not isinstance(table, dict):
        raise _InvalidValue(f"{where} must be a table of keys")
    _check_keys(where, table, (*Axis._fields, *(("range",) if stick == "throttle" else ())))
    if "axis" not in table:
        raise _InvalidValue(f"{where}: key axis is missing")
    if table.get("range", FULL) not in (FULL, UPPER_HALF):
        raise _InvalidValue(f'{where}: range must be "{FULL}" or "{UPPER_HALF}", not {table["range"]!r}')
    backward = table.get("reversed", False)
    if not isinstance(backward, bool):
        raise _InvalidValue(f"{where}: reversed must be true or false, not {backward!r}")
    values = {key: _number(f"{where}: {key}", table[key], *limits) for key, limits in LIMITS.items() if key in table}
    axis = Axis(_index(f"{where}: axis", table["axis"]), reversed=backward, **values)
    if min(axis.max - axis.center, axis.center - axis.min) < MIN_TRAVEL:
        order = f"{axis.min:g}, {axis.center:g}, {axis.max:g}"
        raise _InvalidValue(f"{where}: min, center, max are {order}; they must ascend by {MIN_TRAVEL:g} each")
    return axis


def _buttons(where: str, table: Any) -> dict[int, Action]:
    if not isinstance(table, dict):
        raise _InvalidValue(f"{where}: buttons must be a table of button number and action")
    return {_key(f"{where}: buttons", key): _action(f"{where}: buttons.{key}", text) for key, text in table.items()}


def _switches(where: str, table: Any) -> dict[int, tuple[Action, ...]]:
    if not isinstance(table, dict):
        raise _InvalidValue(f"{where}: switches must be a table of axis number and list of actions")
    switches: dict[int, tuple[Action, ...]] = {}
    for key, actions in table.items():
        if not isinstance(actions, list) or not POSITIONS[0] <= len(actions) <= POSITIONS[1]:
            low, high = POSITIONS
            raise _InvalidValue(f"{where}: switches.{key} must be a list of {low} to {high} actions, one a position")
        number = _key(f"{where}: switches", key)
        switches[number] = tuple(_action(f"{where}: switches.{key}", text) for text in actions)
        if Action(ActionKind.ARM_SWITCH) in switches[number]:
            raise _InvalidValue(f'{where}: switches.{key}: "arm/disarm" is for buttons; use "arm", "disarm"')
    return switches


def _action(where: str, text: Any) -> Action:
    try:
        return parse_action(_text(where, "action", text))
    except ValueError as error:
        raise _InvalidValue(str(error) if isinstance(error, _InvalidValue) else f"{where}: {error}") from None


def _key(where: str, key: str) -> int:
    if not (key.isascii() and key.isdigit() and len(key) <= 3 and int(key) <= MAX_NUMBER):
        raise _InvalidValue(f"{where}: {key!r} is not a number from 0 to {MAX_NUMBER}")
    return int(key)


def _index(where: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MAX_NUMBER:
        raise _InvalidValue(f"{where} must be a whole number from 0 to {MAX_NUMBER}, not {value!r}")
    return value


def _number(where: str, value: Any, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise _InvalidValue(f"{where} must be a number, not {value!r}")
    if not low <= value <= high:
        raise _InvalidValue(f"{where} = {value:g} is outside {low:g} to {high:g}")
    return float(value)


def _text(where: str, key: str, value: Any) -> str:
    if not isinstance(value, str):
        raise _InvalidValue(f"{where}: {key} must be text in quotes, not {value!r}")
    return value


def _check_keys(where: str, table: Mapping[str, Any], known: Iterable[str]) -> None:
    known = tuple(known)
    for key in table:
        if key not in known:
            start = f"{where}: " if where else ""
            raise _InvalidValue(f"{start}unknown key {key!r}{did_you_mean(key, known)}; known: {', '.join(known)}")
