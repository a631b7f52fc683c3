"""Settings of joysticks: a TOML file with one table for each device."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from groundstation.joystick.actions import Action, ActionKind, Assignments
from groundstation.joystick.axes import (
    MAX_NUMBER,
    MIN_TRAVEL,
    Axis,
    deflection,
    throttle_full_travel,
    throttle_upper_half,
)
from groundstation.joystick.device import DeviceInfo, Reading
from groundstation.joystick.sticks import Sticks
from wingbeat.errors import InputError
from wingbeat.schema import check_keys, check_table, error_context, join, read_document, read_record, read_value

OPTIONAL_STICKS = ("yaw",)
FULL, UPPER_HALF = "full", "upper_half"
POSITIONS = (2, 6)
"""-; least and largest number of positions of a switch"""


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
    document = read_document(path, "joystick settings")
    with error_context(path):
        return read_settings(document)


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


def read_settings(document: Mapping[str, Any]) -> tuple[Settings, ...]:
    """Read the document of a settings file.

    Raises:
        InputError: unknown key or action, value out of range.
    """
    check_keys(document, ("device",))
    tables = document.get("device", [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise InputError("device must be written as [[device]], one table for each device")
    entries = []
    for number, table in enumerate(tables, 1):
        with error_context(f"device {table.get('name') or table.get('guid') or number}"):
            entries.append(_settings(read_record(_Device, table)))
    keys = [(one.guid or one.name) for one in entries]
    for key in keys:
        if keys.count(key) > 1:
            raise InputError(f"{key!r} has {keys.count(key)} tables [[device]]; keep one")
    return tuple(entries)


class _Throttle(NamedTuple):
    """An axis with one more key."""

    axis: Axis
    range: str

    @classmethod
    def from_entry(cls, entry: Any, key: str) -> _Throttle:
        """Read the table; `wingbeat.schema.read_record` calls this."""
        check_keys(check_table(entry, key), (*Axis._fields, "range"), key)
        axis = {name: value for name, value in entry.items() if name != "range"}
        span = read_value(Annotated[str, FULL, UPPER_HALF], entry.get("range", FULL), join(key, "range"))
        return cls(read_record(Axis, axis, key), span)


class _Device(NamedTuple):
    """The table of a device."""

    roll: Axis
    pitch: Axis
    throttle: _Throttle
    yaw: Axis | None = None
    name: str = ""
    guid: str = ""
    buttons: dict[str, Action] = {}
    switches: dict[str, tuple[Action, ...]] = {}


def _settings(device: _Device) -> Settings:
    if not device.name and not device.guid:
        raise InputError("a name or a guid is missing, see wingbeat gcs joystick --list")
    buttons = {_number(key, "buttons"): action for key, action in device.buttons.items()}
    switches = {_number(key, "switches"): _positions(key, actions) for key, actions in device.switches.items()}
    settings = Settings(
        device.name, device.guid, device.roll, device.pitch, device.yaw, device.throttle.axis,
        device.throttle.range == UPPER_HALF, Assignments(buttons, switches),
    )  # fmt: skip
    _check_axes(settings)
    return settings


def _check_axes(settings: Settings) -> None:
    users: dict[int, str] = {}
    uses = [(axis.axis, stick) for stick, axis in settings.axes().items()]
    for number, user in (*uses, *((axis, "a switch") for axis in settings.assignments.switches)):
        if number in users:
            raise InputError(f"axis {number} is assigned to {users[number]} and to {user}")
        users[number] = user
    for stick, axis in settings.axes().items():
        if min(axis.max - axis.center, axis.center - axis.min) < MIN_TRAVEL:
            order = f"{axis.min:g}, {axis.center:g}, {axis.max:g}"
            raise InputError(f"{stick}: min, center, max are {order}; they must ascend by {MIN_TRAVEL:g} each")


def _positions(key: str, actions: tuple[Action, ...]) -> tuple[Action, ...]:
    low, high = POSITIONS
    if not low <= len(actions) <= high:
        raise InputError(f"switches.{key} must be a list of {low} to {high} actions, one a position")
    if Action(ActionKind.ARM_SWITCH) in actions:
        raise InputError(f'switches.{key}: "arm/disarm" is for buttons; use "arm", "disarm"')
    return actions


def _number(key: str, table: str) -> int:
    if not (key.isascii() and key.isdigit() and len(key) <= 3 and int(key) <= MAX_NUMBER):
        raise InputError(f"{table}: {key!r} is not a number from 0 to {MAX_NUMBER}")
    return int(key)
