"""From a log's topics to the arrays of `logs.identification.data.flight`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from avionics import topics
from avionics.messages import BURST_LENGTH
from avionics.sensing import inertial
from logs.identification.data.flight import AIRSPEED_GUESSED, STROKES_GUESSED, DriveData, FlightData
from logs.identification.drive.frequency import ThrottleData
from logs.identification.results import Array
from logs.identification.sources.flapping import strokes_in
from logs.identification.sources.inputs import find_inputs
from logs.identification.sources.topic_table import ColumnSource, TopicTable, time_base
from logs.strokes import strokes_of
from sim_bridge import topics as truth
from wingbeat.errors import InputError
from wingbeat.topic import Topic

BURST_RATE = 6000.0
"""Hz; of the ADC's samples inside a burst"""
SMOOTHED = 5
"""-; samples of the local cubic whose slope is the wing rate"""
GAP, LEAST_SAMPLES = 1.5, 10.0
"""-; usual steps between two samples that are no neighbours; samples of a stroke"""
RATE_UNKNOWN = (
    "flapping: its wing topic has too few samples of a stroke to tell how hard; what that does counts as gusts"
)
SIDEWAYS_UNKNOWN = "bank and slip: not measured all the time; what they do then counts as gusts"
BRIDGED = 0.1
"""s; between two samples of bank or slip, which is a line there: half a stroke of a slow wing"""
MOSTLY = 0.99
"""-; of the samples, that a signal without a note has"""


def _strokes(source: ColumnSource) -> tuple[TopicTable, Array]:
    """The wing's angles, and strokes at their times by its phase, or by the left angle where no phase is told."""
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


class _Taken(NamedTuple):
    """A signal at the times asked for, and where it is from when not from its own topic."""

    values: Array
    note: str = ""


class _Excited(NamedTuple):
    """The fields of `FlightData` that tell the inputs."""

    active: Array
    manoeuvre: Array
    excitation: Array
    aborted: Array
    note: str = ""


def flight_data(source: ColumnSource, calibration: inertial.Gains = inertial.NEUTRAL) -> FlightData:
    """Longitudinal motion of the flight in a log, the IMU's samples corrected by its ``calibration``.

    What a log of another program lacks is taken from what it has, and told in ``notes``: the manoeuvres from the
    elevator's motion, the strokes from the wing's angle or the specific force, the airspeed from that over ground.

    Raises:
        InputError: a topic is missing and nothing can stand for it, or nothing was excited.
    """
    told, commanded = _told(source), _elevator(source)
    imu = _inertial(source, told is not None)
    attitude = TopicTable(source, topics.ATTITUDE, "pitch", "bias_y")
    time = time_base(imu.time)
    accel_z = (imu.linear("accel_z", time) - calibration.accel_offset[2]) * calibration.accel_scale[2]
    elevator = commanded.held("elevator", time)
    climb = TopicTable(source, topics.ALTITUDE, "climb_rate").linear("climb_rate", time)
    airspeed, strokes = _airspeed(source, time, climb), _flown_strokes(source, time, accel_z)
    excited = _found(time, elevator, strokes.values) if told is None else _flown(told, time)
    wing = _wing_rate_squared(source, time)
    # Whose strokes were guessed has no filter error, which alone asks for the rate.
    untold = RATE_UNKNOWN if not (np.isfinite(wing).any() or strokes.note) else ""
    roll, roll_rate, yaw_rate, accel_y = aside = _bank_and_slip(source, time, calibration)
    no_slip = "" if np.isfinite(aside).all(axis=0).mean() >= MOSTLY or strokes.note else SIDEWAYS_UNKNOWN
    return FlightData(
        time,
        imu.linear("gyro_y", time) - attitude.linear("bias_y", time),
        (imu.linear("accel_x", time) - calibration.accel_offset[0]) * calibration.accel_scale[0],
        accel_z,
        attitude.linear("pitch", time),
        airspeed.values,
        climb,
        elevator,
        strokes.values,
        excited.active,
        excited.manoeuvre,
        excited.excitation,
        excited.aborted,
        wing,
        roll,
        roll_rate,
        yaw_rate,
        accel_y,
        tuple(note for note in (excited.note, strokes.note, airspeed.note, untold, no_slip) if note),
    )


def _bank_and_slip(source: ColumnSource, time: Array, calibration: inertial.Gains) -> Array:
    """Roll, its rate, that of yaw and the specific force along y (4, N); NaN where the log does not tell them."""
    roll, bias_x, bias_z = (_where_told(source, topics.ATTITUDE, f, time) for f in ("roll", "bias_x", "bias_z"))
    p, r, a_y = (_where_told(source, topics.IMU, field, time) for field in ("gyro_x", "gyro_z", "accel_y"))
    return np.array((roll, p - bias_x, r - bias_z, (a_y - calibration.accel_offset[1]) * calibration.accel_scale[1]))


def _where_told(source: ColumnSource, topic: Topic[Any], field: str, time: Array) -> Array:
    """The field at ``time`` (N,); NaN beyond its samples, in its gaps, and where the log has not the field."""
    try:
        table = TopicTable(source, topic, field)
    except InputError:
        return np.full(len(time), np.nan)
    behind = np.searchsorted(table.time, time, side="left").clip(1, len(table.time) - 1)
    apart = table.time[behind] - table.time[behind - 1]
    longest = max(BRIDGED, GAP * float(np.median(np.diff(table.time))))
    told = (time >= table.time[0]) & (time <= table.time[-1]) & (apart <= longest)
    return np.where(told, table.linear(field, time), np.nan)


def _told(source: ColumnSource) -> TopicTable | None:
    """The topic of the excitation; None where the log has none."""
    try:
        told = TopicTable(source, topics.EXCITATION, "active", "manoeuvre", "elevator", "aborted")
    except InputError:
        return None
    if not np.any(told["active"]):
        raise InputError("the log has no excitation: fly an EXCITE item with the elevator to identify the modes")
    return told


def _inertial(source: ColumnSource, excited: bool) -> TopicTable:
    try:
        return TopicTable(source, topics.IMU, "gyro_y", "accel_x", "accel_z")
    except InputError as missing:
        raise missing if excited else InputError(f"no excitation is told, nor can one be found: {missing}") from None


def _flown(told: TopicTable, time: Array) -> _Excited:
    active, manoeuvre, added, aborted = (told.held(f, time) for f in ("active", "manoeuvre", "elevator", "aborted"))
    return _Excited(active, manoeuvre, added, aborted)


def _found(time: Array, elevator: Array, strokes: Array) -> _Excited:
    try:
        inputs = find_inputs(time, elevator, strokes)
    except InputError as reason:
        raise InputError(f"the log has no topic {topics.EXCITATION.name} that tells an input, and {reason}") from None
    note = "manoeuvres: the elevator's quick movements from rest to rest"
    return _Excited(inputs.active, inputs.manoeuvre, inputs.excitation, np.zeros(len(time)), note)


def _elevator(source: ColumnSource) -> TopicTable:
    try:
        return TopicTable(source, topics.ACTUATORS, "elevator")
    except InputError as missing:
        hint = "--elevator makes it of a pulse width or a stick"
        raise InputError(f"{missing} to find the elevator's excitation: its angle ({hint})") from None


def _airspeed(source: ColumnSource, time: Array, climb: Array) -> _Taken:
    try:
        return _Taken(TopicTable(source, topics.AIR_DATA, "airspeed").linear("airspeed", time))
    except InputError as missing:
        try:
            ground = TopicTable(source, topics.POSITION, "v_north", "v_east")
        except InputError:
            raise missing from None
    north, east = (ground.linear(field, time) for field in ("v_north", "v_east"))
    return _Taken(np.sqrt(north**2 + east**2 + climb**2), AIRSPEED_GUESSED)


def _flown_strokes(source: ColumnSource, time: Array, accel_z: Array) -> _Taken:
    """Strokes by the wing's phase, its angle, or what flapping does to the body."""
    try:
        wing, strokes = _strokes(source)
        return _Taken(np.interp(time, wing.time, strokes))
    except InputError as missing:
        try:
            strokes = strokes_in(time, accel_z)
        except InputError as reason:
            raise InputError(f"{missing}, and its specific force tells no strokes: {reason}") from None
    return _Taken(strokes, STROKES_GUESSED)


def _wing_rate_squared(source: ColumnSource, time: Array) -> Array:
    """Square of the wings' rate at ``time`` (N,) in rad^2/s^2, mean of both.

    NaN where their motion was not measured: in gaps of the topic and, throughout, where it tells fewer than
    `LEAST_SAMPLES` of a stroke, from which a slope would come out too small.
    """
    unknown = np.full(len(time), np.nan)
    try:
        wing, strokes = _strokes(source)
    except InputError:
        return unknown
    steps = np.diff(wing.time)
    if len(steps) < SMOOTHED or len(strokes) / max(strokes[-1] - strokes[0], 1.0) < LEAST_SAMPLES:
        return unknown
    step = float(np.median(steps))
    for run in np.split(np.arange(len(wing.time)), np.flatnonzero(steps > GAP * step) + 1):
        if len(run) >= SMOOTHED:
            left, right = (_rate(wing[angle][run], step) for angle in ("angle_left", "angle_right"))
            within = (time >= wing.time[run[0]]) & (time <= wing.time[run[-1]])
            unknown[within] = np.interp(time[within], wing.time[run], (left**2 + right**2) / 2.0)
    return unknown


def drive_data(source: ColumnSource) -> DriveData:
    """The wing drives in a log, as measured by strain gauges, encoders and power sensors.

    A stand without encoders gives no motion of the wings, which the torque model does without.

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
    """s; over which a torque cell that our board samples tells the mean: one of its ``ticks``; 0 for any other."""
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
    """Wing rate (N,) in rad/s, ``angle`` (N,) told every ``step`` s; without the lag of the rate that was flown with.

    Three milliseconds against a torque that is mostly inertial would make a fifth of the power disappear.
    """
    rate: Array = savgol_filter(angle, SMOOTHED, 3, deriv=1, delta=step)
    return rate


def true_drive_data(source: ColumnSource) -> DriveData:
    """The wing drives in a simulated flight's log as they truly were, strokes as measured.

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
