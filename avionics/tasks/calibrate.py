"""Calibration task: collects samples and applies the result."""

from __future__ import annotations

import math
from typing import Final

from avionics import parameters, topics
from avionics.calibration import accelerometer, airspeed, battery, magnetometer, procedure, wings
from avionics.calibration.result import NOTHING_NEW, Took
from avionics.guidance.modes import AIRBORNE
from avionics.inputs import publish_event, publish_parameter
from avionics.messages import Calibration
from avionics.sensing import air_data, encoders, inertial, preflight
from avionics.state import AutopilotState
from wingbeat.errors import InputError
from wingbeat.message import Severity
from wingbeat.topic import Publish

REPORT_INTERVAL: Final = 0.5
"""s; interval of the status message"""


def calibrate(s: AutopilotState, publish: Publish) -> None:
    """Advance an active calibration by one tick."""
    if not s.calibration.kind:
        return
    cancelled = reason_to_stop(s)
    took = Took(cancelled=cancelled) if cancelled else gather(s)
    state = s.calibration
    s.calibration = state._replace(elapsed=state.elapsed + s.clock.dt, reported=state.reported + s.clock.dt)
    if took.note:
        publish_event(s, publish, Severity.INFO, "calibration", took.note)
        s.calibration = _recorded(s.calibration)
    if took.cancelled:
        give_up(s, publish, f"canceled: {took.cancelled}")
    elif took.complete or state.elapsed >= procedure.PATIENCE[state.kind]:
        _solve(s, publish)
    elif took.note or s.calibration.reported >= REPORT_INTERVAL:
        s.calibration = s.calibration._replace(reported=0.0)
        publish(topics.CALIBRATION, procedure.status(s.calibration, s.clock.time_us))


def _recorded(state: procedure.State) -> procedure.State:
    """Restart the timeout for the next of six sides."""
    return state._replace(elapsed=0.0) if state.kind == Calibration.ACCELEROMETER else state


def reason_to_stop(s: AutopilotState) -> str:
    """Return the reason to stop the calibration; empty if there is none."""
    kind = s.calibration.kind
    if kind == Calibration.AIRSPEED:
        return "" if s.modes.stage in AIRBORNE else "no longer in flight"
    if s.modes.armed:
        return "armed"
    turning = math.hypot(s.attitude.roll_rate, s.attitude.pitch_rate, s.attitude.yaw_rate)
    return "vehicle moved" if kind in procedure.AT_REST and turning > procedure.MOVING else ""


def gather(s: AutopilotState) -> Took:
    """Process the samples of this tick that the calibration requires."""
    kind, frame, state = s.calibration.kind, s.frame, s.calibration
    took = NOTHING_NEW
    if kind in procedure.RAW_IMU:
        return _gather_imu(s)
    if kind == Calibration.AIRSPEED_ZERO and frame.pressures is not None:
        pressure = air_data.differential(s.gains.air_data, frame.pressures.differential_counts)
        gathered, took = airspeed.step_zero(state.airspeed, pressure)
        s.calibration = state._replace(airspeed=gathered)
    elif kind == Calibration.AIRSPEED and frame.gps is not None and frame.gps.fix_type >= 2:
        gathered, took = airspeed.step_scale(state.airspeed, _is_airborne(s))
        s.calibration = state._replace(airspeed=gathered)
    elif kind == Calibration.WINGS and frame.encoder is not None:
        at_rest, took = wings.step(state.wings, encoders.without_missed(s.encoders, frame.encoder))
        s.calibration = state._replace(wings=at_rest)
    elif kind == Calibration.BATTERY and frame.adc is not None:
        supply, took = battery.step(s.gains.power, state.battery, frame.adc)
        s.calibration = state._replace(battery=supply)
    return took


def _gather_imu(s: AutopilotState) -> Took:
    imu, state = s.frame.imu, s.calibration
    if s.plausibility.bad & 1:
        return NOTHING_NEW
    if state.kind == Calibration.MAGNETOMETER:
        turned, took = magnetometer.step(state.magnetometer, (imu.mag_x, imu.mag_y, imu.mag_z))
        s.calibration = state._replace(magnetometer=turned)
        return took
    step = accelerometer.step if state.kind == Calibration.ACCELEROMETER else accelerometer.step_level
    gathered, took = step(state.accelerometer, (imu.accel_x, imu.accel_y, imu.accel_z))
    s.calibration = state._replace(accelerometer=gathered)
    return took


def _is_airborne(s: AutopilotState) -> airspeed.Sample:
    """Return heading, horizontal airspeed and ground velocity at a fix."""
    fix, climb, speed = s.frame.gps, s.altitude.climb_rate, s.air.airspeed
    assert fix is not None
    level = math.sqrt(max(speed * speed - climb * climb, 0.0))
    return s.attitude.yaw, level, fix.v_north, fix.v_east


def give_up(s: AutopilotState, publish: Publish, reason: str) -> None:
    """End the calibration without a result, and publish the reason."""
    name = s.calibration.kind.name
    s.calibration = procedure.stop(s.calibration)
    publish_event(s, publish, Severity.WARNING, "calibration", f"{name} calibration failed: {reason}")
    publish(topics.CALIBRATION, procedure.status(s.calibration, s.clock.time_us))


def _solve(s: AutopilotState, publish: Publish) -> None:
    kind = s.calibration.kind
    try:
        result = procedure.finish(s.calibration, s.gains)
        before = s.gains
        s.gains = procedure.applied(before, result.settings)
    except InputError as refused:
        give_up(s, publish, str(refused))
        return
    s.calibration = procedure.stop(s.calibration, succeeded=True, residual=result.residual)
    _restart(s, kind)
    for name, value in parameters.changed(before, s.gains).items():
        publish_parameter(s, publish, name, value, "calibration")
    text = f"{kind.name} calibrated: residual {result.residual:.3g} {result.unit} RMS, {result.samples} samples"
    publish_event(s, publish, Severity.NOTICE, "calibration", text)
    publish(topics.CALIBRATION, procedure.status(s.calibration, s.clock.time_us))


def _restart(s: AutopilotState, kind: Calibration) -> None:
    """Reset the estimates that depend on the previous values."""
    if kind in procedure.RAW_IMU:
        s.ahrs, s.preflight = None, preflight.State()
        s.frame = s.frame._replace(imu=inertial.correct(s.gains.imu, s.frame.imu))
    elif kind == Calibration.AIRSPEED_ZERO:
        s.air_data = s.air_data._replace(zero=0.0, zero_span=0.0)
