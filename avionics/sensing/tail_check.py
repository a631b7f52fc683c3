"""Whether the tail answers: the pitch error stays large, and the pitch does not turn with the elevator.

A gust leaves a large error too, for as long as a jammed tail does; but there the pitch acceleration still follows the
elevator. How much, is the slope of a running regression of the acceleration on elevator times airspeed squared and on
the pitch rate, both without what is slow: a tail that moves turns the vehicle with the dynamic pressure, and the
airframe's own damping goes with the rate. Measured on eight flights of two vehicles, four of them in moderate gusts:
0.11 to 0.9 rad/m^2 for a tail that works, within 0.07 of nothing for a jammed one.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from avionics.limits import low_pass
from avionics.quantities import Quantity

SMOOTH = 0.05
"""s; time constant of the low-pass on elevator and rate before the acceleration is taken"""
SLOW = 0.5
"""s; what changes slower than this is trim and path"""
NOTHING = 1e-9
"""of the determinant; with no elevator moving there is no slope"""


class Gains(NamedTuple):
    """When the tail is jammed."""

    error: Annotated[float, Quantity("rad", 0.01, 3.2)]
    """rad; mean size of the pitch error that a working tail does not leave in still air"""
    effect: Annotated[float, Quantity("rad/m^2", 0.0, 10.0)]
    """rad/m^2; pitch acceleration per elevator and airspeed squared, less than any working tail gives"""
    time: Annotated[float, Quantity("s", 0.1, 60.0)]
    """s; time constant of both means"""
    grace: Annotated[float, Quantity("s", 0.0, 60.0)]
    """s; after the launch, in which nothing is judged"""


class Response(NamedTuple):
    """The running regression of pitch acceleration on elevator and rate."""

    moment: float = 0.0
    """rad (m/s)^2; smoothed elevator times airspeed squared"""
    rate: float = 0.0
    """rad/s; smoothed pitch rate"""
    moment_slow: float = 0.0
    """rad (m/s)^2; its slow part"""
    rate_slow: float = 0.0
    """rad/s; its slow part"""
    turn_slow: float = 0.0
    """rad/s^2; slow part of the acceleration"""
    moment_moment: float = 0.0
    """mean square, of what is quick in it; the next four alike"""
    moment_rate: float = 0.0
    rate_rate: float = 0.0
    moment_turn: float = 0.0
    rate_turn: float = 0.0

    @property
    def effect(self) -> float:
        """rad/m^2; pitch acceleration per elevator and airspeed squared, 0 while nothing moves."""
        determinant = self.moment_moment * self.rate_rate - self.moment_rate * self.moment_rate
        slope = self.moment_turn * self.rate_rate - self.rate_turn * self.moment_rate
        return slope / (determinant + NOTHING)


class State(NamedTuple):
    """What the check remembers."""

    error: float = 0.0
    """rad; mean size"""
    closed: float = 0.0
    """s; for which the pitch loop has flown"""
    jammed: int = 0
    """-; 1 once the tail is jammed; kept until the next arming"""
    response: Response = Response()


class Seen(NamedTuple):
    """What the check looks at."""

    pitch_error: float
    """rad"""
    elevator: float
    """rad; commanded"""
    pitch_rate: float
    """rad/s"""
    airspeed: float
    """m/s"""


def step(gains: Gains, state: State, dt: float, seen: Seen, closed: bool) -> State:
    """One look; ``dt`` in s, ``closed`` while the pitch loop flies."""
    if not closed:
        return State(0.0, 0.0, state.jammed)
    time = state.closed + dt
    error = low_pass(state.error, abs(seen.pitch_error), gains.time, dt) if time > gains.grace else 0.0
    response = respond(state.response, seen, gains.time, dt)
    jammed = state.jammed or (error > gains.error and response.effect < gains.effect)
    return State(error, time, 1 if jammed else 0, response)


def respond(before: Response, seen: Seen, time: float, dt: float) -> Response:
    """The regression after one more look; ``time`` (s) is that of its memory."""
    moment = low_pass(before.moment, seen.elevator * seen.airspeed * seen.airspeed, SMOOTH, dt)
    rate = low_pass(before.rate, seen.pitch_rate, SMOOTH, dt)
    turn = (rate - before.rate) / dt
    moment_slow = low_pass(before.moment_slow, moment, SLOW, dt)
    rate_slow = low_pass(before.rate_slow, rate, SLOW, dt)
    turn_slow = low_pass(before.turn_slow, turn, SLOW, dt)
    m, r, a = moment - moment_slow, rate - rate_slow, turn - turn_slow
    return Response(
        moment, rate, moment_slow, rate_slow, turn_slow,
        low_pass(before.moment_moment, m * m, time, dt),
        low_pass(before.moment_rate, m * r, time, dt),
        low_pass(before.rate_rate, r * r, time, dt),
        low_pass(before.moment_turn, m * a, time, dt),
        low_pass(before.rate_turn, r * a, time, dt),
    )  # fmt: skip
