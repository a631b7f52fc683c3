"""The tasks of the processors: each takes what its module needs out of the state, steps it, publishes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from avionics import snapshot, topics
from avionics.estimation import ahrs
from avionics.estimation import altitude as altitude_filter
from avionics.estimation import position as position_filter
from avionics.guidance import altitude as altitude_loop
from avionics.guidance import excitation as excitation_input
from avionics.guidance import heading as heading_loop
from avionics.guidance import modes as flight_modes
from avionics.guidance import navigation as navigator
from avionics.guidance.modes import AIRBORNE, GUIDED
from avionics.inputs import say, tell
from avionics.limits import clip
from avionics.messages import (
    ActuatorCommand,
    Health,
    Mode,
    NavigationStatus,
    SensorFrame,
    Severity,
    Stage,
    Text,
)
from avionics.mixing import flapping, tail
from avionics.sensing import air_data, drive_torque, plausibility, wing_angle
from avionics.sensing import power as power_meter
from avionics.situation import conditions, ground_motion, surroundings
from avionics.stabilization import pitch as pitch_loop
from avionics.stabilization import roll as roll_loop
from avionics.state import AutopilotState
from avionics.topics import Topic

Publish = Callable[[Topic, Any], None]

RECORDED = (
    ("encoder", topics.ENCODER),
    ("pressures", topics.PRESSURES),
    ("adc", topics.ADC),
    ("torque", topics.TORQUE_RAW),
    ("gps", topics.GPS),
)


# --- the frame ------------------------------------------------------------------------------------------


def record_frame(publish: Publish, frame: SensorFrame) -> None:
    """The sensors as they came, refused samples too: a replay needs what the flight was given."""
    publish(topics.IMU, frame.imu)
    for name, topic in RECORDED:
        sample = getattr(frame, name)
        if sample is not None:
            publish(topic, sample)


def accept(s: AutopilotState, publish: Publish, frame: SensorFrame) -> None:
    """Take the frame, without the samples that cannot be."""
    record_frame(publish, frame)
    s.plausibility, frame, gone_bad = plausibility.step(s.gains.plausibility, s.plausibility, frame)
    s.frame = frame._replace(imu=s.frame.imu) if s.plausibility.bad & 1 else frame
    for name in gone_bad:
        say(s, publish, Severity.WARNING, "sensing", f"{name} sample refused: not finite or out of range")


def refuse_time(s: AutopilotState, publish: Publish, frame: SensorFrame) -> ActuatorCommand:
    """A frame that is not later than the last: count it, say so once, repeat the last actuators."""
    record_frame(publish, frame)
    first = not s.plausibility.time_refused
    s.plausibility = plausibility.refuse_time(s.plausibility)
    if first:
        text = f"sensor time went from {s.clock.time_us} to {frame.time_us} us: frames refused"
        say(s, publish, Severity.ERROR, "sensing", text)
    return s.actuators._replace(time_us=frame.time_us)


# --- attitude and power processors ----------------------------------------------------------------------


def attitude(s: AutopilotState, publish: Publish) -> None:
    """Attitude from the IMU; a refused sample changes nothing."""
    imu = s.frame.imu
    if s.ahrs is None:
        if s.plausibility.bad & 1:
            return
        s.ahrs = ahrs.start(s.gains.ahrs, imu)
    s.ahrs, s.attitude = ahrs.step(s.gains.ahrs, s.ahrs, imu, s.wing.frequency, s.air.airspeed)
    publish(topics.ATTITUDE, s.attitude)


def power(s: AutopilotState, publish: Publish) -> None:
    """Power of the drives, at each burst of the ADC."""
    if s.frame.adc is not None:
        s.power, s.power_state = power_meter.step(s.gains.power, s.power, s.frame.adc, s.wing.strokes)
        publish(topics.POWER, s.power_state)


# --- main processor: sense and estimate -----------------------------------------------------------------


def wing(s: AutopilotState, publish: Publish) -> None:
    """Wing motion, at each encoder sample."""
    if s.frame.encoder is not None:
        s.wing_angle, s.wing = wing_angle.step(s.gains.wing_angle, s.wing_angle, s.frame.encoder)
        publish(topics.WING, s.wing)


def air(s: AutopilotState, publish: Publish) -> None:
    """Airspeed and pressure altitude, at each pressure sample; the pitot's zero is learned while disarmed."""
    if s.frame.pressures is not None:
        on_ground = not s.modes.armed and s.modes.stage == Stage.ON_GROUND
        s.air_data, s.air = air_data.step(s.gains.air_data, s.air_data, s.frame.pressures, on_ground)
        publish(topics.AIR_DATA, s.air)


def torque(s: AutopilotState, publish: Publish) -> None:
    """Torque of the drives, at each sample of the strain gauges."""
    if s.frame.torque is not None:
        publish(topics.DRIVE_TORQUE, drive_torque.step(s.gains.torque, s.frame.torque))


def altitude(s: AutopilotState, publish: Publish) -> None:
    """Altitude and climb: gathers the acceleration of every tick, steps at each pressure sample."""
    s.altitude_filter = altitude_filter.accumulate(s.altitude_filter, s.attitude.accel_down)
    if s.frame.pressures is not None:
        s.altitude_filter, s.altitude = altitude_filter.step(
            s.gains.altitude_filter, s.altitude_filter, s.air, s.wing.frequency
        )
        publish(topics.ALTITUDE, s.altitude)


def position(s: AutopilotState, publish: Publish) -> None:
    """Position and wind: carried on at each pressure sample, corrected by the last fix."""
    if s.frame.gps is not None:
        s.fix = s.frame.gps
    if s.frame.pressures is not None:
        moved = position_filter.motion(s.attitude, s.air, s.altitude)
        s.position_filter, s.position = position_filter.step(s.gains.position_filter, s.position_filter, moved, s.fix)
        publish(topics.POSITION, s.position)


# --- main processor: guide ------------------------------------------------------------------------------


def modes(s: AutopilotState, publish: Publish) -> None:
    """Stages and failsafes."""
    s.modes, notices = flight_modes.step(s.gains.modes, s.modes, s.clock.dt_50, conditions(s))
    tell(s, publish, notices)


def navigation(s: AutopilotState, publish: Publish) -> None:
    """Mission items and modes -> altitude and heading to fly."""
    if s.modes.stage == Stage.WAIT_LAUNCH or s.modes.stage in AIRBORNE:
        item = s.navigation.item
        s.navigation, s.target = navigator.step(
            s.gains.navigation, s.navigation, s.clock.dt_20, s.mission, surroundings(s)
        )
        if s.navigation.item != item:
            say(s, publish, Severity.INFO, "navigation", f"item {item} done")
    publish(topics.NAVIGATION, navigation_status(s))


def navigation_status(s: AutopilotState) -> NavigationStatus:
    """What the navigation asks for, with mode and stage."""
    return NavigationStatus(
        s.clock.time_us,
        Mode(s.modes.mode),
        Stage(s.modes.stage),
        s.modes.armed,
        s.navigation.item,
        s.target.distance,
        s.target.cross_track,
        s.target.altitude,
        s.target.heading,
        excitation_input.frozen(s.excitation),
    )


def excitation(s: AutopilotState, publish: Publish) -> None:
    """Identification inputs, as the navigation asks for them."""
    asked = s.target.excitation
    if s.modes.stage != Stage.EN_ROUTE or s.modes.mode not in (Mode.AUTO, Mode.ALTITUDE_HOLD):
        asked = None
    waiting = s.excitation.phase == excitation_input.Phase.IDLE and s.excitation.finished == s.navigation.excitations
    if asked is not None and waiting:
        s.excitation = excitation_input.start(s.excitation, asked.repeats)
    flown = excitation_input.Flown(s.pitch_loop.pitch, s.attitude.roll, s.air.airspeed, s.altitude.altitude)
    aborted = s.excitation.aborted
    s.excitation, s.excited = excitation_input.step(
        s.gains.excitation, s.excitation, s.clock.time_us, s.clock.dt_100, asked, flown
    )
    if s.excitation.aborted and not aborted:
        say(s, publish, Severity.WARNING, "excitation", "manoeuvre aborted: outside its envelope")


def vertical(s: AutopilotState, publish: Publish) -> None:
    """Altitude -> climb -> throttle and pitch setpoint, or what the stick, the flare or the ground asks."""
    gains, state, time_us, dt = s.gains.altitude, s.altitude_loop, s.clock.time_us, s.clock.dt_50
    asked = asked_vertical(s)
    measured = altitude_loop.Measured(s.altitude.altitude, s.altitude.climb_rate, s.air.airspeed)
    if asked is not None:
        s.altitude_loop, s.vertical = altitude_loop.follow(gains, state, time_us, dt, asked)
    elif excitation_input.frozen(s.excitation):
        s.altitude_loop, s.vertical = altitude_loop.hold(state, time_us, s.target.altitude, measured)
    else:
        s.altitude_loop, s.vertical = altitude_loop.step(gains, state, time_us, dt, s.target.altitude, measured)
    publish(topics.ALTITUDE_LOOP, s.vertical)


def asked_vertical(s: AutopilotState) -> altitude_loop.Asked | None:
    """Throttle and pitch setpoint that bypass the altitude loop; None when the loop flies."""
    trim = s.gains.altitude.pitch_trim
    mode, stage = s.modes.mode, s.modes.stage
    if not s.modes.armed:
        return altitude_loop.Asked(0.0, trim)
    if mode == Mode.MANUAL:
        return altitude_loop.Asked(s.pilot.throttle, trim)
    if mode == Mode.STABILIZED:
        return altitude_loop.Asked(s.pilot.throttle, trim + s.gains.pitch.stick_pitch * s.pilot.pitch)
    if stage == Stage.WAIT_LAUNCH:
        return altitude_loop.Asked(s.gains.modes.wait_throttle, trim)
    if stage == Stage.FLARE:
        return altitude_loop.Asked(s.gains.navigation.flare_throttle, s.gains.navigation.flare_pitch)
    return None


def lateral(s: AutopilotState, publish: Publish) -> None:
    """Heading -> roll setpoint, or the stick's, or wings level near the ground."""
    gains, state, time_us, dt = s.gains.heading, s.heading_loop, s.clock.time_us, s.clock.dt_50
    asked = asked_roll(s)
    motion = ground_motion(s)
    if asked is None:
        s.heading_loop, s.lateral = heading_loop.step(gains, state, time_us, dt, s.target.heading, motion)
    else:
        s.heading_loop, s.lateral = heading_loop.follow(gains, state, time_us, dt, asked, motion)
    publish(topics.HEADING_LOOP, s.lateral)


def asked_roll(s: AutopilotState) -> float | None:
    """Roll setpoint (rad) that bypasses the heading loop; None when the loop flies."""
    if s.modes.stage not in AIRBORNE or s.modes.stage == Stage.FLARE or s.modes.mode == Mode.MANUAL:
        return 0.0
    if s.modes.mode in GUIDED or s.target.excitation is not None:
        return None
    return s.gains.roll.stick_roll * s.pilot.roll


# --- main processor: stabilize --------------------------------------------------------------------------


def loops_closed(s: AutopilotState) -> bool:
    """Whether the attitude loops fly: not on the ground or on the hand, and not in MANUAL."""
    return s.modes.stage in AIRBORNE and s.modes.mode != Mode.MANUAL


def pitch(s: AutopilotState, publish: Publish) -> None:
    """Pitch setpoint -> elevator."""
    gains, state, time_us, dt = s.gains.pitch, s.pitch_loop, s.clock.time_us, s.clock.dt_100
    measured = pitch_loop.Measured(s.attitude.pitch, s.attitude.pitch_rate, s.wing.frequency)
    setpoint = s.vertical.pitch_setpoint
    if not loops_closed(s):
        stick = s.pilot.pitch if s.modes.armed and s.modes.mode == Mode.MANUAL else 0.0
        elevator = gains.elevator_trim + gains.elevator_max * stick
        s.pitch_loop, s.elevator = pitch_loop.follow(gains, state, time_us, dt, elevator, measured)
    elif excitation_input.frozen(s.excitation):
        s.pitch_loop, s.elevator = pitch_loop.hold(gains, state, time_us, dt, setpoint, measured)
    else:
        s.pitch_loop, s.elevator = pitch_loop.step(gains, state, time_us, dt, setpoint, measured)
    publish(topics.PITCH_LOOP, s.elevator)


def roll(s: AutopilotState, publish: Publish) -> None:
    """Roll setpoint -> roll command."""
    if loops_closed(s):
        measured = (s.attitude.roll, s.attitude.roll_rate)
        s.roll_loop, s.roll_command = roll_loop.step(
            s.gains.roll, s.roll_loop, s.clock.time_us, s.clock.dt_100, s.lateral.roll_setpoint, measured
        )
    else:
        stick = s.pilot.roll if s.modes.armed and s.modes.mode == Mode.MANUAL else 0.0
        s.roll_loop, s.roll_command = roll_loop.follow(s.clock.time_us, stick)
    publish(topics.ROLL_LOOP, s.roll_command)


# --- main processor: mix --------------------------------------------------------------------------------


def mix(s: AutopilotState, publish: Publish) -> None:
    """Elevator, roll command and throttle -> tail and wing drives."""
    clock, added = s.clock, s.excited
    yaw_stick = s.pilot.yaw if s.modes.mode == Mode.MANUAL and s.modes.armed else 0.0
    asked = tail.Asked(
        s.elevator.elevator, s.roll_command.roll_command, yaw_stick, added.elevator, added.rudder, added.active
    )
    s.tail, moved = tail.step(s.gains.tail, s.tail, clock.dt, asked)
    if added.active:
        s.applied = (moved.applied_elevator, moved.applied_rudder)
    throttle = clip(s.vertical.throttle + added.throttle, 0.0, 1.0) if s.modes.armed else 0.0
    s.flapping, flap, stroke = flapping.step(
        s.gains.flapping, s.flapping, clock.time_us, clock.dt, throttle, moved.asymmetry
    )
    s.actuators = ActuatorCommand(
        clock.time_us,
        stroke.left,
        stroke.right,
        stroke.throttle,
        moved.elevator,
        moved.rudder,
        s.modes.armed,
    )
    publish(topics.FLAP, flap)
    publish(topics.ACTUATORS, s.actuators)


# --- logger ---------------------------------------------------------------------------------------------


def report_excitation(s: AutopilotState, publish: Publish) -> None:
    """The identification input as applied, after limits and servo rate."""
    applied = s.excited
    if applied.active:
        elevator, rudder = s.applied
        applied = applied._replace(elevator=elevator, rudder=rudder)
    publish(topics.EXCITATION, applied)


def report_health(s: AutopilotState, publish: Publish) -> None:
    """Failures, and counts of what was refused."""
    publish(topics.HEALTH, Health(s.clock.time_us, s.modes.failsafe, s.plausibility.rejected, s.clock.ticks + 1))


def report_snapshot(s: AutopilotState, publish: Publish) -> None:
    """The whole memory, from which a replay can start."""
    publish(topics.SNAPSHOTS, Text(s.clock.time_us, snapshot.encode(s)))
