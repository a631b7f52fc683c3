"""ArduPilot's JSON simulator interface in its own units: servo packets in, one line of JSON out.

Source: the description of the interface that comes with ArduPilot. Its reader looks for names as plain text and for
numbers right behind the colon: the line has no blanks, and ``velocity`` comes before ``velocity_wind``.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

from avionics.messages import ReceiverSample
from sim_bridge.messages import TruthState, TruthWing
from sim_bridge.observation import Observation

MAGIC_16, MAGIC_32 = 18458, 29569
_PACKETS = {MAGIC_16: struct.Struct("<HHI16H"), MAGIC_32: struct.Struct("<HHI32H")}
_MAGIC = struct.Struct("<H")
LEAST_TILT = 0.2
"""-; cosine of the tilt above which the rangefinder does not measure the ground distance"""
LONGEST_RANGE = 40.0
"""m; maximum range of the rangefinder"""
DIGITS = 9


class Servos(NamedTuple):
    """Decoded servo packet."""

    frame_rate: int
    """Hz; inverse of the step"""
    frame_count: int
    """increases by one per packet, 0 at ArduPilot's start"""
    widths: tuple[int, ...]
    """(16,) or (32,) us; pulse widths, 0 for no pulse"""


class Malformed(ValueError):
    """Error: the datagram is not a servo packet; the text has the reason."""


def decode_servos(data: bytes) -> Servos:
    """Decode one datagram.

    Raises:
        Malformed: another magic number or length, or a frame rate of 0.
    """
    if len(data) < _MAGIC.size:
        raise Malformed(f"{len(data)} bytes, too short")
    magic = _MAGIC.unpack_from(data)[0]
    packet = _PACKETS.get(magic)
    if packet is None:
        raise Malformed(f"magic number {magic}, expected {MAGIC_16} or {MAGIC_32}")
    if len(data) != packet.size:
        raise Malformed(f"{len(data)} bytes, expected {packet.size} for magic number {magic}")
    _, frame_rate, frame_count, *widths = packet.unpack(data)
    if frame_rate == 0:
        raise Malformed("its frame rate is 0")
    return Servos(frame_rate, frame_count, tuple(widths))


def encode_state(
    observation: Observation, truth: TruthState, wing: TruthWing, receiver: ReceiverSample | None
) -> bytes:
    """Encode one line of JSON between newlines: SI, radians, NED and FRD, quaternion (w, x, y, z).

    The distance to the ground (``rng_1``) is along the body's z axis, and missing if there is none in range. The
    pilot's channels (``rc``) are missing if there is no receiver signal.
    """
    line: dict[str, Any] = {
        "timestamp": round(observation.time_us * 1e-6, 6),
        "imu": {"gyro": _rounded(observation.omega_frd), "accel_body": _rounded(observation.specific_force_frd)},
        "position": _rounded(observation.position_ned),
        "velocity": _rounded(observation.v_ned),
        "quaternion": _rounded(observation.quaternion),
        "airspeed": round(max(observation.v_air_frd[0], 0.0), DIGITS),
        "velocity_wind": _rounded((truth.wind_north, truth.wind_east, truth.wind_down)),
        "battery": {"voltage": round(wing.voltage, DIGITS), "current": round(wing.current, DIGITS)},
    }
    distance = range_below(observation)
    if distance is not None:
        line["rng_1"] = round(distance, DIGITS)
    if receiver is not None and not receiver.lost:
        line["rc"] = {f"rc_{number}": pulse for number, pulse in enumerate(receiver.pulses, 1)}
    return b"\n" + json.dumps(line, separators=(",", ":")).encode() + b"\n"


def _rounded(vector: Sequence[float]) -> list[float]:
    return [round(value, DIGITS) for value in vector]


def range_below(observation: Observation) -> float | None:
    """Return the distance in m to flat ground along the body's z axis; None beyond range or tilt limit."""
    _, x, y, _ = observation.quaternion
    down = 1.0 - 2.0 * (x * x + y * y)
    if down < LEAST_TILT:
        return None
    distance = max(-observation.position_ned[2], 0.0) / down
    return distance if distance <= LONGEST_RANGE else None
