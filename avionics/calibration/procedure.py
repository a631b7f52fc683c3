"""What runs while something is calibrated: which kind, since when, what was gathered, and what may stop it.

The samples come from the task (`avionics.tasks.calibrate`); the arithmetic is in a file for each sensor.
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
"""s; that it may take, on six sides from one to the next; what was gathered by then must do"""
AT_REST = (Calibration.LEVEL, Calibration.AIRSPEED_ZERO, Calibration.WINGS, Calibration.BATTERY)
"""ended by a movement"""
RAW_IMU = (Calibration.ACCELEROMETER, Calibration.LEVEL, Calibration.MAGNETOMETER)
"""need the IMU's samples as the sensor gives them"""
MOVING = 0.35
"""rad/s; rate of turn beyond which a vehicle is not at rest"""
TOLERANCE = 1e-6
"""rad or V; single precision of the wire"""
ARGUMENTS = {Calibration.WINGS: (-math.pi / 2.0, math.pi / 2.0), Calibration.BATTERY: (0.0, 100.0)}
"""rad or V; range of what is given, 0 where nothing is"""
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
    """What is remembered of the calibration that runs, and of the last one that ended."""

    kind: Calibration = Calibration.NONE
    """-; that runs, NONE for none"""
    argument: float = 0.0
    """rad or V; angle of the wings or voltage of the battery"""
    elapsed: float = 0.0
    """s; since the start, or since the last pose"""
    reported: float = 0.0
    """s; since the status was published"""
    started: int = 0
    """-; since boot"""
    last: Calibration = Calibration.NONE
    """-; that began last"""
    succeeded: int = 0
    """-; 1 when the last one that ended set its parameters"""
    residual: float = 0.0
    """of the last one that ended, in its sensor's unit"""
    accelerometer: accelerometer.State = accelerometer.State()
    magnetometer: magnetometer.State = magnetometer.State()
    airspeed: airspeed.State = airspeed.State()
    wings: wings.State = wings.State()
    battery: battery.State = battery.State()


def start(state: State, kind: Calibration, argument: float) -> State:
    """Begin gathering for ``kind``."""
    return State(kind, argument, started=state.started + 1, last=kind, succeeded=state.succeeded)


def stop(state: State, succeeded: bool = False, residual: float = 0.0) -> State:
    """End it; what was gathered is forgotten."""
    return State(started=state.started, last=state.last, succeeded=int(succeeded), residual=residual)


def refusal(state: State, kind: Calibration, argument: float, armed: bool, flying: bool) -> str:
    """Why ``kind`` cannot be calibrated now, one line; empty when it can."""
    if state.kind:
        return f"calibration {state.kind.name} active"
    if kind == Calibration.AIRSPEED:
        return "" if flying else "not in flight"
    if armed:
        return "armed"
    low, high = ARGUMENTS.get(kind, (0.0, 0.0))
    return "" if low - TOLERANCE <= argument <= high + TOLERANCE else _outside(kind, argument, low, high)


def _outside(kind: Calibration, argument: float, low: float, high: float) -> str:
    """What is wrong with what was given, in the unit in which people give it."""
    unit = {Calibration.WINGS: " degrees", Calibration.BATTERY: " V"}.get(kind, "")
    scale = math.degrees(1.0) if kind == Calibration.WINGS else 1.0
    return f"{scale * argument:.6g} is out of range {scale * low:g} to {scale * high:g}{unit}"


def progress(state: State) -> float:
    """Share of the samples that have been gathered, 0 to 1."""
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
    """What is told of it."""
    running = int(state.kind != Calibration.NONE)
    return CalibrationStatus(
        time_us, state.last, running, progress(state), state.started, state.succeeded, state.residual
    )


def finish(state: State, gains: FlightGains) -> Result:
    """What was found.

    Raises:
        InputError: too little was gathered, or what was found cannot be; one line.
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
    """The gains with the ``settings``, rounded to what a parameter can say on the wire.

    Raises:
        InputError: one lies outside its parameter's range; none is taken then.
    """
    table = parameters.parameter_table(gains)
    for setting in settings:
        name = parameters.short_name(setting.section, setting.key, setting.place)
        entry = table[name]
        if not entry.low <= setting.value <= entry.high:
            raise InputError(f"{name} = {setting.value:g} is outside {entry.low:g} to {entry.high:g} {entry.unit}")
        gains = parameters.set_value(gains, table, name, setting.value).gains
    return gains
