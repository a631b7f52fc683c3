"""Jammed-tail detector: CUSUM test on the pitch acceleration of the elevator.

Two models of the pitch acceleration are compared, both without the slow part of the signals (trim and path)::

    working tail   q_dot + damping q = effect V^2 delta_e + gust
    jammed tail    q_dot + damping q =                      gust

The log-likelihood ratio of the second to the first, for Gaussian residuals of the same variance, is summed and reset
to zero if it turns negative: Page's cumulative sum (Basseville and Nikiforov 1993, *Detection of Abrupt Changes*,
section 2.2). It grows if the elevator has less than half of ``effect``. While the elevator is constant, both models
predict the same, and the sum does not change.
"""

from __future__ import annotations

from typing import Annotated, Final, NamedTuple

from avionics.limits import low_pass
from wingbeat.units import Quantity

SERVO: Final = 0.03
"""s; lag of the tail servo"""
SMOOTH: Final = 0.05
"""s; time constant of each of two low-pass filters before the differentiation"""
SLOW: Final = 0.5
"""s; time constant that separates trim and path from the quick part"""
CORRELATION: Final = 2.0 * SMOOTH
"""s; interval between independent residuals"""
LEAST_AIRSPEED: Final = 3.0
"""m/s; minimum airspeed in the model, because a pitot reads too low in a stall"""
LEAST_VARIANCE: Final = 1.0
"""(rad/s^2)^2; minimum residual variance: flapping that remains after the filters in still air"""


class Gains(NamedTuple):
    """Thresholds of the jam detection."""

    error: Annotated[float, Quantity("rad", 0.01, 3.2)]
    """rad; mean magnitude of the pitch error below which no jam is reported"""
    effect: Annotated[float, Quantity("rad/m^2", 0.0, 10.0)]
    """rad/m^2; pitch acceleration per elevator and airspeed squared of a working tail, conservative estimate"""
    time: Annotated[float, Quantity("s", 0.1, 60.0)]
    """s; time constant of the mean error and of the residual variance"""
    grace: Annotated[float, Quantity("s", 0.0, 60.0)]
    """s; time after the launch without detection"""
    damping: Annotated[float, Quantity("1/s", 0.0, 50.0)] = 8.0
    """1/s; pitch acceleration per pitch rate, positive if it damps"""
    threshold: Annotated[float, Quantity("-", 1.0, 1000.0)] = 20.0
    """-; cumulative log-likelihood ratio at which the tail counts as jammed"""


class Filters(NamedTuple):
    """Low-passed signals."""

    elevator: float = 0.0
    """rad; elevator after the lag of the servo"""
    moment: float = 0.0
    """rad (m/s)^2; elevator times airspeed squared, low-passed once"""
    moment_smooth: float = 0.0
    """rad (m/s)^2; low-passed twice"""
    moment_slow: float = 0.0
    """rad (m/s)^2; slow part"""
    rate: float = 0.0
    """rad/s; low-passed once"""
    rate_smooth: float = 0.0
    """rad/s; low-passed twice"""
    response_slow: float = 0.0
    """rad/s^2; slow part of acceleration plus damping"""


class State(NamedTuple):
    """State of the detector."""

    error: float = 0.0
    """rad; mean magnitude of the pitch error"""
    closed: float = 0.0
    """s; time with an active pitch loop"""
    jammed: int = 0
    """-; 1 once the tail is jammed; kept until the next arming"""
    variance: float = 0.0
    """(rad/s^2)^2; residual variance of the better model"""
    cusum: float = 0.0
    """-; cumulative log-likelihood ratio of a jammed to a working tail"""
    filters: Filters = Filters()


class CheckInputs(NamedTuple):
    """Inputs of the detector."""

    pitch_error: float
    """rad"""
    elevator: float
    """rad; commanded"""
    pitch_rate: float
    """rad/s; stroke-filtered"""
    airspeed: float
    """m/s"""


def step(gains: Gains, state: State, dt: float, inputs: CheckInputs, closed: bool) -> State:
    """Advance the detector by ``dt`` (s), reset unless the pitch loop is ``closed``."""
    if not closed:
        return State(jammed=state.jammed)
    time = state.closed + dt
    filters, moment, response = respond(gains, state.filters, dt, inputs)
    if time <= gains.grace:
        return State(0.0, time, state.jammed, 0.0, 0.0, filters)
    jammed_residual, working_residual = response, response - gains.effect * moment
    squares = jammed_residual * jammed_residual, working_residual * working_residual
    variance = low_pass(state.variance, min(squares), gains.time, dt)
    ratio = (squares[1] - squares[0]) / (2.0 * max(variance, LEAST_VARIANCE))
    cusum = max(0.0, state.cusum + ratio * dt / CORRELATION)
    error = low_pass(state.error, abs(inputs.pitch_error), gains.time, dt)
    jammed = state.jammed or (cusum > gains.threshold and error > gains.error)
    return State(error, time, 1 if jammed else 0, variance, cusum, filters)


def respond(gains: Gains, before: Filters, dt: float, sample: CheckInputs) -> tuple[Filters, float, float]:
    """Filter the signals and return the quick parts of moment and response.

    The moment is in rad (m/s)^2. The response (rad/s^2) is the pitch acceleration plus damping times the pitch rate.
    """
    airspeed = max(sample.airspeed, LEAST_AIRSPEED)
    elevator = low_pass(before.elevator, sample.elevator, SERVO, dt)
    moment = low_pass(before.moment, elevator * airspeed * airspeed, SMOOTH, dt)
    moment_smooth = low_pass(before.moment_smooth, moment, SMOOTH, dt)
    moment_slow = low_pass(before.moment_slow, moment_smooth, SLOW, dt)
    rate = low_pass(before.rate, sample.pitch_rate, SMOOTH, dt)
    rate_smooth = low_pass(before.rate_smooth, rate, SMOOTH, dt)
    response = (rate_smooth - before.rate_smooth) / dt + gains.damping * rate_smooth
    response_slow = low_pass(before.response_slow, response, SLOW, dt)
    filters = Filters(elevator, moment, moment_smooth, moment_slow, rate, rate_smooth, response_slow)
    return filters, moment_smooth - moment_slow, response - response_slow
