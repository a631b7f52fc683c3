"""Markers of a C3D file, the exchange format of motion capture. Format: https://www.c3d.org/HTML/default.htm."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from logs.importing.motion_capture import NED_FROM_MOTIVE, NED_FROM_NEXUS, Track, plain_name, source_of, unique_names
from logs.importing.source import Array, Series, Source
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
_TEXTS = ("POINT:UNITS", "POINT:Y_SCREEN", "POINT:LABELS", "POINT:LABELS2", "ANALOG:LABELS", "ANALOG:UNITS")
"""character parameters that are read"""
_NUMBERS = (
    "POINT:FRAMES", "TRIAL:ACTUAL_START_FIELD", "TRIAL:ACTUAL_END_FIELD", "ANALOG:SCALE", "ANALOG:GEN_SCALE",
    "ANALOG:OFFSET", "ANALOG:USED", "ANALOG:RATE",
)  # fmt: skip
"""parameters of numbers that are read"""
_KINDS = {1: "i1", 2: "i2", 4: "f4"}
"""NumPy type of a parameter of numbers"""
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
        order, parameters, numbers = _parameters(data, BLOCK * (data[0] - 1))
        head = _head(data, order)
        head = head._replace(frames=_frame_count(head, numbers, len(data)))
        return _markers(data, head, order, parameters, numbers)
    except (struct.error, ValueError, IndexError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError("not a complete C3D file") from None


def _head(data: bytes, order: str) -> Head:
    points, analog, first, last = struct.unpack_from(f"{order}4H", data, 2)
    scale, block, _, rate = struct.unpack_from(f"{order}fHHf", data, 12)
    head = Head(points, analog, last - first + 1, scale, block, rate)
    counted_right = 0 < points <= MOST_POINTS and block >= 2
    if not counted_right or not 1.0 <= rate <= 10_000.0 or not 0.0 < abs(scale) < 1e6:
        raise InputError("its head tells no frames of markers at a rate that can be")
    return head


def _frame_count(head: Head, numbers: Mapping[str, Array], size: int) -> int:
    """Return the number of frames, which the 16 bits of the header cannot count beyond 65535.

    Raises:
        InputError: there is no frame.
    """
    first, last = (numbers.get(f"TRIAL:ACTUAL_{end}_FIELD") for end in ("START", "END"))
    if first is not None and last is not None and min(len(first), len(last)) == 2:
        # Two words of 16 bits, the low one first.
        begin, end = ((int(word[0]) & 0xFFFF) + ((int(word[1]) & 0xFFFF) << 16) for word in (first, last))
        if end - begin + 1 >= head.frames:
            return end - begin + 1
    room = size - BLOCK * (head.data_block - 1)
    whole = room // ((4 * head.points + head.analog) * (4 if head.scale < 0.0 else 2))
    if head.frames >= 65535:  # saturated
        return whole
    if whole - head.frames >= 65536 - BLOCK:  # counted modulo 65536
        return head.frames + 65536 * round((whole - head.frames) / 65536)
    if head.frames <= 0:
        raise InputError("its head tells no frames of markers at a rate that can be")
    return head.frames


def _parameters(data: bytes, at: int) -> tuple[str, dict[str, list[str]], dict[str, Array]]:
    """Byte order, and the parameters of text and of numbers that are read, by ``GROUP:NAME``."""
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
        else:
            places[group, name] = at + 2
        if not step:
            break
        at += step
    named = {f"{groups.get(group, '')}:{name}": place for (group, name), place in places.items()}
    texts = {
        name: _texts(data, name, named[name] + 1) for name in _TEXTS if name in named and data[named[name]] == 255
    }
    numbers = {name: _numbers(data, named[name], order) for name in _NUMBERS if name in named}
    return order, texts, numbers


def _numbers(data: bytes, at: int, order: str) -> Array:
    """A parameter of numbers, flat; empty for another type."""
    kind, count = _KINDS.get(data[at]), data[at + 1]
    sizes = list(data[at + 2 : at + 2 + count])
    begin = at + 2 + count
    if kind is None or begin + math.prod(sizes) * int(kind[1]) > len(data):
        return np.zeros(0)
    return np.frombuffer(data, np.dtype(f"{order}{kind}"), math.prod(sizes), begin).astype(float)


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


def _markers(
    data: bytes, head: Head, order: str, parameters: Mapping[str, list[str]], numbers: Mapping[str, Array]
) -> Source:
    values, analog, whole = _frames(data, head, order)
    unit = (parameters.get("POINT:UNITS") or ["mm"])[0].lower()
    if unit not in _UNITS:
        raise InputError(f"its markers are in {unit!r}; known: {', '.join(_UNITS)}")
    axes = NED_FROM_MOTIVE if (parameters.get("POINT:Y_SCREEN") or ["+Z"])[0] == "+Y" else NED_FROM_NEXUS
    labels = [*parameters.get("POINT:LABELS", []), *parameters.get("POINT:LABELS2", [])]
    time = np.arange(whole) / head.rate
    tracks = []
    for number in range(head.points):
        # A negative residual, or exactly zero in all axes: not reconstructed.
        seen = (values[:, number, 3:] >= 0.0) & values[:, number, :3].any(axis=1, keepdims=True)
        place = np.where(seen, values[:, number, :3], np.nan) @ axes.T * conversion(unit).factor
        label = labels[number] if number < len(labels) else ""
        tracks.append(Track(plain_name(label) or f"marker_{number + 1}", time, place))
    damage = f"cut off after {pluralize(whole, 'frame')} of {head.frames}"
    source = source_of(tracks, "C3D", (damage,) if whole < head.frames else ())
    channels = _analog(analog, head, parameters, numbers)
    return source if channels is None else source._replace(series={**source.series, channels.name: channels})


def _analog(
    samples: Array, head: Head, parameters: Mapping[str, list[str]], numbers: Mapping[str, Array]
) -> Series | None:
    """Return the analog channels, such as load cells, in the units of the file; None without any.

    A value is (stored - offset) * scale of the channel * general scale.
    """
    used = numbers.get("ANALOG:USED", np.zeros(0))
    count = int(used[0]) if len(used) else 0
    if count <= 0 or head.analog % count:
        return None
    rows = samples.reshape(-1, count)
    offset, scale = (_of_channels(numbers.get(f"ANALOG:{name}"), count) for name in ("OFFSET", "SCALE"))
    general = numbers.get("ANALOG:GEN_SCALE", np.ones(1))
    offset = np.zeros(count) if offset is None else offset
    values = (rows - offset) * (1.0 if scale is None else scale) * (general[0] if len(general) else 1.0)
    labels, told = parameters.get("ANALOG:LABELS", []), parameters.get("ANALOG:UNITS", [])
    names = unique_names(
        [plain_name(labels[n]) if n < len(labels) and labels[n] else f"channel_{n + 1}" for n in range(count)]
    )
    units = {name: told[n] for n, name in enumerate(names) if n < len(told)}
    rate = head.rate * head.analog / count
    stamps = np.rint(np.arange(len(rows)) / rate * 1e6).astype(np.int64)
    return Series("analog", stamps, dict(zip(names, values.T, strict=True)), units)


def _of_channels(values: Array | None, count: int) -> Array | None:
    return values[:count] if values is not None and len(values) >= count else None


def _frames(data: bytes, head: Head, order: str) -> tuple[Array, Array, int]:
    """Whole frames.

    Returns:
        x, y, z, residual of each marker (frames, points, 4) in the file's unit; analog samples (frames, n) as
        stored; number of frames.
    """
    kind = np.dtype(f"{order}f4" if head.scale < 0.0 else f"{order}i2")
    width, begin = 4 * head.points + head.analog, BLOCK * (head.data_block - 1)
    whole = min(head.frames, max(len(data) - begin, 0) // (width * kind.itemsize))
    if not whole:
        raise InputError("there is no whole frame in it")
    table = np.frombuffer(data, kind, whole * width, begin).reshape(whole, width)
    values = table[:, : 4 * head.points].astype(float).reshape(whole, head.points, 4)
    if head.scale > 0.0:
        values[:, :, :3] *= head.scale
    return values, table[:, 4 * head.points :].astype(float), whole
