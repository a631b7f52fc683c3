"""Motion of a vehicle for inverse dynamics from a log: as measured, or the truth.

The measured acceleration of the base is the specific force of the IMU, without differentiation; the velocity is its
integral, the slow part from position and climb rate. The wings' angles are the encoders', the tail's the commands
after the servo's lag. The twist of the membrane is not measured and taken as zero.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

from avionics import topics
from logs.identification.data.experiment import runs
from logs.identification.data.flight import NEUTRAL, ImuCalibration
from logs.identification.data.resampling import behind
from logs.identification.estimators.wing_coefficients import AeroResult, identify_coefficients
from logs.identification.models.inverse_dynamics import LOW_PASS, WingMotion, coefficients
from logs.identification.models.multibody import MovedVehicle
from logs.identification.motion_capture.motion import low_passed
from logs.identification.results import Array
from logs.identification.sources.topic_table import ColumnSource, TopicTable, time_base
from sim_bridge import topics as truth
from sim_bridge.mechanism import build_mechanism
from sim_bridge.plant_kernel import COORDINATES
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.atmosphere import SEA_LEVEL_DENSITY
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError
from wingbeat.rotation_arrays import dcms_from_quaternions

CUTOFF = 50.0
"""Hz; Grauer IV.C"""
CROSSOVER = 0.5
"""Hz; crossover from ground velocity to integrated acceleration"""
MIN_SECONDS = 1.5
QUATERNION = ("quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z")


class _Base(NamedTuple):
    """Of the base, (N, ...) each."""

    quaternion: Array
    velocity: Array
    """m/s; over ground, body axes"""
    omega: Array
    """rad/s"""
    velocity_rate: Array
    """m/s^2; of ``velocity``, component by component"""
    omega_rate: Array


def measured_motion(
    source: ColumnSource, vehicle: SimulatedVehicle, calibration: ImuCalibration = NEUTRAL
) -> tuple[WingMotion, ...]:
    """The measured motion of every segment of flapping flight; of those with excitation if the log records it.

    Raises:
        InputError: a topic is missing, or no segment is long enough.
    """
    imu = TopicTable(source, topics.IMU, "accel_x", "accel_y", "accel_z")
    wing = TopicTable(source, topics.WING, "angle_left", "angle_right", "flapping")
    tail = TopicTable(source, topics.ACTUATORS, "elevator", "rudder")
    time = time_base(imu.time)
    step = float(time[1] - time[0])
    base = _measured_base(source, vehicle, imu, time, calibration)
    angles = {index: wing.linear(field, time) for index, field in _flaps(vehicle)}
    layout = build_mechanism(vehicle).layout
    for index, field in ((layout.elevator, "elevator"), (layout.rudder, "rudder")):
        if index >= 0:
            angles[index] = behind(
                tail.zero_order_hold(field, time), step, 0.0, vehicle.tail_servo.time_constant, zoh=True
            )
    winds, density, notes = _air(source, time)
    notes += ("tail: its commands behind the servo's lag",)
    if vehicle.wing.twists:
        notes += ("twist of the wings: not measured, counted as at rest",)
    use = (wing.zero_order_hold("flapping", time) > 0) & _excited(source, time)
    return _segments(vehicle, _Flight(time, base, angles, winds, density, notes), use)


def true_motion(source: ColumnSource, vehicle: SimulatedVehicle) -> tuple[WingMotion, ...]:
    """The true motion of every segment of a simulated flight.

    Raises:
        InputError: the log has no topics of the truth, or no segment is long enough.
    """
    fields = ("v_north", "v_east", "v_down", *QUATERNION, "roll_rate", "pitch_rate", "yaw_rate", "wind_north",
              "wind_east", "wind_down", "on_ground")  # fmt: skip
    state = TopicTable(source, truth.STATE, *fields)
    wing = TopicTable(
        source, truth.WING, "angle_left", "angle_right", "twist_left", "twist_right", "elevator", "rudder"
    )
    time = time_base(state.time)
    columns = {field: state.linear(field, time) for field in fields}
    quaternion = _attitude(state, time)
    v_ned = np.column_stack([columns[f"v_{axis}"] for axis in ("north", "east", "down")])
    v = np.einsum("nji,nj->ni", dcms_from_quaternions(quaternion), v_ned)
    omega = np.column_stack([columns[f"{axis}_rate"] for axis in ("roll", "pitch", "yaw")])
    layout = build_mechanism(vehicle).layout
    named = dict(_flaps(vehicle)) | {layout.elevator: "elevator", layout.rudder: "rudder"}
    named |= {layout.twist[0]: "twist_left", layout.twist[1]: "twist_right"}
    angles = {index: wing.linear(field, time) for index, field in named.items() if index >= 0}
    winds = np.column_stack([columns[f"wind_{axis}"] for axis in ("north", "east", "down")])
    base = _Base(quaternion, v, omega, _slope(time, v), _slope(time, omega))
    density, use = _air(source, time)[1], (columns["on_ground"] < 0.5) & _excited(source, time)
    return _segments(vehicle, _Flight(time, base, angles, winds, density, ()), use)


def _measured_base(
    source: ColumnSource, vehicle: SimulatedVehicle, imu: TopicTable, time: Array, calibration: ImuCalibration
) -> _Base:
    attitude = TopicTable(source, topics.ATTITUDE, *QUATERNION, "roll_rate", "pitch_rate", "yaw_rate")
    quaternion = _attitude(attitude, time)
    step = float(time[1] - time[0])
    turning = np.column_stack([attitude.linear(f"{axis}_rate", time) for axis in ("roll", "pitch", "yaw")])
    omega = low_passed(turning, step, _cutoff(step))
    omega_rate = _slope(time, omega)
    force = np.column_stack([imu.linear(f"accel_{axis}", time) for axis in "xyz"])
    force = (force - np.asarray(calibration.accel_offset)) * np.asarray(calibration.accel_scale)
    arm = np.asarray(vehicle.fuselage.imu_position, float)
    force = low_passed(force, step, _cutoff(step)) - np.cross(omega_rate, arm) - np.cross(omega, np.cross(omega, arm))
    to_ned = dcms_from_quaternions(quaternion)
    acceleration = np.einsum("nij,nj->ni", to_ned, force) + np.array((0.0, 0.0, STANDARD_GRAVITY))
    ground = TopicTable(source, topics.POSITION, "v_north", "v_east")
    climb = TopicTable(source, topics.ALTITUDE, "climb_rate")
    over_ground = [ground.linear(field, time) for field in ("v_north", "v_east")]
    slow = np.column_stack([*over_ground, -climb.linear("climb_rate", time)])
    quick = cumulative_trapezoid(acceleration, dx=step, axis=0, initial=0.0)
    v = np.einsum("nji,nj->ni", to_ned, quick + low_passed(slow - quick, step, CROSSOVER))
    weight = np.einsum("nji,j->ni", to_ned, np.array([0.0, 0.0, STANDARD_GRAVITY]))
    return _Base(quaternion, v, omega, force + weight - np.cross(omega, v), omega_rate)


class _Flight(NamedTuple):
    """A flight before it is cut."""

    time: Array
    """s; (N,)"""
    base: _Base
    angles: dict[int, Array]
    """rad; (N,) by the joint's number"""
    winds: Array
    """m/s; (N, 3), NED"""
    density: float
    """kg/m^3"""
    notes: tuple[str, ...]


def _segments(vehicle: SimulatedVehicle, flight: _Flight, use: NDArray[np.bool_]) -> tuple[WingMotion, ...]:
    time, base, angles, winds, density, notes = flight
    step, count = float(time[1] - time[0]), len(build_mechanism(vehicle).layout.coordinates)
    joint_angles = np.zeros((len(time), count))
    for index, values in angles.items():
        joint_angles[:, index - COORDINATES] = values
    coordinates = low_passed(joint_angles, step, _cutoff(step))
    spline = CubicSpline(time, coordinates)
    speeds = np.column_stack([base.velocity, base.omega, spline(time, 1)])
    rates = np.column_stack([base.velocity_rate, base.omega_rate, spline(time, 2)])
    spans = [run for run in runs(use) if (run.stop - run.start) * step >= MIN_SECONDS]
    if not spans:
        raise InputError(f"the log has no {MIN_SECONDS:g} s of flapping flight without a break")
    return tuple(
        WingMotion(
            f"{time[s.start]:.1f} s to {time[s.stop - 1]:.1f} s",
            time[s],
            MovedVehicle(base.quaternion[s], speeds[s], coordinates[s], rates[s], winds[s]),
            density,
            notes,
        )
        for s in spans
    )


def _flaps(vehicle: SimulatedVehicle) -> tuple[tuple[int, str], ...]:
    left, right = build_mechanism(vehicle).layout.flap
    return (left, "angle_left"), (right, "angle_right")


def _excited(source: ColumnSource, time: Array) -> NDArray[np.bool_]:
    """Samples of maneuvers; all, if the log has none."""
    try:
        active = TopicTable(source, topics.EXCITATION, "active")
    except InputError:
        return np.ones(len(time), bool)
    running = active.zero_order_hold("active", time) > 0
    return np.asarray(running) if running.any() else np.ones(len(time), bool)


def _air(source: ColumnSource, time: Array) -> tuple[Array, float, tuple[str, ...]]:
    """Wind (N, 3) m/s NED, its mean over the log, and the density in kg/m^3."""
    notes: tuple[str, ...] = ()
    wind = np.zeros(3)
    try:
        topic = TopicTable(source, topics.POSITION, "wind_north", "wind_east")
        wind[:2] = np.mean(topic["wind_north"]), np.mean(topic["wind_east"])
    except InputError:
        notes += ("wind: none, as none is recorded",)
    try:
        density = float(np.median(TopicTable(source, topics.AIR_DATA, "density")["density"]))
    except InputError:
        density, notes = SEA_LEVEL_DENSITY, (*notes, "density: at sea level")
    return np.tile(wind, (len(time), 1)), density, notes


def _attitude(table: TopicTable, time: Array) -> Array:
    """Unit quaternions (N, 4) at ``time``, interpolated between samples of one sign."""
    topic = np.column_stack([table[field] for field in QUATERNION])
    signs = np.cumprod(np.concatenate([[1.0], np.where((topic[1:] * topic[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)]))
    at = np.column_stack([np.interp(time, table.time, column) for column in (topic * signs[:, None]).T])
    return np.asarray(at / np.linalg.norm(at, axis=1, keepdims=True))


def _slope(time: Array, values: Array) -> Array:
    step = float(time[1] - time[0])
    return np.asarray(CubicSpline(time, low_passed(values, step, _cutoff(step)))(time, 1))


def _cutoff(step: float) -> float:
    return min(CUTOFF, 0.4 / step)


def identify_aero(
    source: ColumnSource,
    vehicle: SimulatedVehicle | None,
    calibration: ImuCalibration = NEUTRAL,
    by_truth: bool = False,
) -> AeroResult:
    """Structure and parameters of C_L, C_T and C_m (Grauer Eq. 13 to 19) from the flapping flight in a log.

    From what the vehicle measured, or ``by_truth`` from the truth of a simulated flight. Masses, hinges and tail are
    the ``vehicle``'s.

    Raises:
        InputError: the vehicle is not known, a topic is missing, or the flight has no stretch that is long enough.
    """
    if vehicle is None:
        raise InputError(
            "inverse dynamics needs the masses and hinges of the vehicle, and the log carries no file of it"
        )
    motions = true_motion(source, vehicle) if by_truth else measured_motion(source, vehicle, calibration)
    return identify_coefficients(tuple(coefficients(vehicle, one, LOW_PASS) for one in motions))
