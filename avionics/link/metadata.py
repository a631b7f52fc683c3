"""Component metadata (COMPONENT_METADATA): compressed parameter files in JSON.

Format: https://mavlink.io/en/services/component_information.html, parameter schema version 3.
"""

from __future__ import annotations

import json
import lzma
import math
import zlib
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

from avionics.link.vehicle import Parameter, Storage
from wingbeat.errors import InputError

VENDOR = "Wingbeat"
"""vendor and model name"""
GENERAL = "metadata/general.json.xz"
PARAMETERS = "metadata/parameter.json.xz"
_TYPE_PARAMETER = 1
"""COMP_METADATA_TYPE_PARAMETER"""
_DIGITS = 4
"""significant digits of the displayed range"""
_MAX_DECIMALS = 7
"""limit of single precision"""


def uri(path: str) -> str:
    """MAVLink FTP URI of a file of this component."""
    return f"mftp://{path}"


def crc32(data: bytes) -> int:
    """Return the CRC-32 of MAVLink FTP: initial value 0, no final inversion."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


def component_metadata(
    parameters: Sequence[Parameter], storage: Storage | None, version: tuple[int, int, int]
) -> Mapping[str, bytes]:
    """Return the metadata files by path.

    Args:
        parameters: parameter table of the vehicle; its values are not used.
        storage: source of the default values; without one, no defaults are given.
        version: major, minor and patch of the firmware.
    """
    try:
        defaults = {} if storage is None else storage.defaults()
    except InputError:
        defaults = {}
    shapes = tuple(parameter._replace(value=0.0) for parameter in parameters)
    return _files(shapes, tuple(defaults.items()), version)


@lru_cache(maxsize=4)
def _files(
    parameters: tuple[Parameter, ...], defaults: tuple[tuple[str, float], ...], version: tuple[int, int, int]
) -> Mapping[str, bytes]:
    values = dict(defaults)
    table = _compress({"version": 3, "parameters": [_describe(each, values.get(each.name)) for each in parameters]})
    general = _compress(
        {
            "version": 1,
            "vendorName": VENDOR,
            "modelName": VENDOR,
            "firmwareVersion": ".".join(map(str, version)),
            "metadataTypes": [{"type": _TYPE_PARAMETER, "uri": uri(PARAMETERS), "fileCrc": crc32(table)}],
        }
    )
    return {GENERAL: general, PARAMETERS: table}


def _compress(content: Mapping[str, Any]) -> bytes:
    text = json.dumps(content, separators=(",", ":"), allow_nan=False).encode()
    # CRC64, Python's default, is optional in small decoders such as XZ Embedded.
    return lzma.compress(text, lzma.FORMAT_XZ, lzma.CHECK_CRC32)


def _describe(parameter: Parameter, default: float | None) -> dict[str, Any]:
    """Return one entry of the parameter file."""
    note = "; set only while disarmed" if parameter.is_locked_armed else ""
    entry: dict[str, Any] = {
        "name": parameter.name,
        "type": "Float",
        "shortDesc": parameter.description or parameter.key or parameter.name,
        "longDesc": f"{parameter.key or parameter.name} of the vehicle file{note}",
        "group": parameter.name.partition("_")[0],
        "category": "Standard",
        "decimalPlaces": 0 if parameter.is_integer else _decimals(parameter),
    }
    if parameter.choices:
        entry["values"] = [{"value": value, "description": text} for value, text in parameter.choices]
    if parameter.unit:
        entry["units"] = parameter.unit
    # JSON has no infinity: an unbounded limit is omitted.
    bounds = {"min": parameter.minimum, "max": parameter.maximum, "default": default}
    return entry | {name: value for name, value in bounds.items() if value is not None and math.isfinite(value)}


def _decimals(parameter: Parameter) -> int:
    """Return the decimal places for 4 significant digits of the range, at least 3."""
    span = parameter.maximum - parameter.minimum
    if not 0.0 < span < math.inf:
        return _MAX_DECIMALS
    return min(max(_DIGITS - math.ceil(math.log10(span)), 3), _MAX_DECIMALS)
