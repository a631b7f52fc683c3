"""Vibration sections in the text of a vehicle file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import tomlkit

from logs.vibration.fit import VibrationFit
from wingbeat.documents import toml_text
from wingbeat.schema import field_hints, quantity_of

SECTIONS = ("vibration", "modes")


def with_vibration(text: str, fit: VibrationFit, source: str) -> str:
    """Return the text of a vehicle file with the fitted sections instead of its own.

    Args:
        text: TOML.
        fit: sections.
        source: of every value.
    """
    document = tomlkit.parse(text)
    for section in SECTIONS:
        if section in document:
            del document[section]
    return tomlkit.dumps(document).rstrip("\n") + "\n" + vibration_text(fit, source)


def with_name(text: str, name: str) -> str:
    """Return the text of a vehicle file with another name."""
    document = tomlkit.parse(text)
    document["name"] = name
    return tomlkit.dumps(document)


def vibration_text(fit: VibrationFit, source: str) -> str:
    """Return the sections as TOML."""
    modes = {name: _section(mode, source) for name, mode in fit.modes.items()}
    return toml_text({"vibration": _section(fit.spec, source), "modes": modes})


def _section(record: Any, source: str) -> Mapping[str, Any]:
    hints, section = field_hints(type(record)), {}
    for name, value in record._asdict().items():
        quantity = quantity_of(hints[name])
        plain = list(value) if isinstance(value, tuple) else value
        section[name] = {"value": plain, "unit": quantity.unit if quantity else "-", "source": source}
    return section
