"""OFFBOARD mode: setpoints of an external controller; LOITER after a timeout.

A position setpoint is circled, as in GUIDED of ArduPlane; a velocity setpoint gives a course and a climb rate. The
airspeed is the default of the vehicle.
"""

from __future__ import annotations

from avionics.guidance import circle, modes
from avionics.guidance.route import Gains, Situation, State, Target, least_altitude
from avionics.guidance.setpoint import Path, Received, Setpoint
from avionics.limits import clip
from avionics.messages import Mode, Stage
from wingbeat.message import Severity


def valid(gains: Gains, received: Received, time_us: int) -> int:
    """Return 1 if a setpoint is available that has not expired at ``time_us``."""
    if received.setpoint is None:
        return 0
    return int(not received.setpoint.expires or (time_us - received.time_us) * 1e-6 <= gains.offboard_timeout)


def watch(state: modes.State, conditions: modes.Conditions) -> modes.Outcome:
    """Change from OFFBOARD to LOITER if the setpoint has expired."""
    if state.mode != Mode.OFFBOARD or conditions.setpoint_valid:
        return state, ()
    return modes.enter(
        state._replace(rescued=1), Mode.LOITER, Severity.WARNING, "offboard: setpoints timed out, LOITER"
    )


def resolve(gains: Gains, last: Setpoint | None, new: Setpoint, situation: Situation) -> Setpoint:
    """Return ``new`` with an explicit path.

    KEEP and CIRCLE_HERE become a circle at a position, or the path of ``last``.

    Args:
        last: the active setpoint, None if there is none.
    """
    path = new.path
    if path in (Path.COURSE, Path.ATTITUDE):
        return new
    if path == Path.CIRCLE_AT:
        return new._replace(radius=new.radius or gains.loiter_radius)
    if last is not None and (last.path == Path.CIRCLE_HERE or (path == Path.KEEP and last.path != Path.ATTITUDE)):
        kept = last._replace(altitude=new.altitude, climb_rate=new.climb_rate)
        return kept._replace(expires=max(new.expires, last.expires))
    north, east = circle.tangent_center(gains.loiter_radius, situation)
    return new._replace(path=Path.CIRCLE_HERE, north=north, east=east, radius=gains.loiter_radius)


def fly(gains: Gains, state: State, dt: float, setpoint: Setpoint, situation: Situation) -> tuple[State, Target]:
    """Advance along a setpoint of `resolve` by ``dt`` (s).

    An altitude ramp is limited to the range from the least turning altitude to the ceiling of the fence, and its rate
    to that of the pitch stick in ALTITUDE_HOLD.
    """
    if setpoint.path == Path.ATTITUDE:
        state = state._replace(radius=0.0, heading=situation.heading, altitude=situation.altitude)
        return state, Target(Stage.EN_ROUTE, situation.altitude, situation.heading)
    state = state._replace(altitude=_altitude(gains, state, dt, setpoint, situation))
    if setpoint.path == Path.COURSE:
        state = state._replace(radius=0.0, heading=setpoint.course)
        return state, Target(Stage.EN_ROUTE, state.altitude, setpoint.course)
    center = (setpoint.north, setpoint.east, setpoint.radius)
    if (state.centre_north, state.centre_east, state.radius) != center:
        state = circle.centre_at(state, *center, situation)
    return circle.around(gains, state, dt, state.altitude, situation)


def _altitude(gains: Gains, state: State, dt: float, setpoint: Setpoint, situation: Situation) -> float:
    """Return the altitude setpoint (m)."""
    if setpoint.altitude is not None:
        return setpoint.altitude
    if setpoint.climb_rate == 0.0:
        return state.altitude
    ramped = state.altitude + clip(setpoint.climb_rate, -gains.stick_climb, gains.stick_climb) * dt
    # A vehicle outside these limits may return to them at any rate.
    low = min(least_altitude(gains, situation.ceiling), state.altitude)
    return clip(ramped, low, max(situation.ceiling, state.altitude))
