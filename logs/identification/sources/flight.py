"""From a log's topics to the arrays of `logs.identification.data.flight`."""

from __future__ import annotations

import contextlib
from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from avionics import topics
from avionics.messages import BURST_LENGTH
from logs.identification.data.flight import (
    AIRSPEED_GUESSED,
    NEUTRAL,
    STROKES_GUESSED,
    DriveData,
    FlightData,
    ImuCalibration,
)
from logs.identification.estimators.flapping_frequency import ThrottleData
from logs.identification.results import Array
from logs.identification.sources.detection import detect_inputs, strokes_in
from logs.identification.sources.topic_table import ColumnSource, TopicTable, time_base
from logs.strokes import strokes_of
from sim_bridge import topics as truth
from wingbeat.errors import InputError

BURST_RATE = 6000.0
"""Hz; of the ADC's samples inside a burst"""
CUBIC_SAMPLES = 5
"""-; samples of the local cubic whose derivative is the wing rate"""


def _strokes(source: ColumnSource) -> tuple[TopicTable, Array]:
    """The wing's angles, and strokes at their times by its phase, or by the left angle if there is no phase."""
    try:
        wing = TopicTable(source, topics.WING, "phase", "angle_left", "angle_right")
        return wing, strokes_of(wing["phase"])
    except InputError as missing:
        try:
            wing = TopicTable(source, topics.WING, "angle_left", "angle_right")
            time = time_base(wing.time)
            return wing, np.interp(wing.time, time, strokes_in(time, wing.linear("angle_left", time)))
        except InputError:
            raise missing from None


class _Signal(NamedTuple):
    """A signal, and its origin if that is another topic."""

    values: Array
    note: str = ""


class _Excitation(NamedTuple):
    """Fields of `FlightData` about the inputs."""

    active: Array
    manoeuvre: Array
    excitation: Array
    aborted: Array
    note: str = ""


MOTION_TOPICS = (
    topics.EXCITATION, topics.ACTUATORS, topics.IMU, topics.ATTITUDE, topics.ALTITUDE, topics.AIR_DATA, topics.WING,
    topics.PITCH_LOOP,
)  # fmt: skip
"""topics of `flight_data` in a log of our own"""
DRIVE_TOPICS = (
    topics.DRIVE_TORQUE, topics.POWER, topics.TORQUE_RAW, topics.WING, topics.ACTUATORS, truth.WING,
)  # fmt: skip
"""topics of `drive_data`, `throttle_data` and `true_drive_data`"""


def flight_data(source: ColumnSource, calibration: ImuCalibration = NEUTRAL) -> FlightData:
    """Longitudinal motion of the flight in a log, the IMU's samples corrected by its ``calibration``.

    In a log of another program missing signals are replaced, which ``notes`` lists: maneuvers by the elevator's
    motion, strokes by the wing's angle or the specific force, airspeed by the ground speed.

    Raises:
        InputError: a topic is missing and cannot be replaced, or nothing was excited.
    """
    excitation, commanded = _excitation_topic(source), _elevator(source)
    imu = _inertial(source, excitation is not None)
    attitude = TopicTable(source, topics.ATTITUDE, "pitch", "bias_y")
    time = time_base(imu.time)
    accel_z = calibration.correct(imu.linear("accel_z", time), 2)
    elevator = commanded.zero_order_hold("elevator", time)
    climb = TopicTable(source, topics.ALTITUDE, "climb_rate").linear("climb_rate", time)
    airspeed, strokes = _airspeed(source, time, climb), _stroke_count(source, time, accel_z)
    setpoint = _pitch_setpoint(source, time)
    if excitation is None:
        inputs = _detected_excitation(time, elevator, strokes.values, closed_loop=setpoint is not None)
    else:
        inputs = _recorded_excitation(excitation, time)
    return FlightData(
        time,
        imu.linear("gyro_y", time) - attitude.linear("bias_y", time),
        calibration.correct(imu.linear("accel_x", time), 0),
        accel_z,
        attitude.linear("pitch", time),
        airspeed.values,
        climb,
        elevator,
        strokes.values,
        inputs.active,
        inputs.manoeuvre,
        inputs.excitation,
        inputs.aborted,
        tuple(note for note in (inputs.note, strokes.note, airspeed.note) if note),
        pitch_setpoint=setpoint,
    )


def _excitation_topic(source: ColumnSource) -> TopicTable | None:
    """The topic of the excitation; None if the log has none."""
    try:
        recorded = TopicTable(source, topics.EXCITATION, "active", "manoeuvre", "elevator", "aborted")
    except InputError:
        return None
    if not np.any(recorded["active"]):
        raise InputError("the log has no excitation: fly an EXCITE item with the elevator to identify the modes")
    return recorded


def _inertial(source: ColumnSource, excited: bool) -> TopicTable:
    try:
        return TopicTable(source, topics.IMU, "gyro_y", "accel_x", "accel_z")
    except InputError as missing:
        raise (
            missing if excited else InputError(f"no excitation is recorded, nor can one be found: {missing}")
        ) from None


def _recorded_excitation(recorded: TopicTable, time: Array) -> _Excitation:
    active, manoeuvre, added, aborted = (
        recorded.zero_order_hold(f, time) for f in ("active", "manoeuvre", "elevator", "aborted")
    )
    return _Excitation(active, manoeuvre, added, aborted)


def _pitch_setpoint(source: ColumnSource, time: Array) -> Array | None:
    try:
        return TopicTable(source, topics.PITCH_LOOP, "pitch_setpoint").zero_order_hold("pitch_setpoint", time)
    except InputError:
        return None


def _detected_excitation(time: Array, elevator: Array, strokes: Array, closed_loop: bool) -> _Excitation:
    """Return the elevator's movements from rest to rest; without them nothing, if the loop has a setpoint.

    Raises:
        InputError: there is neither.
    """
    try:
        inputs = detect_inputs(time, elevator, strokes)
    except InputError as reason:
        if closed_loop:
            nothing = np.zeros(len(time))
            return _Excitation(nothing, nothing, nothing, nothing, "no input: the pitch setpoint is the instrument")
        raise InputError(f"the log has no topic {topics.EXCITATION.name} that tells an input, and {reason}") from None
    note = "manoeuvres: the elevator's quick movements from rest to rest"
    return _Excitation(inputs.active, inputs.manoeuvre, inputs.excitation, np.zeros(len(time)), note)


def _elevator(source: ColumnSource) -> TopicTable:
    try:
        return TopicTable(source, topics.ACTUATORS, "elevator")
    except InputError as missing:
        hint = "--elevator makes it of a pulse width or a stick"
        raise InputError(f"{missing} to find the elevator's excitation: its angle ({hint})") from None


def _airspeed(source: ColumnSource, time: Array, climb: Array) -> _Signal:
    try:
        return _Signal(TopicTable(source, topics.AIR_DATA, "airspeed").linear("airspeed", time))
    except InputError as missing:
        try:
            ground = TopicTable(source, topics.POSITION, "v_north", "v_east")
        except InputError:
            raise missing from None
    north, east = (ground.linear(field, time) for field in ("v_north", "v_east"))
    return _Signal(np.sqrt(north**2 + east**2 + climb**2), AIRSPEED_GUESSED)


def _stroke_count(source: ColumnSource, time: Array, accel_z: Array) -> _Signal:
    """Strokes by the wing's phase, its angle, or what flapping does to the body."""
    with contextlib.suppress(InputError):  # a log of another program has a phase without angles
        wing = TopicTable(source, topics.WING, "phase")
        return _Signal(np.interp(time, wing.time, strokes_of(wing["phase"])))
    try:
        wing, strokes = _strokes(source)
        return _Signal(np.interp(time, wing.time, strokes))
    except InputError as missing:
        try:
            strokes = strokes_in(time, accel_z)
        except InputError as reason:
            raise InputError(
                f"{missing}, and its specific force has no periodic component of strokes: {reason}"
            ) from None
    return _Signal(strokes, STROKES_GUESSED)


def drive_data(source: ColumnSource) -> DriveData:
    """The wing drives in a log, as measured by strain gauges, encoders and power sensors.

    A bench without encoders has no motion of the wings, which the torque model does not need.

    Raises:
        InputError: a topic is missing.
    """
    torque = TopicTable(source, topics.DRIVE_TORQUE, "left", "right")
    power = TopicTable(source, topics.POWER, "current", "voltage")
    wing_time, *motion = _motion(source)
    middle = torque.time - _cell_window(source, wing_time) / 2
    return DriveData(
        power.time, power["current"], power["voltage"], BURST_LENGTH / BURST_RATE,
        middle, torque["left"], torque["right"], wing_time, *motion,
    )  # fmt: skip


def _cell_window(source: ColumnSource, ticks: Array) -> float:
    """s; averaging window of a torque cell: one of the board's ``ticks``; 0 for other recorders."""
    try:
        TopicTable(source, topics.TORQUE_RAW, "left_counts")
    except InputError:
        return 0.0
    return float(np.median(np.diff(ticks))) if len(ticks) else 0.0


def throttle_data(source: ColumnSource) -> ThrottleData:
    """Throttle, strokes and voltage in a log; the voltage may be missing.

    Raises:
        InputError: the throttle or the wings' motion is missing.
    """
    commanded = TopicTable(source, topics.ACTUATORS, "throttle")
    wing, strokes = _strokes(source)
    try:
        power = TopicTable(source, topics.POWER, "voltage")
    except InputError:
        nothing = np.zeros(0)
        return ThrottleData(commanded.time, commanded["throttle"], wing.time, strokes, nothing, nothing)
    return ThrottleData(commanded.time, commanded["throttle"], wing.time, strokes, power.time, power["voltage"])


def _motion(source: ColumnSource) -> tuple[Array, Array, Array, Array]:
    """Time, rates of both wings and strokes; all empty where they were not measured."""
    try:
        wing, strokes = _strokes(source)
    except InputError:
        return np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0)
    step = float(np.median(np.diff(wing.time)))
    return wing.time, _rate(wing["angle_left"], step), _rate(wing["angle_right"], step), strokes


def _rate(angle: Array, step: float) -> Array:
    """Wing rate (N,) in rad/s from the ``angle`` (N,) every ``step`` s, without the lag of the onboard rate.

    A lag of 3 ms against a torque that is mostly inertial would lose a fifth of the power.
    """
    rate: Array = savgol_filter(angle, CUBIC_SAMPLES, 3, deriv=1, delta=step)
    return rate


def true_drive_data(source: ColumnSource) -> DriveData:
    """The wing drives in a simulated flight's log by the truth, strokes as measured.

    Raises:
        InputError: the log has no topic of the world's truth.
    """
    fields = ("current", "voltage", "torque_left", "torque_right", "rate_left", "rate_right")
    true = TopicTable(source, truth.WING, *fields)
    wing, strokes = _strokes(source)
    tick = float(np.median(np.diff(true.time)))
    return DriveData(
        true.time, true["current"], true["voltage"], tick,
        true.time - tick / 2, true["torque_left"], true["torque_right"],
        true.time, true["rate_left"], true["rate_right"],
        np.interp(true.time, wing.time, strokes),
    )  # fmt: skip
