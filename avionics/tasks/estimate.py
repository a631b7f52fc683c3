"""Estimation tasks: attitude, altitude and position."""

from __future__ import annotations

import filterpy.kalman  # noqa: F401  # a GPS fix without a barometer would import it, in flight

from avionics import topics
from avionics.calibration.procedure import RAW_IMU
from avionics.estimation import ahrs, gps_altitude
from avionics.estimation import altitude as altitude_filter
from avionics.estimation import position as position_filter
from avionics.guidance.modes import AIRBORNE
from avionics.messages import ImuSample
from avionics.sensing import air_data, preflight
from avionics.sensing.plausibility import baro_lost
from avionics.state import AutopilotState
from avionics.tasks.sense import PRESSURE_TICKS, silent
from wingbeat.topic import Publish


def attitude(s: AutopilotState, publish: Publish) -> None:
    """Estimate the attitude from the IMU, with alignment at standstill.

    A rejected sample is ignored.
    """
    imu, refused = s.frame.imu, s.plausibility.bad & 1
    if s.ahrs is None:
        if refused:
            return
        s.ahrs = ahrs.start(s.gains.ahrs, imu)
    if not (s.modes.armed or refused or s.modes.stage in AIRBORNE or s.calibration.kind in RAW_IMU):
        _align(s, imu)
    s.ahrs, s.attitude = ahrs.step(s.gains.ahrs, s.ahrs, imu, s.wing.frequency, s.air.airspeed, s.frame.gps)
    publish(topics.ATTITUDE, s.attitude)


def _align(s: AutopilotState, imu: ImuSample) -> None:
    """Update gyro offset and attitude at a standstill if a calibration is required."""
    pressure = None
    if s.frame.pressures is not None:
        pressure = air_data.calibrated(s.gains.air_data, s.frame.pressures.differential_counts)
    gains, first = s.gains.preflight, s.preflight.rest is None
    s.preflight, completed = preflight.step(gains, s.preflight, imu, pressure)
    if not completed:
        return
    assert s.preflight.rest is not None and s.ahrs is not None
    means = s.preflight.rest.means
    if first or not ahrs.aligned(s.gains.ahrs, s.ahrs, means.rate):
        mean = ImuSample(imu.time_us, *means.force, *means.rate, *means.field)
        s.ahrs = ahrs.align(s.gains.ahrs, mean, gains.window * gains.windows)


def altitude(s: AutopilotState, publish: Publish) -> None:
    """Estimate altitude and climb rate.

    The acceleration is accumulated in each tick; the filter advances at each pressure sample. A rejected IMU sample
    is not accumulated: a repeated acceleration from within a stroke would cause a drift of the altitude, and the gate
    would then reject the barometer.
    """
    if not s.plausibility.bad & 1:
        s.altitude_filter = altitude_filter.accumulate(s.altitude_filter, s.attitude.accel_down)
    due = s.clock.ticks % PRESSURE_TICKS == 0
    sampled = s.frame.pressures is not None
    if (due or sampled) and baro_lost(s.gains.plausibility, s.plausibility, s.clock.time_us):
        if due:
            _coast(s, publish)
        return
    if s.frame.gps is not None and not baro_lost(s.gains.plausibility, s.plausibility, s.clock.time_us):
        s.gps_altitude = gps_altitude.learn(s.gps_altitude, s.frame.gps, s.altitude.altitude)
    if sampled:
        s.altitude_filter, s.altitude = altitude_filter.step(
            s.gains.altitude_filter, s.altitude_filter, s.air, s.wing.frequency
        )
        publish(topics.ALTITUDE, s.altitude)


def _coast(s: AutopilotState, publish: Publish) -> None:
    """Propagate the altitude without a barometer, with the GPS altitude of new fixes."""
    fix = None
    if s.last_fix is not None:
        s.gps_altitude, fix = gps_altitude.climb(s.gps_altitude, s.last_fix)
    s.altitude_filter, s.altitude = altitude_filter.coast(
        s.gains.altitude_filter, s.altitude_filter, s.clock.time_us, fix, s.wing.frequency
    )
    publish(topics.ALTITUDE, s.altitude)


def position(s: AutopilotState, publish: Publish) -> None:
    """Estimate position and wind.

    The filter is propagated at each pressure sample, or at the same rate without them, and corrected by the last fix.
    """
    if s.frame.gps is not None:
        s.last_fix = s.frame.gps
    if s.frame.pressures is not None or silent(s):
        moved = position_filter.motion(s.attitude, s.air, s.altitude)
        s.position_filter, s.position = position_filter.step(
            s.gains.position_filter, s.position_filter, moved, s.last_fix
        )
        publish(topics.POSITION, s.position)
