"""Guidance tasks: modes, mission, excitation, altitude and heading loops."""

from __future__ import annotations

from math import cos, sin
from typing import Final

from avionics import control_laws, topics
from avionics.guidance import altitude as altitude_loop
from avionics.guidance import excitation as excitation_input
from avionics.guidance import fence, supervisor, throttle_descent
from avionics.guidance import navigation as navigator
from avionics.guidance.mission import completion_text
from avionics.guidance.modes import AIRBORNE, GUIDED
from avionics.guidance.setpoint import Path, Setpoint
from avionics.guidance.stages import FAST
from avionics.inputs import publish_event, publish_notices
from avionics.limits import clip
from avionics.messages import AltitudeStatus, Failsafe, Mode, NavigationStatus, Stage
from avionics.situation import conditions, ground_motion, position_usable, surroundings
from avionics.state import AutopilotState
from wingbeat.message import Severity
from wingbeat.records import constructor
from wingbeat.topic import Publish

EN_ROUTE, WAIT_LAUNCH, CLIMB_OUT, FLARE = Stage.EN_ROUTE, Stage.WAIT_LAUNCH, Stage.CLIMB_OUT, Stage.FLARE
MANUAL, STABILIZED, OFFBOARD = Mode.MANUAL, Mode.STABILIZED, Mode.OFFBOARD
EXCITED = (Mode.AUTO, Mode.ALTITUDE_HOLD)
"""modes that permit an excitation"""
FOLDS: Final = "multisine aliases at {:.2f} Hz flapping; set period = {:.3f} s"
OUTSIDE: Final = int(Failsafe.FENCE)
UNDERGROUND: Final = 100.0
"""m; altitude setpoint below home for a descent to the ground from any altitude"""


def modes(s: AutopilotState, publish: Publish) -> None:
    """Advance stages and failsafes."""
    before = s.modes.failsafe
    s.modes, notices = supervisor.step(s.gains.modes, s.modes, s.clock.dt_50, conditions(s))
    if s.modes.failsafe & ~before & OUTSIDE:
        note_breach(s)
    publish_notices(s, publish, notices)


def note_breach(s: AutopilotState) -> None:
    """Store a new breach of the fence."""
    kind = fence.breach(s.gains.modes, s.modes, conditions(s))
    last = s.fence_state
    s.fence_state = last._replace(breaches=last.breaches + 1, kind=kind, since=s.clock.time_us * 1e-6)


def navigation(s: AutopilotState, publish: Publish) -> None:
    """Advance the navigation: items and modes to altitude and heading setpoints."""
    if s.modes.stage == WAIT_LAUNCH or s.modes.stage in AIRBORNE:
        before = s.navigation
        s.navigation, s.target = navigator.step(
            s.gains.navigation, s.navigation, s.clock.dt_20, s.mission, surroundings(s)
        )
        if s.navigation.landing_sequence > before.landing_sequence:
            text = f"landing sequence started at item {s.navigation.item}"
            publish_event(s, publish, Severity.INFO, "navigation", text)
        elif s.navigation.item != before.item:
            text = completion_text(before.item, s.mission[before.item])
            publish_event(s, publish, Severity.INFO, "navigation", text)
        if s.navigation.airspeed != before.airspeed:
            text = altitude_loop.airspeed_text(s.gains.altitude, s.navigation.airspeed)
            publish_event(s, publish, Severity.INFO, "navigation", text)
        if s.fence.zones:
            s.fence_clearance = fence.clearance(s.fence, s.position.north, s.position.east)
    publish(topics.NAVIGATION, navigation_status(s))


def navigation_status(s: AutopilotState) -> NavigationStatus:
    """Return the navigation status with mode and stage."""
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


_new_envelope_state: Final = constructor(excitation_input.EnvelopeState)


def excitation(s: AutopilotState, publish: Publish) -> None:
    """Advance the identification input that the navigation requests."""
    asked = s.target.excitation
    if asked is not None and (s.modes.stage != EN_ROUTE or s.modes.mode not in EXCITED):
        asked = None
    idle = s.excitation.phase == excitation_input.IDLE
    if asked is not None and idle and s.excitation.finished == s.navigation.excitations:
        s.excitation = excitation_input.start(s.excitation, asked)
        period = excitation_input.unfolding_period(asked, s.wing.frequency)
        if period:
            publish_event(s, publish, Severity.WARNING, "excitation", FOLDS.format(s.wing.frequency, period))
    flown = _new_envelope_state(s.pitch_loop.pitch, s.attitude.roll, s.air.airspeed, s.altitude.altitude)
    aborted = s.excitation.aborted
    s.excitation, s.excitation_requested = excitation_input.step(
        s.gains.excitation, s.excitation, s.clock.time_us, s.clock.dt_100, asked is not None, flown
    )
    if s.excitation.aborted and not aborted:
        publish_event(s, publish, Severity.WARNING, "excitation", "excitation aborted: outside the envelope")


def vertical(s: AutopilotState, publish: Publish) -> None:
    """Advance the altitude loop, or pass a direct command of stick or ground station."""
    gains, state, time_us, dt = s.gains.altitude, s.altitude_loop, s.clock.time_us, s.clock.dt_50
    law, asked = control_laws.ALTITUDE[gains.law], vertical_command(s)
    measured = altitude_loop.Measured(s.altitude.altitude, s.altitude.climb_rate, s.air.airspeed)
    if asked is not None:
        s.altitude_loop, s.altitude_loop_status = law.follow(gains, state, time_us, dt, asked)
    elif excitation_input.frozen(s.excitation):
        s.altitude_loop, s.altitude_loop_status = law.hold_trim(state, time_us, s.target.altitude, measured)
    elif s.tail_check.jammed:
        s.altitude_loop, s.altitude_loop_status = by_throttle_alone(s, measured)
    elif s.modes.stage == FLARE:
        s.altitude_loop, s.altitude_loop_status = law.step(flared(s), state, time_us, dt, -UNDERGROUND, measured)
    elif excitation_input.recovering(s.excitation):
        gains = altitude_loop.calm(gains)
        s.altitude_loop, s.altitude_loop_status = law.step(gains, state, time_us, dt, s.target.altitude, measured)
    else:
        setpoint = airspeed_setpoint(s)
        gains, state = altitude_loop.with_airspeed_setpoint(gains, state, dt, setpoint, s.air.airspeed)
        gains = gains if setpoint else altitude_loop.penetrating(gains, headwind(s))
        gains = altitude_loop.righting(gains, s.attitude.roll)
        s.altitude_loop, s.altitude_loop_status = law.step(gains, state, time_us, dt, s.target.altitude, measured)
    publish(topics.ALTITUDE_LOOP, s.altitude_loop_status)


def airspeed_setpoint(s: AutopilotState) -> float:
    """Return the airspeed setpoint (m/s) of a mission or of the ground station.

    The result is 0 if the vehicle selects the airspeed: on an approach, or without a pitot.
    """
    chosen = s.modes.stage != EN_ROUTE or s.modes.mode not in GUIDED or s.airspeed_check.blocked
    return 0.0 if chosen else s.navigation.airspeed


def headwind(s: AutopilotState) -> float:
    """Return the headwind (m/s) on the target course.

    The result is 0 without a position and in the climb-out.
    """
    if s.modes.mode not in GUIDED or s.modes.stage == CLIMB_OUT or not position_usable(s):
        return 0.0
    course, wind = s.target.heading, s.position
    return -(wind.wind_north * cos(course) + wind.wind_east * sin(course))


def by_throttle_alone(
    s: AutopilotState, measured: altitude_loop.Measured
) -> tuple[altitude_loop.State, AltitudeStatus]:
    """Descend by throttle without an elevator.

    The pitch loop keeps its trim in case the tail becomes free.
    """
    gains, dt = s.gains.altitude, s.clock.dt_50
    seen = throttle_descent.Measured(measured.climb_rate, s.pitch_loop.pitch)
    most = throttle_descent.upper_limit(gains.throttle_trim, gains.throttle_max, s.attitude.roll)
    s.throttle_descent, throttle = throttle_descent.step(
        s.gains.throttle_descent, s.throttle_descent, dt, s.altitude_loop.throttle, most, seen
    )
    asked = altitude_loop.DirectCommand(throttle, gains.pitch_trim)
    law = control_laws.ALTITUDE[gains.law]
    state, status = law.follow(gains, s.altitude_loop, s.clock.time_us, dt, asked)
    sink = s.gains.throttle_descent.sink
    return state, status._replace(climb_setpoint=-sink, climb_error=-sink - measured.climb_rate)


def vertical_command(s: AutopilotState) -> altitude_loop.DirectCommand | None:
    """Return throttle and pitch setpoint that bypass the altitude loop, if any."""
    trim = s.gains.altitude.pitch_trim
    mode, stage = s.modes.mode, s.modes.stage
    if not s.modes.armed:
        return altitude_loop.DirectCommand(0.0, trim)
    if mode == MANUAL:
        return altitude_loop.DirectCommand(s.pilot.throttle, trim)
    if mode == STABILIZED:
        return altitude_loop.DirectCommand(s.pilot.throttle, trim + s.gains.pitch.stick_pitch * s.pilot.pitch)
    if stage == WAIT_LAUNCH:
        # The flapping starts in the hand, because a weak throw would reach the ground while the stroke grows.
        leaving = s.modes.launch_state == FAST
        return altitude_loop.DirectCommand(
            s.gains.altitude.throttle_max if leaving else s.gains.modes.wait_throttle, trim
        )
    if s.modes.cut and stage != FLARE:
        return altitude_loop.DirectCommand(0.0, s.gains.modes.glide_pitch)
    attitude, limits = attitude_setpoint(s), s.gains.altitude
    if attitude is not None:
        return altitude_loop.DirectCommand(
            attitude.throttle, clip(attitude.pitch, limits.pitch_min, limits.pitch_max)
        )
    return None


def attitude_setpoint(s: AutopilotState) -> Setpoint | None:
    """Return the attitude setpoint of an external controller in OFFBOARD, if any."""
    setpoint = s.offboard.setpoint if s.modes.mode == OFFBOARD else None
    return setpoint if setpoint is not None and setpoint.path == Path.ATTITUDE else None


def flared(s: AutopilotState) -> altitude_loop.Gains:
    """Return the gains of the climb loop in the flare.

    The wings stop after a cut and below the touchdown airspeed. Above the flare altitude, as after a gust, the
    vehicle descends as on the glide path.
    """
    of, gains = s.gains.navigation, s.gains.altitude
    if s.height <= of.flare_altitude:
        flare = altitude_loop.Flare(of.flare_sink, of.flare_time, of.flare_throttle, of.flare_pitch)
        gains = altitude_loop.flaring(gains, flare, s.height)
    resting = s.modes.cut or s.air.airspeed < s.gains.modes.touchdown_airspeed
    return gains._replace(throttle_max=0.0, throttle_min=0.0) if resting else gains


def lateral(s: AutopilotState, publish: Publish) -> None:
    """Advance the heading loop, or pass the roll setpoint of stick or flare."""
    gains, state, time_us, dt = s.gains.heading, s.heading_loop, s.clock.time_us, s.clock.dt_50
    law, asked = control_laws.HEADING[gains.law], roll_command(s)
    motion = ground_motion(s)
    if asked is None:
        s.heading_loop, s.heading_loop_status = law.step(gains, state, time_us, dt, s.target.heading, motion)
    else:
        s.heading_loop, s.heading_loop_status = law.follow(gains, state, time_us, dt, asked, motion)
    publish(topics.HEADING_LOOP, s.heading_loop_status)


def roll_command(s: AutopilotState) -> float | None:
    """Return the roll setpoint (rad) that bypasses the heading loop, if any."""
    if s.modes.stage not in AIRBORNE or s.modes.stage == FLARE or s.modes.mode == MANUAL:
        return 0.0
    attitude = attitude_setpoint(s)
    if attitude is not None:
        return clip(attitude.roll, -s.gains.heading.roll_max, s.gains.heading.roll_max)
    if s.modes.mode in GUIDED or s.target.excitation is not None:
        return None
    return s.gains.roll.stick_roll * s.pilot.roll
