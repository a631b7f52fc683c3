"""IMU calibration: accelerometer offset and scale, hard and soft iron."""

from __future__ import annotations

from typing import Annotated, Final, NamedTuple

from avionics.messages import ImuSample
from wingbeat.units import Quantity


class Gains(NamedTuple):
    """Result of a calibration; neutral before one."""

    accel_offset: Annotated[tuple[float, float, float], Quantity("m/s^2", -20.0, 20.0)] = (0.0, 0.0, 0.0)
    """m/s^2; offset subtracted from the specific force along FRD x, y, z. Default: neutral until it is calibrated"""
    accel_scale: Annotated[tuple[float, float, float], Quantity("-", 0.5, 2.0)] = (1.0, 1.0, 1.0)
    """-; scale factor after the offset. Default: neutral until it is calibrated"""
    mag_offset: Annotated[tuple[float, float, float], Quantity("gauss", -10.0, 10.0)] = (0.0, 0.0, 0.0)
    """gauss; hard iron subtracted from the field along FRD x, y, z. Default: neutral until it is calibrated"""
    mag_scale: Annotated[tuple[float, float, float], Quantity("-", 0.2, 5.0)] = (1.0, 1.0, 1.0)
    """-; diagonal of the soft iron correction matrix. Default: neutral until it is calibrated"""
    mag_cross: Annotated[tuple[float, float, float], Quantity("-", -1.0, 1.0)] = (0.0, 0.0, 0.0)
    """-; elements xy, xz and yz of the symmetric soft iron matrix. Default: neutral until it is calibrated"""


NEUTRAL: Final = Gains()


def correct(gains: Gains, imu: ImuSample) -> ImuSample:
    """Apply the calibration to a sample; the gyro bias is left to the AHRS."""
    if gains == NEUTRAL:
        return imu
    (ax, ay, az), (p, q, r), (mx, my, mz) = imu.accel, imu.gyro, imu.mag
    (ox, oy, oz), (sx, sy, sz), (hx, hy, hz), (xx, yy, zz), (xy, xz, yz) = gains
    mx, my, mz = mx - hx, my - hy, mz - hz
    return ImuSample(
        imu.time_us,
        (ax - ox) * sx,
        (ay - oy) * sy,
        (az - oz) * sz,
        p,
        q,
        r,
        xx * mx + xy * my + xz * mz,
        xy * mx + yy * my + yz * mz,
        xz * mx + yz * my + zz * mz,
    )
