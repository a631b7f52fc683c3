"""The synthetic airframe of `flapping_airframe` as the simulated vehicle's own sensors see it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from flapping_airframe import Airframe, Array, Motion, fly, rotation_matrices
from scipy.spatial.transform import Rotation

from avionics.estimation import ahrs
from avionics.messages import Attitude, GpsFix, ImuSample, PressureSample
from avionics.sensing import air_data
from sim_bridge.environment.home import COLLEGE_PARK
from sim_bridge.observation import Observation
from sim_bridge.sensors.suite import SensorSpec, SensorSuite, sensor_spec
from sim_bridge.vehicles import load_vehicle

STILL = 8.0
"""s; in the hand before the throw"""
DECLINATION = COLLEGE_PARK.magnetic.declination
GAINS = ahrs.AhrsGains(declination=DECLINATION)


class Sensed(NamedTuple):
    """What the attitude filter is given in one tick."""

    imu: ImuSample
    airspeed: float
    """m/s; from the modelled pitot through `air_data`"""
    frequency: float
    """Hz"""
    fix: GpsFix | None


class Estimate(NamedTuple):
    """The filter's answer beside the truth."""

    time: Array
    """s"""
    error: Array
    """rad; of roll, pitch, yaw, shape (n, 3)"""
    attitudes: list[Attitude]

    def rms_deg(self, chosen: Array) -> Array:
        """RMS errors of roll, pitch and yaw in degrees over the ``chosen`` samples."""
        return np.asarray(np.degrees(np.sqrt(np.mean(self.error[chosen] ** 2, axis=0))))

    def column(self, name: str) -> Array:
        """One field of the attitudes."""
        return np.array([getattr(attitude, name) for attitude in self.attitudes])


def shipped() -> SensorSpec:
    """The sensors of a vehicle with all that calibration leaves wrong."""
    return sensor_spec(load_vehicle("robo_raven_ii_d").sections)


def calibrated(spec: SensorSpec) -> SensorSpec:
    """The same without errors of scale, offset and mounting: noise, resolution and the gyro's bias are left."""
    accel, gyro, mag = spec.accelerometer, spec.gyroscope, spec.magnetometer
    none = {"scale_sigma": 0.0, "misalignment_sigma_deg": 0.0}
    return spec._replace(
        accelerometer=accel._replace(offset_sigma_mg=0.0, **none),
        gyroscope=gyro._replace(**none),
        magnetometer=mag._replace(hard_iron_sigma_mg=0.0, **none),
    )


def sensed(spec: SensorSpec, airframe: Airframe, duration: float, seed: int) -> tuple[Motion, list[Sensed]]:
    """The flight of ``duration`` s after `STILL` s in the hand, without gyro bias or noise but those of ``spec``."""
    exact = airframe._replace(bias_deg=0.0, gyro_noise=0.0, accel_noise=0.0)
    motion = fly(exact, STILL + duration, STILL)
    suite = SensorSuite(spec, seed, COLLEGE_PARK)
    air, said = air_data.State(), 0.0
    given = []
    for tick, observation in enumerate(_observations(motion)):
        raw = suite.sample(observation, tick)
        if raw.pressures is not None:
            air, message = air_data.step(
                air_data.Gains(), air, PressureSample(*raw.pressures), motion.time[tick] < STILL - 1.0
            )
            said = message.airspeed
        frequency = airframe.frequency if motion.time[tick] > STILL + 0.5 else 0.0
        fix = GpsFix(*raw.gps) if raw.gps else None
        given.append(Sensed(ImuSample(*raw.imu), said, frequency, fix))
    return motion, given


def _observations(motion: Motion) -> list[Observation]:
    r = rotation_matrices(motion.euler)
    x, y, z, w = Rotation.from_matrix(r).as_quat().T
    quaternions = np.stack([w, x, y, z], axis=1).tolist()
    yaw = motion.euler[:, 2]
    course = np.stack([np.cos(yaw), np.sin(yaw), 0.0 * yaw], axis=1) * motion.airspeed[:, None]
    v_air = np.einsum("nji,nj->ni", r, course).tolist()
    return [
        Observation(
            imu.time_us + 5000, tuple(q), tuple(imu[4:7]), tuple(imu[1:4]), (0.0, 0.0, 0.0), tuple(v), tuple(through),
            101325.0, 288.15, 1.225, 0.0, 0.0, 0.0, 0.0, 0.0, 8.0, 0.05, 5.0, 300.0,
        )
        for imu, q, v, through in zip(motion.samples, quaternions, motion.v_ned.tolist(), v_air, strict=True)
    ]  # fmt: skip


def estimated(motion: Motion, given: list[Sensed], gains: ahrs.AhrsGains = GAINS) -> Estimate:
    """Run the filter over what it is given."""
    state = ahrs.start(gains, given[0].imu)
    attitudes = [ahrs.attitude(state)]
    for now in given[1:]:
        state, attitude = ahrs.step(gains, state, now.imu, now.frequency, now.airspeed, now.fix)
        attitudes.append(attitude)
    error = np.array([a[1:4] for a in attitudes]) - motion.euler
    return Estimate(motion.time, (error + np.pi) % (2.0 * np.pi) - np.pi, attitudes)
