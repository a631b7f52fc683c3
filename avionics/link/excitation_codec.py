"""Codec of identification inputs: three commands, as mission items or commands.

The commands are sent as COMMAND_LONG or COMMAND_INT.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from avionics.guidance.excitation import SEGMENTS, SWEEPS, harmonics
from avionics.guidance.mission import Channel, Excitation, Shape
from avionics.link.dialect import mavlink
from avionics.link.wire_item import ItemRefused, WireItem
from avionics.missions.excitations import check_excitation, on_channels

STEPS: int = mavlink.MAV_CMD_WINGBEAT_EXCITE
SWEEP: int = mavlink.MAV_CMD_WINGBEAT_EXCITE_SWEEP
MULTISINE: int = mavlink.MAV_CMD_WINGBEAT_EXCITE_MULTISINE

LOOPS_FLY_ON = 1000
"""offset of the repeats if the loops stay active"""
LOGARITHMIC = 10
"""offset of the channel for a logarithmic sweep"""
LOWEST = 1000
"""factor of the lowest harmonic of a multisine, added to the highest"""
_BY_CHANNEL_CODE = {
    offset + channel: (channel, shape)
    for offset, shape in ((0, Shape.LINEAR_SWEEP), (LOGARITHMIC, Shape.LOGARITHMIC_SWEEP))
    for channel in Channel
}


def decode_excitation(item: WireItem) -> Excitation:
    """Decode an identification input from a mission item or a command.

    Raises:
        ItemRefused: unknown channel or shape, or a number outside its range.
    """
    if not all(math.isfinite(value) for value in (*item.params, item.x, item.y, item.z)):
        raise ItemRefused(mavlink.MAV_MISSION_INVALID, "EXCITE: a parameter is not a number")
    requested = DECODERS[item.command](item, _repeats(item.x))
    refusal = check_excitation(requested)
    if refusal:
        raise ItemRefused(mavlink.MAV_MISSION_INVALID, f"EXCITE: {refusal}")
    return requested._replace(loops=int(item.x >= LOOPS_FLY_ON))


def _repeats(coded: float) -> int:
    if coded != int(coded) or not 0 <= coded < 2 * LOOPS_FLY_ON:
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM5_X, "EXCITE: repeats must be 1 to 100, or 1000 more")
    return int(coded) % LOOPS_FLY_ON


def _steps(item: WireItem, repeats: int) -> Excitation:
    channel, shape, amplitude, width = item.params
    if channel not in tuple(Channel):
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM1, "EXCITE: channel must be 0, 1 or 2")
    if shape not in SEGMENTS:
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM2, "EXCITE: shape must be 0 or 1")
    if not amplitude > 0.0:
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM3, "EXCITE: the amplitude must be above 0")
    return Excitation(Channel(int(channel)), Shape(int(shape)), amplitude, width, item.z, repeats)


def _sweep(item: WireItem, repeats: int) -> Excitation:
    code, amplitude, low, high = item.params
    if code not in _BY_CHANNEL_CODE:
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM1, "EXCITE: channel must be 0, 1 or 2, or 10 more")
    channel, shape = _BY_CHANNEL_CODE[int(code)]
    return Excitation(channel, shape, amplitude, item.y * 1e-3, item.z, repeats, low, high)


def _multisine(item: WireItem, repeats: int) -> Excitation:
    *amplitudes, period = item.params
    if not period > 0.0:
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM4, "EXCITE: the period must be above 0 s")
    first, last = divmod(int(item.y), LOWEST)
    requested = Excitation(
        Channel.ELEVATOR, Shape.MULTISINE, 0.0, period, item.z, repeats, first / period, last / period
    )
    return on_channels(requested, dict(zip(Channel, amplitudes, strict=True)))


DECODERS: dict[int, Callable[[WireItem, int], Excitation]] = {STEPS: _steps, SWEEP: _sweep, MULTISINE: _multisine}
"""decoders of the commands for an identification input"""


def encode_excitation(requested: Excitation) -> WireItem:
    """Return the input as a mission item with the command of its shape."""
    repeats = float(requested.repeats + LOOPS_FLY_ON * requested.loops)
    if requested.shape == Shape.MULTISINE:
        first, last = harmonics(requested)
        params = (*requested.amplitudes(), requested.width)
        return WireItem(
            mavlink.MAV_FRAME_MISSION, MULTISINE, params, repeats, float(LOWEST * first + last), requested.settle
        )
    if requested.shape in SWEEPS:
        code = float(requested.channel + (LOGARITHMIC if requested.shape == Shape.LOGARITHMIC_SWEEP else 0))
        params = (code, requested.amplitude, requested.low, requested.high)
        return WireItem(
            mavlink.MAV_FRAME_MISSION, SWEEP, params, repeats, float(round(requested.width * 1e3)), requested.settle
        )
    params = (float(requested.channel), float(requested.shape), requested.amplitude, requested.width)
    return WireItem(mavlink.MAV_FRAME_MISSION, STEPS, params, repeats, 0.0, requested.settle)
