"""Vibration sections in the text of a vehicle file."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import tomlkit

from logs.vibration.fit import VibrationFit
from wingbeat.documents import toml_text
from wingbeat.schema import field_hints, quantity_of

SECTIONS = ("vibration", "modes")
FITTED = ("reference_rate", "kick_phases", "stroke_scatter")
"""keys of [vibration] that a spectrum determines"""
BANK = "chosen: modes of the fit overlap at half power"
DEFAULT = "chosen: default, a spectrum does not determine it"


def with_vibration(text: str, fit: VibrationFit, source: str) -> str:
    """Return the text of a vehicle file with the fitted sections instead of its own.

    Args:
        text: TOML. Values of its [vibration] that a spectrum does not determine keep their sources.
        fit: sections.
        source: of the fitted values.
    """
    document = tomlkit.parse(text)
    kept = dict(document["vibration"].unwrap()) if "vibration" in document else {}
    for section in SECTIONS:
        if section in document:
            del document[section]
    return tomlkit.dumps(document).rstrip("\n") + "\n" + vibration_text(fit, source, kept)


def with_name(text: str, name: str) -> str:
    """Return the text of a vehicle file with another name."""
    document = tomlkit.parse(text)
    document["name"] = name
    return tomlkit.dumps(document)


def vibration_text(fit: VibrationFit, source: str, kept: Mapping[str, Any] = MappingProxyType({})) -> str:
    """Return the sections as TOML; ``kept`` are the entries of values that are not fitted."""
    modes = {
        name: _section(mode, source) | {"damping": _entry(mode, "damping", BANK)} for name, mode in fit.modes.items()
    }
    spec = _section(fit.spec, source)
    for name in spec:
        if name not in FITTED:
            spec[name] = kept.get(name) or _entry(fit.spec, name, DEFAULT)
    return toml_text({"vibration": spec, "modes": modes})


def _section(record: Any, source: str) -> dict[str, Any]:
    return {name: _entry(record, name, source) for name in record._fields}


def _entry(record: Any, name: str, source: str) -> dict[str, Any]:
    quantity, value = quantity_of(field_hints(type(record))[name]), getattr(record, name)
    plain = list(value) if isinstance(value, tuple) else value
    return {"value": plain, "unit": quantity.unit if quantity else "-", "source": source}
