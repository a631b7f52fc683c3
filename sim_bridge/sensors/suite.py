"""All sensors of a vehicle: an Observation in, a SensorFrame out, at 200 Hz or another tick rate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, get_type_hints

from sim_bridge.environment.home import Home
from sim_bridge.observation import Observation, Vector
from sim_bridge.sensors.accelerometer import Accelerometer, AccelerometerSpec
from sim_bridge.sensors.barometer import Barometer, BarometerSpec
from sim_bridge.sensors.encoder import Encoder, EncoderSpec
from sim_bridge.sensors.frame import TICK_RATE, imu_on_the_wire
from sim_bridge.sensors.gps import Gps, GpsSpec
from sim_bridge.sensors.gyroscope import Gyroscope, GyroscopeSpec
from sim_bridge.sensors.magnetometer import Magnetometer, MagnetometerSpec
from sim_bridge.sensors.noise import sensor_seed
from sim_bridge.sensors.optional import OPTIONAL
from sim_bridge.sensors.pitot import Pitot, PitotSpec
from sim_bridge.sensors.power_sensor import PowerSensor, PowerSensorSpec
from sim_bridge.sensors.receiver import Pilot, Receiver, ReceiverSpec
from sim_bridge.sensors.triad import ZERO
from wingbeat.errors import InputError
from wingbeat.samples import AdcBurst, EncoderSample, GpsFix, ImuSample, PressureSample, SensorFrame

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

LARGEST = 1e6
"""SI; no value of an observation is larger while the simulation makes sense"""


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
    ) -> None:
        """Build every sensor with a random stream of its own; a ``pilot`` brings a transmitter and its receiver.

        With a ``corner`` above 0 each error of a unit is that many standard deviations, its sign by chance. ``rate``
        in Hz is that of the ticks.

        Raises:
            InputError: seed negative.
        """
        tick = 1.0 / rate
        self._ticks = ticks_of(rate)
        # The number is the stream's name: a new sensor takes the next free one, so the others' noise stays.
        self._accelerometer = Accelerometer(spec.accelerometer, sensor_seed(seed, 0, corner), tick)
        self._gyroscope = Gyroscope(spec.gyroscope, sensor_seed(seed, 1, corner), tick)
        self._magnetometer = Magnetometer(spec.magnetometer, sensor_seed(seed, 2, corner), home.magnetic)
        self._pitot = Pitot(spec.pitot, sensor_seed(seed, 3, corner), tick)
        self._barometer = Barometer(spec.barometer, sensor_seed(seed, 4, corner), self._ticks.pressures * tick)
        self._power_sensor = PowerSensor(spec.power_sensor, sensor_seed(seed, 5, corner))
        carried = [row for row in OPTIONAL if row.section in spec.optional]
        self._optional = [
            (
                row,
                row.build(spec.optional[row.section], sensor_seed(seed, row.stream, corner)),
                ticks_between(rate, row.rate),
            )
            for row in carried
        ]
        self._gps = Gps(spec.gps, sensor_seed(seed, 7, corner), home, self._ticks.gps * tick)
        self.encoder = Encoder(spec.encoder, sensor_seed(seed, 11))
        self._receiver = Receiver(ReceiverSpec(), sensor_seed(seed, 8), pilot)
        self._field_frd: Vector | None = None
        self.field_per_ampere: Vector = ZERO
        """gauss/A, body axes; of the drive current at the magnetometer"""

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
        errors |= {row.section: sensor.errors for row, sensor, _ in self._optional}
        return {f"{name}.{key}": value for name, e in errors.items() for key, value in e._asdict().items()}

    def sample(self, observation: Observation, tick: int) -> SensorFrame:
        """Return the sensor output at the ``tick``-th tick (from 0, consecutive).

        Raises:
            SimulationDiverged: a value of the observation is not finite, or above 1e6 in its unit.
        """
        require_finite(observation)
        time_us, ticks = observation.time_us, self._ticks
        self._pitot.sense(observation.v_air_frd, observation.density)
        powered = tick % ticks.power == 0
        frame = SensorFrame(
            time_us,
            self._imu(observation, tick),
            encoder=EncoderSample._make((time_us, *self.encoder.read(observation.flap_left, observation.flap_right))),
            pressures=self._pressures(observation) if tick % ticks.pressures == 0 else None,
            adc=AdcBurst._make((time_us, *self._power_sensor.read(observation))) if powered else None,
            gps=self._fix(observation, tick),
            receiver=self._receiver.read(observation) if tick % ticks.receiver == 0 else None,
        )
        optional = {row.field: sensor.read(observation) for row, sensor, every in self._optional if tick % every == 0}
        return frame._replace(**optional) if optional else frame

    def _imu(self, observation: Observation, tick: int) -> ImuSample:
        if self._field_frd is None or tick % self._ticks.magnetometer == 0:
            x, y, z = self.field_per_ampere
            current = observation.current
            self._field_frd = self._magnetometer.read(observation.quaternion, (x * current, y * current, z * current))
        force = self._accelerometer.read(observation.specific_force_frd)
        return imu_on_the_wire(
            observation.time_us, *force, *self._gyroscope.read(observation.omega_frd), *self._field_frd
        )

    def _pressures(self, observation: Observation) -> PressureSample:
        static, temperature = self._barometer.read(observation.static_pressure, observation.temperature)
        return PressureSample(observation.time_us, static, self._pitot.read(), temperature)

    def _fix(self, observation: Observation, tick: int) -> GpsFix | None:
        if tick % self._ticks.gps == 0:
            self._gps.measure(observation)
        return self._gps.arrived(observation.time_us)


def require_finite(observation: Observation) -> None:
    """Check that every value of ``observation`` is finite and of plausible size.

    Raises:
        SimulationDiverged: names the first that is not.
    """
    # One sum finds any inf or nan among the numbers; only then is it worth asking where.
    time_us, q, omega, force, position, v_ned, v_air, *scalars = observation
    total = sum((*q, *omega, *force, *position, *v_ned, *v_air, *scalars))
    if -LARGEST < total < LARGEST:
        return
    for name, value in zip(observation._fields[1:], observation[1:], strict=True):
        if not all(-LARGEST < number < LARGEST for number in (value if isinstance(value, tuple) else (value,))):
            raise SimulationDiverged(f"the simulation diverged: {name} = {value} at {time_us * 1e-6:.3f} s")
