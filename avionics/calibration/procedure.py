"""Calibration procedure: kind, time, collected samples and reasons to stop.

The samples come from the task (`avionics.tasks.calibrate`); the computation of each sensor has its own module.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from avionics import parameters
from avionics.calibration import accelerometer, airspeed, battery, magnetometer, wings
from avionics.calibration.result import Result, Setting
from avionics.gains import FlightGains
from avionics.messages import Calibration, CalibrationStatus
from wingbeat.errors import InputError

PATIENCE: dict[Calibration, float] = {
    Calibration.ACCELEROMETER: 60.0,
    Calibration.LEVEL: 10.0,
    Calibration.MAGNETOMETER: 60.0,
    Calibration.AIRSPEED_ZERO: 10.0,
    Calibration.AIRSPEED: 300.0,
    Calibration.WINGS: 10.0,
    Calibration.BATTERY: 10.0,
}
"""s; time limit, on six sides from one to the next; the samples collected by then are used"""
AT_REST = (Calibration.LEVEL, Calibration.AIRSPEED_ZERO, Calibration.WINGS, Calibration.BATTERY)
"""calibrations that a motion ends"""
RAW_IMU = (Calibration.ACCELEROMETER, Calibration.LEVEL, Calibration.MAGNETOMETER)
"""calibrations that use uncalibrated IMU samples"""
MOVING = 0.35
"""rad/s; maximum angular rate at rest"""
TOLERANCE = 1e-6
"""rad or V; rounding error of single precision on the wire"""
ARGUMENTS = {Calibration.WINGS: (-math.pi / 2.0, math.pi / 2.0), Calibration.BATTERY: (0.0, 100.0)}
"""rad or V; range of the argument"""
WORDS = {
    Calibration.ACCELEROMETER: "accelerometer: rest it on each of its six sides",
    Calibration.LEVEL: "accelerometer: keep it level and at rest",
    Calibration.MAGNETOMETER: "magnetometer: turn it about all axes",
    Calibration.AIRSPEED_ZERO: "airspeed zero: cover the pitot, keep it at rest",
    Calibration.AIRSPEED: "airspeed: fly a circle, or both directions",
    Calibration.WINGS: "wings: keep both at rest at the given angle",
    Calibration.BATTERY: "battery: keep the drives at rest",
}


class State(NamedTuple):
    """State of the active calibration, and result of the last one."""

    kind: Calibration = Calibration.NONE
    """-; active calibration, NONE if none"""
    argument: float = 0.0
    """rad or V; angle of the wings or voltage of the battery"""
    elapsed: float = 0.0
    """s; since the start, or since the last pose"""
    reported: float = 0.0
    """s; time since the last status message"""
    started: int = 0
    """-; number of calibrations since boot"""
    last: Calibration = Calibration.NONE
    """-; last calibration that began"""
    succeeded: int = 0
    """-; 1 if the last completed calibration set its parameters"""
    residual: float = 0.0
    """residual of the last completed calibration, in the unit of its sensor"""
    accelerometer: accelerometer.State = accelerometer.State()
    magnetometer: magnetometer.State = magnetometer.State()
    airspeed: airspeed.State = airspeed.State()
    wings: wings.State = wings.State()
    battery: battery.State = battery.State()


def start(state: State, kind: Calibration, argument: float) -> State:
    """Begin a calibration of ``kind``."""
    return State(kind, argument, started=state.started + 1, last=kind, succeeded=state.succeeded)


def stop(state: State, succeeded: bool = False, residual: float = 0.0) -> State:
    """End the calibration and discard its samples."""
    return State(started=state.started, last=state.last, succeeded=int(succeeded), residual=residual)


def refusal(state: State, kind: Calibration, argument: float, armed: bool, flying: bool) -> str:
    """Return why a calibration of ``kind`` is denied now; empty if permitted."""
    if state.kind:
        return f"calibration {state.kind.name} active"
    if kind == Calibration.AIRSPEED:
        return "" if flying else "not in flight"
    if armed:
        return "armed"
    low, high = ARGUMENTS.get(kind, (0.0, 0.0))
    return "" if low - TOLERANCE <= argument <= high + TOLERANCE else _outside(kind, argument, low, high)


def _outside(kind: Calibration, argument: float, low: float, high: float) -> str:
    """Return why an argument is out of range, in display units."""
    unit = {Calibration.WINGS: " degrees", Calibration.BATTERY: " V"}.get(kind, "")
    scale = math.degrees(1.0) if kind == Calibration.WINGS else 1.0
    return f"{scale * argument:.6g} is out of range {scale * low:g} to {scale * high:g}{unit}"


def progress(state: State) -> float:
    """Return the completed fraction, 0 to 1."""
    if state.kind == Calibration.ACCELEROMETER:
        return accelerometer.progress(state.accelerometer)
    if state.kind == Calibration.LEVEL:
        return accelerometer.progress_level(state.accelerometer)
    if state.kind == Calibration.MAGNETOMETER:
        return magnetometer.progress(state.magnetometer)
    if state.kind == Calibration.AIRSPEED_ZERO:
        return airspeed.progress_zero(state.airspeed)
    if state.kind == Calibration.AIRSPEED:
        return airspeed.progress_scale(state.airspeed)
    if state.kind == Calibration.WINGS:
        return wings.progress(state.wings)
    return battery.progress(state.battery) if state.kind == Calibration.BATTERY else float(state.succeeded)


def status(state: State, time_us: int) -> CalibrationStatus:
    """Return the calibration status message."""
    running = int(state.kind != Calibration.NONE)
    return CalibrationStatus(
        time_us, state.last, running, progress(state), state.started, state.succeeded, state.residual
    )


def finish(state: State, gains: FlightGains) -> Result:
    """Return the result of the calibration.

    Raises:
        InputError: insufficient samples or an implausible result; one line.
    """
    result, reason = _solved(state, gains)
    if reason:
        raise InputError(reason)
    return result


def _solved(state: State, gains: FlightGains) -> tuple[Result, str]:
    kind = state.kind
    if progress(state) < 1.0 and kind not in (Calibration.MAGNETOMETER, Calibration.AIRSPEED):
        return Result((), 0.0, "", 0), f"timed out after {PATIENCE[kind]:g} s"
    if kind == Calibration.ACCELEROMETER:
        return accelerometer.finish(state.accelerometer)
    if kind == Calibration.LEVEL:
        return accelerometer.finish_level(state.accelerometer, gains.imu)
    if kind == Calibration.MAGNETOMETER:
        return magnetometer.finish(state.magnetometer)
    if kind == Calibration.AIRSPEED_ZERO:
        return airspeed.finish_zero(state.airspeed)
    if kind == Calibration.AIRSPEED:
        return airspeed.finish_scale(state.airspeed, gains.air_data)
    if kind == Calibration.WINGS:
        return wings.finish(state.wings, gains.wing_angle, state.argument)
    return battery.finish(state.battery, gains.power, state.argument)


def applied(gains: FlightGains, settings: tuple[Setting, ...]) -> FlightGains:
    """Return the gains with ``settings``, rounded to the wire format of parameters.

    Raises:
        InputError: one is outside the range of its parameter; none is set in this case.
    """
    table = parameters.parameter_table(gains)
    for setting in settings:
        name = parameters.short_name(setting.section, setting.key, setting.place)
        entry = table[name]
        if not entry.low <= setting.value <= entry.high:
            raise InputError(f"{name} = {setting.value:g} is outside {entry.low:g} to {entry.high:g} {entry.unit}")
        gains = parameters.set_value(gains, table, name, setting.value).gains
    return gains
