"""Sensing tasks: raw samples to physical values."""

from __future__ import annotations

from typing import Final

from avionics import piloting, topics
from avionics.guidance.modes import AIRBORNE
from avionics.inputs import act, publish_event
from avionics.messages import AirData, Mode, Stage
from avionics.sensing import (
    air_data,
    airspeed_check,
    drive_torque,
    encoders,
    tail_check,
    vibration,
    wing_angle,
    wing_check,
)
from avionics.sensing import power as power_meter
from avionics.sensing.plausibility import gps_age
from avionics.state import AutopilotState
from wingbeat.message import Severity
from wingbeat.records import constructor
from wingbeat.topic import Publish

ON_GROUND, MANUAL = Stage.ON_GROUND, Mode.MANUAL
GROUND, LOW, HIGH = airspeed_check.Aloft
OPEN, WATCHED, DOUBTED = air_data.Gate
PRESSURE_TICKS: Final = 4
"""-; ticks between pressure samples; without samples the dependent filters advance at this rate"""


def vibrations(s: AutopilotState, publish: Publish) -> None:
    """Update the vibration levels; a rejected sample is ignored."""
    if not s.plausibility.bad & 1:
        s.vibration = vibration.step(s.gains.plausibility.accel_full, s.vibration, s.frame.imu, s.clock.dt)


_new_beat: Final = constructor(power_meter.Beat)


def power(s: AutopilotState, publish: Publish) -> None:
    """Update the drive power at each ADC burst.

    The current zero is estimated while disarmed with resting wings.
    """
    if s.frame.adc is not None:
        resting = not s.modes.armed and s.modes.stage == ON_GROUND
        clipped = s.power.clipped
        beat = _new_beat(s.wing.strokes, s.wing.frequency, s.wing.angle_left, s.wing.angle_right)
        s.power, s.power_state = power_meter.step(s.gains.power, s.power, s.frame.adc, beat, resting)
        publish(topics.POWER, s.power_state)
        if s.power.clipped and not clipped:
            text = "current above sensor range: power, energy and charge underestimated"
            publish_event(s, publish, Severity.WARNING, "power", text)


_new_commanded: Final = constructor(wing_angle.Commanded)


def wing(s: AutopilotState, publish: Publish) -> None:
    """Update the wing motion at each encoder sample.

    Without valid encoders it follows the commanded stroke.
    """
    gains, before, asked, sample = s.gains.wing_angle, s.wing, s.flapping, s.frame.encoder
    if sample is not None:
        parity = gains.sign_left * gains.sign_right
        s.encoders, counts = encoders.step(s.gains.encoders, s.encoders, sample, asked.frequency, parity)
    elif s.clock.time_us - s.encoders.time_us > encoders.LONGEST_SILENCE_US and s.encoders.time_us >= 0:
        s.encoders, counts = encoders.silence(s.encoders, s.clock.time_us)
    else:
        return
    commanded = _new_commanded(asked.frequency, asked.phase, asked.amplitude)
    s.wing_angle, s.wing = wing_angle.step(gains, s.wing_angle, counts, commanded)
    publish(topics.WING, s.wing)
    if encoders.health(s.wing) != encoders.health(before):
        for severity, text in encoders.changes(before, s.wing):
            publish_event(s, publish, severity, "encoders", text)


def air(s: AutopilotState, publish: Publish) -> None:
    """Update airspeed and pressure altitude at each pressure sample.

    The pitot zero is estimated while disarmed.
    """
    if s.frame.pressures is not None:
        on_ground = not s.modes.armed and s.modes.stage == ON_GROUND
        aloft = _aloft(s)
        s.air_data, measured = air_data.step(
            s.gains.air_data, s.air_data, s.frame.pressures, on_ground, _gate(s, aloft)
        )
        # The check uses the ungated airspeed, so that it also covers readings that the gate rejects.
        told = air_data.ungated(s.air_data, measured.density)
        s.airspeed_check, airspeed = airspeed_check.step(
            s.gains.airspeed_check, s.airspeed_check, s.clock.dt_50, told, _motion(s), aloft
        )
        s.air = _without_pitot(s, measured, airspeed) if s.airspeed_check.blocked else measured
        publish(topics.AIR_DATA, s.air)
    elif s.clock.ticks % PRESSURE_TICKS == 0 and silent(s):
        airspeed = airspeed_check.expected(s.gains.airspeed_check, s.airspeed_check, _motion(s))
        s.airspeed_check = s.airspeed_check._replace(blocked=1)
        s.air = _without_pitot(s, s.air, airspeed)._replace(time_us=s.clock.time_us, airspeed_rate=0.0)
        publish(topics.AIR_DATA, s.air)


def _gate(s: AutopilotState, aloft: airspeed_check.Aloft) -> air_data.Gate:
    """Return the gate mode: open until flight, because a throw resembles an outlier."""
    if aloft == GROUND:
        return OPEN
    return DOUBTED if airspeed_check.is_inconsistent(s.airspeed_check) else WATCHED


def _without_pitot(s: AutopilotState, air: AirData, airspeed: float) -> AirData:
    return air._replace(airspeed=airspeed, airspeed_variance=airspeed_check.variance(s.gains.airspeed_check))


def silent(s: AutopilotState) -> bool:
    """Return whether the pressure samples have timed out."""
    return 0 <= s.air_data.time_us < s.clock.time_us - s.gains.plausibility.baro_time * 1e6


def _motion(s: AutopilotState) -> airspeed_check.Motion | None:
    if s.last_fix is None or gps_age(s.plausibility, s.clock.time_us) >= s.gains.modes.gps_loss_delay:
        return None
    return airspeed_check.Motion(s.last_fix.v_north, s.last_fix.v_east, s.attitude.yaw)


def _aloft(s: AutopilotState) -> airspeed_check.Aloft:
    """Return the distance of the vehicle from the ground."""
    if s.modes.stage not in AIRBORNE or s.modes.armed == 0:
        return GROUND
    high = s.height > s.gains.navigation.flare_altitude
    return HIGH if high and s.flapping.frequency > 0.0 else LOW


def torque(s: AutopilotState, publish: Publish) -> None:
    """Update the drive torque at each strain gauge sample."""
    if s.frame.torque is not None:
        publish(topics.DRIVE_TORQUE, drive_torque.step(s.gains.torque, s.frame.torque))


def pilot(s: AutopilotState, publish: Publish) -> None:
    """Process the receiver frame with its switches, and the timeout of stick inputs."""
    sample = s.frame.receiver
    if sample is not None:
        act(s, publish, piloting.take_receiver(s, publish, sample), "receiver")
    if s.stick_inputs.source:
        piloting.watch(s, publish)


def wings(s: AutopilotState, publish: Publish) -> None:
    """Check the motion of both wings."""
    if s.frame.encoder is None:
        return
    raw, counts = s.gains.wing_angle, s.frame.encoder
    state = s.wing_check
    before = state.angles
    angles = wing_angle.angles(raw, counts.left_counts, counts.right_counts)
    told = int(s.modes.armed and s.modes.stage in AIRBORNE and s.flapping.frequency > 0.0)
    dt = s.clock.dt_50
    seen = wing_check.CheckInputs(
        (angles[0] - before[0]) / dt, (angles[1] - before[1]) / dt, s.power_state.current,
        s.attitude.roll_rate, told, s.wing.valid_left + 2 * s.wing.valid_right, angles,
    )  # fmt: skip
    s.wing_check = wing_check.step(s.gains.wing_check, state, dt, seen)


def tail(s: AutopilotState, publish: Publish) -> None:
    """Check the response of the tail."""
    closed = s.modes.stage in AIRBORNE and s.modes.mode != MANUAL and not s.modes.cut
    seen = tail_check.CheckInputs(
        s.pitch_loop_status.pitch_error, s.pitch_loop_status.elevator, s.pitch_loop.rate, s.air.airspeed
    )
    s.tail_check = tail_check.step(
        s.gains.tail_check, s.tail_check, s.clock.dt_50, seen, closed and not s.excitation_requested.active
    )
