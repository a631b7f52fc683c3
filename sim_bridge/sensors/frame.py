"""The rate of sensor frames, and the precision of IMU samples on the wire."""

from __future__ import annotations

import struct

from wingbeat.samples import ImuSample

TICK_RATE = 200.0
"""Hz; IMU and encoders are sampled at every tick"""
_ON_THE_WIRE = struct.Struct("<9f")


def imu_on_the_wire(time_us: int, *values: float) -> ImuSample:
    """Round the nine ``values`` of an IMU sample to 32-bit floats, as MAVLink carries them.

    Raises:
        struct.error: ``values`` are not nine.
    """
    return ImuSample(time_us, *_ON_THE_WIRE.unpack(_ON_THE_WIRE.pack(*values)))
