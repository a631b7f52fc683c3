"""Wing motion from encoder counts: angle, rate, phase, frequency and the shape of the last stroke.

A stroke runs from one upward crossing of the stroke's middle to the next, for the mean of both wings. Crossings are
timed by interpolation between samples and confirmed by a hysteresis, so that neither the encoder's steps (0.18
degree, E2-500, Gerdes et al. 2017 Table 1) nor a trembling wing make strokes. Between crossings the phase runs
on with the period of the last stroke.
"""

from __future__ import annotations

from math import pi
from typing import Annotated, NamedTuple

from avionics.messages import EncoderSample, WingState
from avionics.quantities import Quantity

TWO_PI = 2.0 * pi
PATIENCE = 1.5
"""-; periods without an upward crossing after which the wing does not flap"""


class Gains(NamedTuple):
    """Calibration of the encoders and what counts as flapping."""

    counts_per_turn: Annotated[float, Quantity("counts", 4.0, 1e6)] = 2000.0
    """counts; per turn of the encoder's shaft"""
    gear_ratio: Annotated[float, Quantity("-", 0.01, 1000.0)] = 1.0
    """-; turns of the encoder per turn of the wing about its hinge"""
    zero_left: Annotated[float, Quantity("counts", -1e6, 1e6)] = 0.0
    """counts; left wing level"""
    zero_right: Annotated[float, Quantity("counts", -1e6, 1e6)] = 0.0
    """counts; right wing level"""
    sign_left: Annotated[float, Quantity("-", -1.0, 1.0)] = 1.0
    """-; 1 when the counts rise with the left wing, -1 when they fall"""
    sign_right: Annotated[float, Quantity("-", -1.0, 1.0)] = 1.0
    """-; 1 when the counts rise with the right wing, -1 when they fall"""
    rate_time: Annotated[float, Quantity("s", 0.0, 0.1)] = 0.003
    """s; time constant of the flap rate's low-pass"""
    least_amplitude: Annotated[float, Quantity("rad", 0.01, 1.0)] = 0.05
    """rad; half a stroke's height under which the wing does not flap"""
    hysteresis: Annotated[float, Quantity("-", 0.01, 0.9)] = 0.25
    """-; share of the amplitude by which a crossing must be passed to count"""
    slowest: Annotated[float, Quantity("Hz", 0.1, 5.0)] = 0.8
    """Hz; flapping slower than this is none"""
    fastest: Annotated[float, Quantity("Hz", 5.0, 50.0)] = 20.0
    """Hz; flapping faster than this is none"""


class Stroke(NamedTuple):
    """The last full stroke."""

    period: float = 0.0
    """s; 0 while the wing does not flap"""
    amplitude_left: float = 0.0
    """rad"""
    amplitude_right: float = 0.0
    """rad"""
    mean_angle: float = 0.0
    """rad; middle between the extremes, mean of both wings"""
    downstroke_ratio: float = 0.0
    """-; share of the period from the top to the bottom"""


class Extremes(NamedTuple):
    """Extreme angles since the present stroke began."""

    left_high: float = 0.0
    """rad"""
    left_low: float = 0.0
    """rad"""
    right_high: float = 0.0
    """rad"""
    right_low: float = 0.0
    """rad"""
    high: float = 0.0
    """rad; of the mean of both wings"""
    low: float = 0.0
    """rad; of the mean of both wings"""
    high_us: float = 0.0
    """us; when the mean was highest"""
    low_us: float = 0.0
    """us; when the mean was lowest"""


class State(NamedTuple):
    """What the measurement remembers."""

    time_us: int = -1
    """us; of the last sample, -1 before the first"""
    left: float = 0.0
    """rad; last angle"""
    right: float = 0.0
    """rad; last angle"""
    before_us: int = -1
    """us; of the sample before the last"""
    left_before: float = 0.0
    """rad; angle before the last"""
    right_before: float = 0.0
    """rad; angle before the last"""
    rate_left: float = 0.0
    """rad/s"""
    rate_right: float = 0.0
    """rad/s"""
    side: int = 0
    """-; 1 above the middle, -1 below it, 0 not known, -2 below it and not yet above it since the search began"""
    rise_us: float = -1.0
    """us; last upward passage of the middle, not yet confirmed; -1 for none"""
    begun_us: float = 0.0
    """us; when the present stroke, or the search for one, began"""
    crossed: int = 0
    """-; 1 when the stroke began with an upward crossing"""
    extremes: Extremes = Extremes()
    """since then"""
    stroke: Stroke = Stroke()
    """the one before"""
    strokes: int = 0
    """-; full ones since boot"""


def step(gains: Gains, state: State, sample: EncoderSample) -> tuple[State, WingState]:
    """One encoder sample on; a sample that is not later than the last changes nothing."""
    per_count = TWO_PI / (gains.counts_per_turn * gains.gear_ratio)
    left = (sample.left_counts - gains.zero_left) * gains.sign_left * per_count
    right = (sample.right_counts - gains.zero_right) * gains.sign_right * per_count
    time_us = sample.time_us
    if state.time_us < 0:
        state = _searching(State(time_us, left, right, time_us, left, right))
        return state, _message(state)
    if time_us <= state.time_us:
        return state, _message(state)
    rate_left, rate_right = _rates(gains, state, time_us, left, right)
    extremes = _widened(state, left, right)
    side, rise_us, crossed_up = _crossing(gains, state, extremes, time_us, 0.5 * (left + right))
    state = State(
        time_us, left, right, state.time_us, state.left, state.right, rate_left, rate_right,
        side, rise_us, state.begun_us, state.crossed, extremes, state.stroke, state.strokes,
    )  # fmt: skip
    if crossed_up:
        state = _next_stroke(gains, state)
    elif (time_us - state.begun_us) * 1e-6 > PATIENCE * (state.stroke.period or 1.0 / gains.slowest):
        state = _searching(state)
    return state, _message(state)


def _rates(gains: Gains, state: State, time_us: int, left: float, right: float) -> tuple[float, float]:
    """Flap rates: differences over two intervals, which halves the encoder's steps, low-passed."""
    span = (time_us - state.before_us) * 1e-6
    dt = (time_us - state.time_us) * 1e-6
    share = dt / (dt + gains.rate_time)
    return (
        state.rate_left + share * ((left - state.left_before) / span - state.rate_left),
        state.rate_right + share * ((right - state.right_before) / span - state.rate_right),
    )


def _widened(state: State, left: float, right: float) -> Extremes:
    """The extremes with those of the last sample, if it was one; its neighbours make it a parabola."""
    extremes = state.extremes
    l1, r1 = state.left, state.right
    if (l1 - state.left_before) * (left - l1) <= 0.0:
        value, _ = _vertex(state.left_before, l1, left)
        extremes = extremes._replace(left_high=max(extremes.left_high, value), left_low=min(extremes.left_low, value))
    if (r1 - state.right_before) * (right - r1) <= 0.0:
        value, _ = _vertex(state.right_before, r1, right)
        extremes = extremes._replace(
            right_high=max(extremes.right_high, value), right_low=min(extremes.right_low, value)
        )
    m0, m1, m2 = 0.5 * (state.left_before + state.right_before), 0.5 * (l1 + r1), 0.5 * (left + right)
    if (m1 - m0) * (m2 - m1) <= 0.0:
        value, offset = _vertex(m0, m1, m2)
        when = state.time_us + offset * (state.time_us - state.before_us)
        if value > extremes.high:
            extremes = extremes._replace(high=value, high_us=when)
        if value < extremes.low:
            extremes = extremes._replace(low=value, low_us=when)
    return extremes


def _vertex(before: float, here: float, after: float) -> tuple[float, float]:
    """Value of the parabola through three samples at its vertex, and how many samples that lies after the second."""
    bend = before - 2.0 * here + after
    if bend == 0.0:
        return here, 0.0
    offset = 0.5 * (before - after) / bend
    return here - 0.25 * (before - after) * offset, offset


def _crossing(gains: Gains, state: State, extremes: Extremes, time_us: int, mean: float) -> tuple[int, float, bool]:
    """Side of the stroke's middle, time of the last passage up, and whether that is confirmed now."""
    high, low = extremes.high, extremes.low
    if state.stroke.period > 0.0:
        middle = state.stroke.mean_angle
        half = 0.5 * (state.stroke.amplitude_left + state.stroke.amplitude_right)
    else:
        high, low = max(high, mean), min(low, mean)
        middle, half = 0.5 * (high + low), 0.5 * (high - low)
        if half < gains.least_amplitude:
            return 0, -1.0, False
    margin = gains.hysteresis * half
    last = 0.5 * (state.left + state.right)
    side, rise_us = state.side, state.rise_us
    if side <= 0 and last < middle <= mean:
        rise_us = state.time_us + (time_us - state.time_us) * (middle - last) / (mean - last)
    if side <= 0 and mean > middle + margin:
        return 1, rise_us, side == -1 and rise_us >= 0.0
    if side >= 0 and mean < middle - margin:
        # A search that begins on the way down does not know the top yet, and with it not the middle.
        return (-1 if side > 0 else -2), -1.0, False
    return side, rise_us, False


def _next_stroke(gains: Gains, state: State) -> State:
    """An upward crossing was confirmed: the stroke that it ends, if it is one, and the beginning of the next."""
    period = (state.rise_us - state.begun_us) * 1e-6
    if state.crossed and period < 1.0 / gains.fastest:
        return state
    e = state.extremes
    amplitude = 0.5 * (e.high - e.low)
    stroke, strokes = Stroke(), state.strokes
    if state.crossed and period <= 1.0 / gains.slowest and amplitude >= gains.least_amplitude:
        share = (e.low_us - e.high_us) * 1e-6 / period
        stroke = Stroke(
            period,
            0.5 * (e.left_high - e.left_low),
            0.5 * (e.right_high - e.right_low),
            0.5 * (e.high + e.low),
            max(0.0, min(1.0, share)),
        )
        strokes += 1
    return _from_here(state)._replace(begun_us=state.rise_us, crossed=1, stroke=stroke, strokes=strokes)


def _searching(state: State) -> State:
    """No stroke is known: look for one from the present angles on."""
    return _from_here(state)._replace(side=0, rise_us=-1.0, begun_us=float(state.time_us), crossed=0, stroke=Stroke())


def _from_here(state: State) -> State:
    """The state with extremes at the present angles."""
    left, right, time_us = state.left, state.right, float(state.time_us)
    mean = 0.5 * (left + right)
    return state._replace(extremes=Extremes(left, left, right, right, mean, mean, time_us, time_us))


def _message(state: State) -> WingState:
    stroke = state.stroke
    flapping = stroke.period > 0.0
    turns = (state.time_us - state.begun_us) * 1e-6 / stroke.period if flapping else 0.0
    return WingState(
        state.time_us,
        state.left,
        state.right,
        state.rate_left,
        state.rate_right,
        TWO_PI * (turns % 1.0),
        1.0 / stroke.period if flapping else 0.0,
        stroke.amplitude_left,
        stroke.amplitude_right,
        stroke.mean_angle,
        stroke.downstroke_ratio,
        state.strokes,
        int(flapping),
    )
