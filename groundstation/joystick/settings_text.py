"""Settings of joysticks as TOML text, and their file."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

from groundstation.joystick.axes import Axis
from groundstation.joystick.settings import FULL, UPPER_HALF, Settings
from wingbeat.errors import InputError
from wingbeat.files import write_atomically

HEADING = "# Joysticks of wingbeat gcs URL joystick; all keys: docs/joystick.md"


def save_settings(path: Path, entries: Iterable[Settings]) -> Path | None:
    """Write a settings file; return the copy of the file that was replaced, None without one.

    Raises:
        InputError: it cannot be written; the old file is unchanged.
    """
    copy = path.with_name(path.name + ".bak")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replaced = path.exists()
        if replaced:
            shutil.copyfile(path, copy)
        write_atomically(path, settings_text(entries))
    except OSError as error:
        raise InputError(f"cannot write joystick settings {path}: {error.strerror or error}") from None
    return copy if replaced else None


def merge(entries: Iterable[Settings], changed: Settings) -> tuple[Settings, ...]:
    """Return ``entries`` with ``changed`` instead of those of the same device."""

    def is_same(one: Settings) -> bool:
        return one.guid == changed.guid if one.guid else one.name == changed.name

    return (*(one for one in entries if not is_same(one)), changed)


def settings_text(entries: Iterable[Settings]) -> str:
    """Return the text of a settings file."""
    return "\n".join([HEADING, *(line for one in entries for line in _device_lines(one))]) + "\n"


def _device_lines(settings: Settings) -> Iterator[str]:
    yield from ("", "[[device]]", f"name = {_quoted(settings.name)}")
    if settings.guid:
        yield f"guid = {_quoted(settings.guid)}"
    for stick, axis in settings.axes().items():
        yield from ("", f"[device.{stick}]", *_axis_lines(axis))
        if stick == "throttle":
            yield f'range = "{UPPER_HALF if settings.throttle_upper_half else FULL}"'
    buttons, switches = settings.assignments
    yield from ("", "[device.buttons]")
    yield from (f"{number} = {_quoted(action.text())}" for number, action in buttons.items())
    yield from ("", "[device.switches]")
    for number, actions in switches.items():
        yield f"{number} = [{', '.join(_quoted(action.text()) for action in actions)}]"


def _axis_lines(axis: Axis) -> Iterator[str]:
    for key, value in axis._asdict().items():
        yield f"{key} = {str(value).lower() if isinstance(value, bool) else repr(value)}"


def _quoted(text: str) -> str:
    # A JSON string is a TOML basic string, but for DEL.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
