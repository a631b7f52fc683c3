"""Markers of a C3D file, the exchange format of motion capture. Format: https://www.c3d.org/HTML/default.htm."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.importing.motion_capture import NED_FROM_MOTIVE, NED_FROM_NEXUS, Track, plain_name, source_of
from logs.importing.source import Source
from logs.importing.units import conversion
from wingbeat.errors import InputError
from wingbeat.text import pluralize

BLOCK = 512
"""bytes"""
KEY = 0x50
"""second byte of every file"""
_ORDERS = {84: "<", 86: ">"}
"""byte order by processor number: Intel, MIPS"""
_UNITS = {"m": "m", "cm": "cm", "mm": "mm"}
_TEXTS = ("POINT:UNITS", "POINT:Y_SCREEN", "POINT:LABELS", "POINT:LABELS2")
"""character parameters that are read"""
MOST_POINTS = 4096
"""limit of the markers in a frame; a damaged header may contain any number up to 65535"""


class Head(NamedTuple):
    """Header block of the file."""

    points: int
    """markers in a frame"""
    analog: int
    """analog samples in a frame"""
    frames: int
    scale: float
    """of integers; negative if the data are floats"""
    data_block: int
    """number of the first data block, from 1"""
    rate: float
    """Hz"""


def read_c3d(data: bytes) -> Source:
    """Read the markers of a C3D file.

    Raises:
        InputError: not a C3D file, unknown processor, or no marker.
    """
    if len(data) < 2 * BLOCK or data[1] != KEY:
        raise InputError("it does not begin as a C3D file does")
    try:
        order, parameters = _parameters(data, BLOCK * (data[0] - 1))
        head = _head(data, order)
        return _markers(data, head, order, parameters)
    except (struct.error, ValueError, IndexError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError("not a complete C3D file") from None


def _head(data: bytes, order: str) -> Head:
    points, analog, first, last = struct.unpack_from(f"{order}4H", data, 2)
    scale, block, _, rate = struct.unpack_from(f"{order}fHHf", data, 12)
    head = Head(points, analog, last - first + 1, scale, block, rate)
    counted_right = 0 < points <= MOST_POINTS and head.frames > 0 and block >= 2
    if not counted_right or not 1.0 <= rate <= 10_000.0 or not 0.0 < abs(scale) < 1e6:
        raise InputError("its head tells no frames of markers at a rate that can be")
    return head


def _parameters(data: bytes, at: int) -> tuple[str, dict[str, list[str]]]:
    """Byte order, and the parameters that are read, by ``GROUP:NAME``."""
    order = _ORDERS.get(data[at + 3], "")
    if not order:
        raise InputError(f"it was written on a processor ({data[at + 3]}) whose numbers are not read here")
    groups: dict[int, str] = {}
    places: dict[tuple[int, str], int] = {}
    at += 4
    while True:
        length, group = struct.unpack_from("bb", data, at)
        if not length:
            break
        name = data[at + 2 : at + 2 + abs(length)].decode("ascii", "replace").upper()
        at += 2 + abs(length)
        step = struct.unpack_from(f"{order}H", data, at)[0]
        if group < 0:
            groups[-group] = name
        elif data[at + 2] == 255:  # characters
            places[group, name] = at + 3
        if not step:
            break
        at += step
    named = {f"{groups.get(group, '')}:{name}": place for (group, name), place in places.items()}
    return order, {name: _texts(data, name, named[name]) for name in _TEXTS if name in named}


def _texts(data: bytes, name: str, at: int) -> list[str]:
    """A parameter of characters: its dimensions, the first of which is the length of a text, then the texts.

    Raises:
        InputError: they are more than the file has.
    """
    count = data[at]
    sizes = list(data[at + 1 : at + 1 + count]) or [1]
    width, number = sizes[0], math.prod(sizes[1:])
    at += 1 + count
    if not width:
        return []
    if at + width * number > len(data):
        raise InputError(f"its parameter {name} has dimensions that do not fit into the file")
    return [data[at + n * width : at + (n + 1) * width].decode("utf-8", "replace").strip() for n in range(number)]


def _markers(data: bytes, head: Head, order: str, parameters: Mapping[str, list[str]]) -> Source:
    values, whole = _frames(data, head, order)
    unit = (parameters.get("POINT:UNITS") or ["mm"])[0].lower()
    if unit not in _UNITS:
        raise InputError(f"its markers are in {unit!r}; known: {', '.join(_UNITS)}")
    axes = NED_FROM_MOTIVE if (parameters.get("POINT:Y_SCREEN") or ["+Z"])[0] == "+Y" else NED_FROM_NEXUS
    labels = [*parameters.get("POINT:LABELS", []), *parameters.get("POINT:LABELS2", [])]
    time = np.arange(whole) / head.rate
    tracks = []
    for number in range(head.points):
        seen = values[:, number, 3:] >= 0.0  # a negative residual: not reconstructed
        place = np.where(seen, values[:, number, :3], np.nan) @ axes.T * conversion(unit).factor
        label = labels[number] if number < len(labels) else ""
        tracks.append(Track(plain_name(label) or f"marker_{number + 1}", time, place))
    damage = f"cut off after {pluralize(whole, 'frame')} of {head.frames}"
    return source_of(tracks, "C3D", (damage,) if whole < head.frames else ())


def _frames(data: bytes, head: Head, order: str) -> tuple[NDArray[np.float64], int]:
    """Whole frames as x, y, z, residual of each marker, (frames, points, 4) in the file's unit, and their number."""
    kind = np.dtype(f"{order}f4" if head.scale < 0.0 else f"{order}i2")
    width, begin = 4 * head.points + head.analog, BLOCK * (head.data_block - 1)
    whole = min(head.frames, max(len(data) - begin, 0) // (width * kind.itemsize))
    if not whole:
        raise InputError("there is no whole frame in it")
    table = np.frombuffer(data, kind, whole * width, begin).reshape(whole, width)
    values = table[:, : 4 * head.points].astype(float).reshape(whole, head.points, 4)
    if head.scale > 0.0:
        values[:, :, :3] *= head.scale
    return values, whole
