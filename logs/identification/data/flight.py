"""Arrays of one flight and constants of the aircraft, independent of their source."""

from __future__ import annotations

from typing import NamedTuple

from logs.identification.results import Array

STROKES_GUESSED = "strokes: by the specific force"
"""note if no sensor counts the strokes: their rate is right, their phase is arbitrary"""
AIRSPEED_GUESSED = "airspeed: the speed over ground, as in still air"
"""note of a flight without a pitot: the mean is right in still air; gusts are not included"""


class JoinedFlight(NamedTuple):
    """Where one flight is within several that were joined."""

    name: str
    """-; of its log"""
    begin: float
    """s; of its first sample, on the clock of all"""
    clock: float
    """s; the same on its own clock"""
    before: int
    """-; maneuvers counted in the flights before it"""

    def local_number(self, number: int) -> int:
        """The number that a maneuver has in its own log."""
        return number - self.before

    def local_time(self, time: float) -> float:
        """A time (s) on the flight's own clock."""
        return time - self.begin + self.clock


class FlightData(NamedTuple):
    """Longitudinal motion of one flight, every array (N,) on the equally spaced time base of the IMU."""

    time: Array
    """s"""
    pitch_rate: Array
    """rad/s; about FRD y"""
    accel_x: Array
    """m/s^2; specific force at the IMU along FRD x"""
    accel_z: Array
    """m/s^2; specific force at the IMU along FRD z, -9.81 at rest"""
    pitch: Array
    """rad; nose up is positive"""
    airspeed: Array
    """m/s; true"""
    climb_rate: Array
    """m/s; positive up"""
    elevator: Array
    """rad; commanded, held from its time stamp on"""
    strokes: Array
    """-; wing strokes since the first sample, never decreasing"""
    active: Array
    """-; 1 while a maneuver runs, its settling time included"""
    manoeuvre: Array
    """-; number of the maneuver"""
    excitation: Array
    """rad; what the maneuver added to the elevator"""
    aborted: Array
    """-; 1 where an envelope limit ended the maneuver"""
    notes: tuple[str, ...] = ()
    """-; substitutes for what the log does not contain, one clause each"""
    flights: tuple[JoinedFlight, ...] = ()
    """the flights that were joined, one behind the other; empty of a single one"""
    pitch_setpoint: Array | None = None
    """rad; (N,), of the pitch loop; None if it is not recorded, and of joined flights"""

    @classmethod
    def arrays(cls) -> tuple[str, ...]:
        """Names of the fields that are arrays (N,)."""
        return tuple(name for name in cls._fields if name not in ("notes", "flights", "pitch_setpoint"))

    def flight_at(self, time: float) -> JoinedFlight | None:
        """The joined flight that ``time`` (s) is in; None of a single one."""
        return next((one for one in reversed(self.flights) if time >= one.begin), None)


class DriveData(NamedTuple):
    """The wing drives of one flight; three time bases, all in seconds. K is 0 where no wing motion is known."""

    power_time: Array
    """s; (N,), end of the averaging window"""
    current: Array
    """A; (N,), mean over the window, of both drives"""
    voltage: Array
    """V; (N,), mean over the window"""
    window: float
    """s; length of the averaging window, 0 for instantaneous samples"""
    torque_time: Array
    """s; (M,)"""
    torque_left: Array
    """N m; (M,), positive when it drives the wing up"""
    torque_right: Array
    """N m; (M,), positive when it drives the wing up"""
    wing_time: Array
    """s; (K,)"""
    rate_left: Array
    """rad/s; (K,), wing up is positive"""
    rate_right: Array
    """rad/s; (K,), wing up is positive"""
    strokes: Array
    """-; (K,), wing strokes since the first sample, never decreasing"""


class GaugeErrors(NamedTuple):
    """Standard deviations of what calibrations leave wrong in the drives' sensors for a whole flight."""

    torque_zero: float = 0.0
    """N m; of each cell"""
    torque_scale: float = 0.0
    """-; of each cell"""
    current_zero: float = 0.0
    """A; of both drives"""
    current_scale: float = 0.0
    """-"""
    voltage_scale: float = 0.0
    """-"""


class ImuCalibration(NamedTuple):
    """Calibration of the accelerometers: ``(measured - offset) scale``; neutral by default."""

    accel_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m/s^2; along FRD x, y, z"""
    accel_scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """-"""

    def correct(self, values: Array, axis: int) -> Array:
        """Specific force (N,) of one ``axis`` (0, 1, 2)."""
        return (values - self.accel_offset[axis]) * self.accel_scale[axis]


NEUTRAL = ImuCalibration()


class Aircraft(NamedTuple):
    """Constants of the aircraft."""

    imu_x: float = 0.0
    """m; IMU ahead of the center of mass"""
    imu_z: float = 0.0
    """m; IMU below the center of mass"""
    tail_time_constant: float | None = None
    """s; first-order lag from the elevator command to the achieved tail angle, 0 for none; None if it is not
    known: the lag and the remaining delay are then identified"""
    tail_delay: float = 0.0
    """s; pure delay of the elevator command"""
    centre_current: float | None = None
    """A; C_D of Gerdes Eq. 12 if given, else minus the mean current per servo"""
    centre_voltage: float | None = None
    """V; C_E of Gerdes Eq. 12 if given, else minus the mean voltage"""
    imu: ImuCalibration = NEUTRAL
    """calibration of the IMU; a log contains raw samples"""
    gauges: GaugeErrors = GaugeErrors()
    """accuracy of torque cells and power sensors, none if it is not known"""
    span: float | None = None
    """m; from wing tip to wing tip, over which gusts are smoothed; None if it is not known"""
