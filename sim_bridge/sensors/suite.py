"""All sensors of a vehicle: an Observation in, a SensorFrame out, at 200 Hz or another tick rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple, get_type_hints

import numpy as np

from sim_bridge import observation as o
from sim_bridge.compiled import Bound, entry_point
from sim_bridge.environment.home import Home
from sim_bridge.observation import Observation, Vector
from sim_bridge.sensors.accelerometer import Accelerometer, AccelerometerSpec
from sim_bridge.sensors.barometer import Barometer, BarometerSpec
from sim_bridge.sensors.encoder import Encoder, EncoderSpec
from sim_bridge.sensors.frame import TICK_RATE
from sim_bridge.sensors.gps import Gps, GpsSpec
from sim_bridge.sensors.gyroscope import Gyroscope, GyroscopeSpec
from sim_bridge.sensors.magnetometer import Magnetometer, MagnetometerSpec
from sim_bridge.sensors.noise import CommonRows, sensor_seed
from sim_bridge.sensors.optional import OPTIONAL, OptionalRow, OptionalSensor
from sim_bridge.sensors.pitot import Pitot, PitotSpec
from sim_bridge.sensors.power_sensor import PowerSensor, PowerSensorSpec
from sim_bridge.sensors.receiver import Pilot, Receiver, ReceiverSpec
from sim_bridge.sensors.sense import LARGEST, SuiteArrays, sense
from sim_bridge.sensors.torque_cell import TorqueCell
from sim_bridge.sensors.torque_cell_spec import TorqueCellSpec
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError
from wingbeat.samples import AdcBurst, EncoderSample, ImuSample, PressureSample, SensorFrame, TorqueSample

MAGNETOMETER_RATE = 75.0
"""Hz; the most the HMC5883L gives; its last reading is repeated in between"""
PRESSURE_RATE = 50.0
"""Hz"""
POWER_RATE = 100.0
"""Hz"""
GPS_RATE = 5.0
"""Hz"""
RECEIVER_RATE = 50.0
"""Hz"""
_FIELD = {name: index for index, name in enumerate(SensorFrame._fields)}
_IMU, _ENCODER, _PRESSURES, _ADC, _TORQUE, _GPS = map(
    _FIELD.__getitem__, ("imu", "encoder", "pressures", "adc", "torque", "gps")
)


BLANK = TorqueCellSpec(False, 1.0, 1.0, 0.0, 0.0, 0.0)
"""kernel arguments of a vehicle without torque cells"""


class Ticks(NamedTuple):
    """Ticks from one sample to the next of the sensors that are slower than the tick."""

    magnetometer: int
    pressures: int
    power: int
    gps: int
    receiver: int


def ticks_between(rate: float, sensor_rate: float) -> int:
    """Return the ticks at ``rate`` (Hz) from one sample to the next of a sensor with at most ``sensor_rate`` (Hz)."""
    return max(1, math.ceil(rate / sensor_rate - 1e-9))


def ticks_of(rate: float) -> Ticks:
    """Return the ticks between samples of each required sensor at a tick rate in Hz."""
    sensors = (MAGNETOMETER_RATE, PRESSURE_RATE, POWER_RATE, GPS_RATE, RECEIVER_RATE)
    return Ticks(*(ticks_between(rate, sensor) for sensor in sensors))


class SensorSpec(NamedTuple):
    """Every sensor of a vehicle; a field is a section of the vehicle file."""

    accelerometer: AccelerometerSpec
    gyroscope: GyroscopeSpec
    magnetometer: MagnetometerSpec
    encoder: EncoderSpec
    pitot: PitotSpec
    barometer: BarometerSpec
    power_sensor: PowerSensorSpec
    gps: GpsSpec
    optional: Mapping[str, Any] = MappingProxyType({})
    """specifications of the optional sensors that the vehicle carries, by section"""


_REQUIRED = {name: hint for name, hint in get_type_hints(SensorSpec).items() if name != "optional"}
SECTIONS: dict[str, type[Any]] = _REQUIRED | {row.section: row.spec for row in OPTIONAL}
"""Sections of a vehicle file that describe sensors, for `wingbeat.vehicle_file.read_vehicle_file`."""


class SimulationDiverged(ArithmeticError):
    """The plant produced a value that is not a finite number, or absurdly large; the text names value and time."""


def sensor_spec(sections: Mapping[str, Any]) -> SensorSpec:
    """Return the sensor sections of a vehicle file's sections.

    Raises:
        InputError: the vehicle has no section of one of them.
    """
    for name in _REQUIRED:
        if name not in sections:
            raise InputError(f"the vehicle file has no section [{name}]: without its sensors it cannot be flown")
    optional = {row.section: sections[row.section] for row in OPTIONAL if row.section in sections}
    return SensorSpec(**{name: sections[name] for name in _REQUIRED}, optional=optional)


class SensorSuite:
    """All sensors of one vehicle on one flight: the same spec, seed, home and observations give the same frames."""

    def __init__(
        self,
        spec: SensorSpec,
        seed: int,
        home: Home,
        corner: float = 0.0,
        pilot: Pilot | None = None,
        rate: float = TICK_RATE,
        observed: Floats | None = None,
    ) -> None:
        """Build every sensor with a random stream of its own; a ``pilot`` brings a transmitter and its receiver.

        With a ``corner`` above 0 each error of a unit is that many standard deviations, its sign by chance. ``rate``
        in Hz is that of the ticks. A plant fills ``observed``; without one `sample` does.

        Raises:
            InputError: seed negative.
        """
        tick = 1.0 / rate
        self._ticks = ticks = ticks_of(rate)
        self.observed = np.zeros(o.SIZE) if observed is None else observed
        """(`observation.SIZE`,); input of `sense`"""
        # The number is the stream's name: a new sensor takes the next free one, so the others' noise stays.
        self._accelerometer = Accelerometer(spec.accelerometer, sensor_seed(seed, 0, corner), tick)
        self._gyroscope = Gyroscope(spec.gyroscope, sensor_seed(seed, 1, corner), tick)
        self._magnetometer = Magnetometer(spec.magnetometer, sensor_seed(seed, 2, corner), home.magnetic)
        self._pitot = Pitot(spec.pitot, sensor_seed(seed, 3, corner), tick)
        self._barometer = Barometer(spec.barometer, sensor_seed(seed, 4, corner), ticks.pressures * tick)
        self._power_sensor = PowerSensor(spec.power_sensor, sensor_seed(seed, 5, corner))
        self._optional: list[tuple[OptionalRow, OptionalSensor]] = [
            (row, row.build(spec.optional[row.section], sensor_seed(seed, row.stream, corner)))
            for row in OPTIONAL
            if row.section in spec.optional
        ]
        self._gps = Gps(spec.gps, sensor_seed(seed, 7, corner), home, ticks.gps * tick)
        self.encoder = Encoder(spec.encoder, sensor_seed(seed, 11))
        receiver = Receiver(ReceiverSpec(), sensor_seed(seed, 8), pilot)
        self._cells = TorqueCell(BLANK, sensor_seed(seed, 6))
        self._cell_ticks = 0
        self._interpreted: list[tuple[int, Callable[[Observation], Any], int]] = []
        """sensors that are not compiled: index in a `SensorFrame`, reading, ticks between samples"""
        for row, sensor in self._optional:
            every = ticks_between(rate, row.rate)
            if not isinstance(sensor, TorqueCell):
                self._interpreted.append((_FIELD[row.field], sensor.read, every))
            elif sensor.is_installed:
                self._cells, self._cell_ticks = sensor, every
        if pilot is not None:
            self._interpreted.append((_FIELD["receiver"], receiver.read, ticks.receiver))
        always = self._accelerometer.triad.normals, self._gyroscope.triad.normals, self._gyroscope.normals
        self._rows = CommonRows(*always, *([self.encoder.normals] if self.encoder.noise > 0.0 else []))
        self._pressure_rows = CommonRows(self._barometer.normals, self._pitot.normals)
        self._has_field = False
        self.field_per_ampere = np.zeros(3)
        """gauss/A, body axes; of the drive current at the magnetometer"""
        self.current_ripple = self._power_sensor.burst.ripple
        """(1,) -; standard deviation of the drive current by commutation, over the current"""
        self._arrays = self._kernel_arguments()
        self._bound = Bound(self._arrays)

    def _kernel_arguments(self) -> SuiteArrays:
        return SuiteArrays(
            observed=self.observed,
            accelerometer=self._accelerometer.triad.unit,
            gyroscope=self._gyroscope.triad.unit,
            walk=self._gyroscope.walk,
            magnetometer=self._magnetometer.triad.unit,
            earth_field=np.array(self._magnetometer.field_ned),
            field_per_ampere=self.field_per_ampere,
            pitot=self._pitot.arrays,
            barometer=self._barometer.arrays,
            left=self.encoder.left.arrays,
            right=self.encoder.right.arrays,
            encoder_noise=self.encoder.noise,
            encoder_normals=self.encoder.normals.rows,
            burst=self._power_sensor.burst,
            cells=self._cells.arrays,
            imu=np.zeros(9),
            encoder=np.zeros(6, dtype=np.int64),
            pressures=np.zeros(3, dtype=np.int64),
            torques=np.zeros(2, dtype=np.int64),
        )

    @property
    def gyro_bias(self) -> Vector:
        """True gyroscope bias in rad/s, for the log and tests."""
        return self._gyroscope.bias

    def unit_errors(self) -> dict[str, Any]:
        """Constant errors of these units by sensor and kind, in SI; for the log."""
        errors: dict[str, Any] = {
            "accelerometer": self._accelerometer.errors,
            "gyroscope": self._gyroscope.errors,
            "magnetometer": self._magnetometer.errors,
            "pitot": self._pitot.errors,
            "barometer": self._barometer.errors,
            "power_sensor": self._power_sensor.errors,
        }
        errors |= {row.section: sensor.errors for row, sensor in self._optional}
        return {f"{name}.{key}": value for name, e in errors.items() for key, value in e._asdict().items()}

    def sample(self, observation: Observation, tick: int) -> SensorFrame:
        """Return the sensor output at the ``tick``-th tick (from 0, consecutive).

        Raises:
            SimulationDiverged: a value of the observation is not finite, or above 1e6 in its unit.
        """
        observation.fill(self.observed)
        return self.sense(observation.time_us, tick)

    @cached_property
    def _sense(self) -> Callable[..., bool]:
        return entry_point(sense, 0, 0, 0, 0, 0, 0, self._bound)

    def sense(self, time_us: int, tick: int) -> SensorFrame:
        """Do the same for the observation in `observed`."""
        ticks, arrays, at = self._ticks, self._arrays, self._rows.next_row()
        field_at = pressures_at = burst_at = torques_at = -1
        if not self._has_field or tick % ticks.magnetometer == 0:
            self._has_field, field_at = True, self._magnetometer.triad.normals.next_row()
        if tick % ticks.pressures == 0:
            pressures_at = self._pressure_rows.next_row()
        if tick % ticks.power == 0:
            burst_at = self._power_sensor.normals.next_row()
        if self._cell_ticks and tick % self._cell_ticks == 0:
            torques_at = self._cells.normals.next_row()
        if not self._sense(time_us, at, field_at, pressures_at, burst_at, torques_at, self._bound):
            raise divergence(Observation.from_array(time_us, self.observed))
        samples: list[Any] = [None] * len(_FIELD)
        samples[0] = time_us
        samples[_IMU] = ImuSample._make((time_us, *arrays.imu.tolist()))
        samples[_ENCODER] = EncoderSample._make((time_us, *arrays.encoder.tolist()))
        if pressures_at >= 0:
            samples[_PRESSURES] = PressureSample._make((time_us, *arrays.pressures.tolist()))
        if burst_at >= 0:
            samples[_ADC] = AdcBurst._make((time_us, *self._power_sensor.counts()))
        if torques_at >= 0:
            samples[_TORQUE] = TorqueSample._make((time_us, *arrays.torques.tolist()))
        observation: Observation | None = None
        for index, read, every in self._interpreted:
            if tick % every == 0:
                observation = observation or Observation.from_array(time_us, self.observed)
                samples[index] = read(observation)
        if tick % ticks.gps == 0:
            self._gps.measure(observation or Observation.from_array(time_us, self.observed))
        samples[_GPS] = self._gps.arrived(time_us)
        return SensorFrame._make(samples)


def divergence(observation: Observation) -> SimulationDiverged:
    """Return the error that names the first value of ``observation`` that is not finite or too large."""
    name, value = next(
        (name, value)
        for name, value in zip(observation._fields[1:], observation[1:], strict=True)
        if not all(-LARGEST < number < LARGEST for number in (value if isinstance(value, tuple) else (value,)))
    )
    return SimulationDiverged(f"the simulation diverged: {name} = {value} at {observation.time_us * 1e-6:.3f} s")
