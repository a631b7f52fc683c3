"""Altitude and climb loops with the structure of the Paparazzi autopilot.

Malladi 2007, section IV.A: altitude error -> climb setpoint -> throttle (flapping) and pitch setpoint. The throttle
has a trim and a feed-forward term, so that the integrator only carries the residual.
"""

from __future__ import annotations

from typing import Annotated, Final, NamedTuple

from avionics.limits import clip, low_pass, slew
from avionics.messages import AltitudeStatus
from wingbeat.errors import InputError
from wingbeat.units import Quantity
from wingbeat.vehicle_file import Label

STEEP, STEEPEST = 0.7, 1.0
"""rad; bank at which the thrust limit starts to fall, and at which it reaches the minimum; above any bank setpoint"""
CALM_SHARE: Final = 0.5
"""-; factor on the altitude and climb gains while a trim is established"""


class Gains(NamedTuple):
    """Parameters of the altitude and climb loops."""

    proportional: Annotated[float, Quantity("1/s", 0.0, 5.0)]
    """1/s; climb setpoint per altitude error"""
    climb_max: Annotated[float, Quantity("m/s", 0.05, 10.0)]
    """m/s; maximum climb setpoint"""
    sink_max: Annotated[float, Quantity("m/s", 0.05, 10.0)]
    """m/s; maximum sink setpoint, positive"""
    climb_rate_limit: Annotated[float, Quantity("m/s^2", 0.05, 50.0)]
    """m/s^2; slew rate limit of the climb setpoint"""
    throttle_trim: Annotated[float, Quantity("-", 0.0, 1.0)]
    """-; throttle in level flight"""
    throttle_climb: Annotated[float, Quantity("s/m", 0.0, 1.0)]
    """s/m; throttle feed-forward per climb setpoint"""
    throttle_error: Annotated[float, Quantity("s/m", 0.0, 2.0)]
    """s/m; throttle per climb error"""
    throttle_integral: Annotated[float, Quantity("1/m", 0.0, 2.0)]
    """1/m; throttle rate per climb error"""
    integral_max: Annotated[float, Quantity("-", 0.0, 1.0)]
    """-; limit of the throttle integrator"""
    throttle_min: Annotated[float, Quantity("-", 0.0, 1.0)]
    """-; minimum throttle in flight"""
    throttle_max: Annotated[float, Quantity("-", 0.0, 1.0)]
    """-; maximum throttle in flight"""
    throttle_rate: Annotated[float, Quantity("1/s", 0.05, 20.0)]
    """1/s; slew rate limit of the throttle"""
    pitch_trim: Annotated[float, Quantity("rad", -0.5, 1.2)]
    """rad; pitch in level flight"""
    pitch_climb: Annotated[float, Quantity("rad s/m", -1.0, 1.0)]
    """rad s/m; pitch setpoint per climb setpoint"""
    pitch_error: Annotated[float, Quantity("rad s/m", -1.0, 1.0)]
    """rad s/m; pitch setpoint per climb error; responds to gusts faster than the throttle"""
    pitch_min: Annotated[float, Quantity("rad", -1.0, 1.2)]
    """rad; minimum pitch setpoint"""
    pitch_max: Annotated[float, Quantity("rad", -1.0, 1.4)]
    """rad; maximum pitch setpoint"""
    pitch_rate: Annotated[float, Quantity("rad/s", 0.01, 10.0)]
    """rad/s; slew rate limit of the pitch setpoint"""
    airspeed_min: Annotated[float, Quantity("m/s", 0.0, 20.0)]
    """m/s; airspeed below which the pitch setpoint is reduced"""
    airspeed_pitch: Annotated[float, Quantity("rad s/m", 0.0, 1.0)]
    """rad s/m; reduction of the pitch setpoint per airspeed below the minimum"""
    headwind: Annotated[float, Quantity("m/s", 0.0, 20.0)]
    """m/s; headwind above which the airspeed is increased"""
    headwind_pitch: Annotated[float, Quantity("rad s/m", 0.0, 0.2)]
    """rad s/m; reduction of the pitch trim per headwind above the threshold"""
    headwind_pitch_max: Annotated[float, Quantity("rad", 0.0, 0.5)]
    """rad; maximum reduction of the pitch trim in headwind"""
    trim_time: Annotated[float, Quantity("s", 0.05, 60.0)]
    """s; time constant of the mean throttle that is applied while the loop is frozen"""
    speed_min: Annotated[float, Quantity("m/s", 0.0, 50.0)] = 0.0
    """m/s; minimum airspeed setpoint"""
    speed_max: Annotated[float, Quantity("m/s", 0.0, 50.0)] = 0.0
    """m/s; maximum airspeed setpoint; 0 if no airspeed setpoint is accepted"""
    speed_time: Annotated[float, Quantity("s", 0.5, 60.0)] = 4.0
    """s; time constant of the response to the airspeed setpoint"""
    law: Annotated[str, Label()] = "cascade"
    """-; control law of the loop, a name of the table in `avionics.control_laws`"""


class State(NamedTuple):
    """State of the altitude and climb loops."""

    climb_setpoint: float = 0.0
    """m/s; climb setpoint of the previous step"""
    integral: float = 0.0
    """-; throttle integrator"""
    throttle: float = 0.0
    """-; throttle of the previous step"""
    pitch_setpoint: float = 0.0
    """rad; pitch setpoint of the previous step"""
    throttle_mean: float = 0.0
    """-; low-passed throttle"""
    speed_integral: float = 0.0
    """m; integral of the airspeed error; 0 without a setpoint"""


class Measured(NamedTuple):
    """Measurements used by the altitude and climb loops."""

    altitude: float
    """m; positive up"""
    climb_rate: float
    """m/s; positive up"""
    airspeed: float
    """m/s; true airspeed"""


def initial(gains: Gains, throttle: float = 0.0) -> State:
    """Return a state that starts from ``throttle`` and the trim pitch."""
    return State(0.0, 0.0, throttle, gains.pitch_trim, gains.throttle_trim)


def step(
    gains: Gains, state: State, time_us: int, dt: float, altitude_setpoint: float, measured: Measured
) -> tuple[State, AltitudeStatus]:
    """Advance both loops by ``dt`` (s) toward ``altitude_setpoint`` (m)."""
    altitude_error = altitude_setpoint - measured.altitude
    wanted = clip(gains.proportional * altitude_error, -gains.sink_max, gains.climb_max)
    climb_setpoint = slew(state.climb_setpoint, wanted, gains.climb_rate_limit, dt)
    climb_error = climb_setpoint - measured.climb_rate
    integral, throttle, saturated = _throttle(gains, state, dt, climb_setpoint, climb_error)
    pitch_setpoint = _pitch_setpoint(gains, state, dt, (climb_setpoint, climb_error), measured.airspeed)
    mean = low_pass(state.throttle_mean, throttle, gains.trim_time, dt)
    status = AltitudeStatus(
        time_us, altitude_error, climb_setpoint, climb_error, integral, throttle, pitch_setpoint, saturated
    )  # fmt: skip
    return State(climb_setpoint, integral, throttle, pitch_setpoint, mean, state.speed_integral), status


def _throttle(
    gains: Gains, state: State, dt: float, climb_setpoint: float, climb_error: float
) -> tuple[float, float, int]:
    """Return integrator, throttle and saturation of the climb loop.

    Integration stops while it would drive the throttle further into saturation (conditional anti-windup).
    """
    forward = gains.throttle_trim + gains.throttle_climb * climb_setpoint + gains.throttle_error * climb_error
    grown = state.integral + gains.throttle_integral * climb_error * dt
    integral = clip(grown, -gains.integral_max, gains.integral_max)
    wanted = forward + integral
    saturated = not gains.throttle_min <= wanted <= gains.throttle_max
    if saturated and (wanted > gains.throttle_max) == (climb_error > 0.0):
        integral = state.integral
    limited = clip(forward + integral, gains.throttle_min, gains.throttle_max)
    return integral, slew(state.throttle, limited, gains.throttle_rate, dt), int(saturated)


def _pitch_setpoint(gains: Gains, state: State, dt: float, climb: tuple[float, float], airspeed: float) -> float:
    """Return the pitch setpoint for the setpoint and the error of the climb loop."""
    missing = gains.airspeed_min - airspeed
    wanted = gains.pitch_trim + gains.pitch_climb * climb[0] + gains.pitch_error * climb[1]
    if missing > 0.0:
        # Clip before the reduction, so that a large climb demand cannot cancel the airspeed protection.
        wanted = min(wanted, gains.pitch_max) - gains.airspeed_pitch * missing
    return slew(state.pitch_setpoint, clip(wanted, gains.pitch_min, gains.pitch_max), gains.pitch_rate, dt)


def hold_trim(
    state: State, time_us: int, altitude_setpoint: float, measured: Measured
) -> tuple[State, AltitudeStatus]:
    """Return the trim throttle and pitch setpoint while an excitation is active.

    The throttle is its running mean and the pitch setpoint is the last one. The integrator is frozen.
    """
    held = state._replace(throttle=state.throttle_mean)
    return held, AltitudeStatus(
        time_us,
        altitude_setpoint - measured.altitude,
        state.climb_setpoint,
        state.climb_setpoint - measured.climb_rate,
        state.integral,
        held.throttle,
        state.pitch_setpoint,
        0,
    )


def calm(gains: Gains) -> Gains:
    """Return gains that settle the loops at a trim before they are frozen.

    The pitch stays at its trim and the throttle gains are halved. With the full gains throttle and pitch oscillate
    after each release, and a trim averaged over the oscillation amplifies the next one.
    """
    return gains._replace(
        proportional=CALM_SHARE * gains.proportional,
        throttle_climb=CALM_SHARE * gains.throttle_climb,
        throttle_error=CALM_SHARE * gains.throttle_error,
        throttle_integral=CALM_SHARE * gains.throttle_integral,
        pitch_climb=0.0,
        pitch_error=0.0,
    )


def penetrating(gains: Gains, headwind: float) -> Gains:
    """Return gains with a reduced pitch trim against ``headwind`` (m/s).

    The airspeed rises, so that the vehicle makes progress over ground.
    """
    taken = clip(gains.headwind_pitch * (headwind - gains.headwind), 0.0, gains.headwind_pitch_max)
    return gains._replace(pitch_trim=gains.pitch_trim - taken) if taken else gains


def with_airspeed_setpoint(
    gains: Gains, state: State, dt: float, setpoint: float, airspeed: float
) -> tuple[Gains, State]:
    """Return gains and state for an airspeed ``setpoint`` (m/s).

    A setpoint of 0 selects the airspeed of the trim pitch. The throttle controls the altitude, so that the pitch of
    level flight sets the airspeed. A PI controller on the airspeed error moves the trim pitch; it cancels a
    first-order lag of ``speed_time`` and the slope ``headwind_pitch`` (internal model control, Rivera et al. 1986,
    table I). The integral stops while the throttle is at the limit that the airspeed requires.
    """
    if setpoint == 0.0 or gains.speed_max == 0.0:
        return gains, state._replace(speed_integral=0.0) if state.speed_integral else state
    error = _within_range(gains, setpoint) - airspeed
    limited = state.throttle >= gains.throttle_max if error > 0.0 else state.throttle <= gains.throttle_min
    integral = state.speed_integral if limited else state.speed_integral + error * dt
    most = (gains.pitch_max - gains.pitch_min) * gains.speed_time / max(gains.headwind_pitch, 1e-3)
    integral = clip(integral, -most, most)
    trim = gains.pitch_trim - gains.headwind_pitch * (error + integral / gains.speed_time)
    return gains._replace(pitch_trim=trim), state._replace(speed_integral=integral)


def check(gains: Gains) -> None:
    """Check that gains fit together.

    Raises:
        InputError: minimum above maximum airspeed setpoint.
    """
    if 0.0 < gains.speed_max < gains.speed_min:
        raise InputError(f"speed_min {gains.speed_min:g} m/s is above speed_max {gains.speed_max:g} m/s")


def _within_range(gains: Gains, setpoint: float) -> float:
    """Limit an airspeed setpoint; the maximum has priority over the minimum."""
    return clip(setpoint, min(gains.speed_min, gains.speed_max), gains.speed_max)


def airspeed_text(gains: Gains, setpoint: float) -> str:
    """Return the event text for a change of the airspeed ``setpoint`` (m/s)."""
    if setpoint == 0.0:
        return "airspeed setpoint cleared"
    if gains.speed_max == 0.0:
        return f"airspeed: {setpoint:g} m/s ignored, ALT_SPD_MAX is 0"
    flown = _within_range(gains, setpoint)
    return f"airspeed: {flown:g} m/s" + ("" if flown == setpoint else f", {setpoint:g} m/s is outside its range")


def righting(gains: Gains, bank: float) -> Gains:
    """Return gains with the maximum throttle reduced at a steep ``bank`` (rad).

    The vehicle recovers to level flight before it climbs. At a steep bank thrust increases the airspeed, and a higher
    airspeed reduces the restoring moment of the dihedral: the vehicle enters a spiral dive.
    """
    share = clip((abs(bank) - STEEP) / (STEEPEST - STEEP), 0.0, 1.0)
    if share == 0.0:
        return gains
    most = (1.0 - share) * gains.throttle_max + share * gains.throttle_min
    return gains._replace(throttle_max=most)


class Flare(NamedTuple):
    """Parameters of the flare."""

    sink: float
    """m/s; maximum sink at and below the altitude of the landing point"""
    time: float
    """s; altitude per increase of the maximum sink"""
    throttle: float
    """-; throttle trim during the flare; below the level trim, so that the vehicle decelerates"""
    pitch_min: float
    """rad; minimum pitch setpoint"""


def flaring(gains: Gains, flare: Flare, altitude: float) -> Gains:
    """Return gains for the flare at ``altitude`` (m above the landing point).

    The maximum sink decreases with altitude, so that the flare takes the same time from any approach. Throttle and
    pitch still respond to gusts.
    """
    sink = min(flare.sink + max(altitude, 0.0) / flare.time, gains.sink_max)
    least = min(gains.throttle_min, flare.throttle)
    return gains._replace(
        sink_max=sink, throttle_trim=flare.throttle, throttle_climb=0.0, throttle_min=least, pitch_min=flare.pitch_min
    )


class DirectCommand(NamedTuple):
    """Throttle and pitch setpoint from a stick or from the ground station."""

    throttle: float
    """-; from 0 to 1"""
    pitch_setpoint: float
    """rad; positive nose up"""


def follow(
    gains: Gains, state: State, time_us: int, dt: float, direct: DirectCommand
) -> tuple[State, AltitudeStatus]:
    """Track a direct command, so that the transfer to the loops is bumpless."""
    throttle = slew(state.throttle, clip(direct.throttle, 0.0, 1.0), gains.throttle_rate, dt)
    pitch_setpoint = slew(state.pitch_setpoint, direct.pitch_setpoint, gains.pitch_rate, dt)
    followed = State(0.0, 0.0, throttle, pitch_setpoint, gains.throttle_trim)
    return followed, AltitudeStatus(time_us, 0.0, 0.0, 0.0, 0.0, throttle, pitch_setpoint, 0)
