"""Settings of joysticks as TOML text, and their file."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import tomlkit

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
    return f"{HEADING}\n\n" + tomlkit.dumps({"device": [_device(one) for one in entries]})


def _device(settings: Settings) -> dict[str, Any]:
    axes: dict[str, dict[str, Any]] = {stick: axis._asdict() for stick, axis in settings.axes().items()}
    axes["throttle"]["range"] = UPPER_HALF if settings.throttle_upper_half else FULL
    buttons, switches = settings.assignments
    return {
        "name": settings.name,
        **({"guid": settings.guid} if settings.guid else {}),
        **axes,
        "buttons": {str(number): action.text() for number, action in buttons.items()},
        "switches": {str(number): [action.text() for action in actions] for number, actions in switches.items()},
    }
