"""Wing motion from encoder counts: angle, rate, phase, frequency and stroke shape.

A stroke extends from one crossing of the stroke middle to the next in the same direction, for the mean of both wings.
The middle is halfway between the last top and the last bottom, so that it follows a change of the mean angle.
Crossings are timed by interpolation between samples and confirmed by a hysteresis, so that neither the resolution of
the encoder (0.18 degree, E2-500, Gerdes et al. 2017 Table 1) nor jitter of a wing causes false strokes. Upward and
downward crossings both set phase and period, so that the phase is extrapolated for half a stroke only. If the wing
follows the commanded stroke, the phase follows that (`avionics.sensing.stroke_lock`). If the throttle of a motor
changes, the phase follows the speed of the drive (`avionics.sensing.drive_turns`).

A rejected encoder (`avionics.sensing.encoders`) is replaced by that of the other wing. Without both, phase and
frequency are those of the commanded stroke.
"""

from __future__ import annotations

from math import pi
from typing import Annotated, Final, NamedTuple

from avionics.messages import WingState
from avionics.sensing import drive_turns, stroke_lock
from avionics.sensing.encoders import Counts
from wingbeat.records import constructor
from wingbeat.units import Quantity

TWO_PI: Final = 2.0 * pi
TREND: Final = 1.0
"""-; fraction of the period change between crossings that is extrapolated over the next half stroke"""
DRIFT: Final = 0.05
"""-; maximum change of the period in half a stroke during a drift, relative to the period; a larger change is a jump
"""
STEADY_CROSSINGS: Final = 3
"""-; number of crossings before the first comparison of two periods"""
SILENT_PERIODS: Final = 1.5
"""-; periods without a crossing after which the wing counts as not flapping"""
SPLIT_SHARE: Final = 0.5
"""-; weight of the last stroke in the fraction of a stroke above the middle, which is nearly independent of the
frequency"""
STEADY: Final = 0.02
"""-; maximum relative change of the period while that fraction is measured"""


class Gains(NamedTuple):
    """Calibration of the encoders and thresholds of flapping."""

    counts_per_turn: Annotated[float, Quantity("counts", 4.0, 1e6)] = 2000.0
    """counts; per revolution of the encoder shaft"""
    gear_ratio: Annotated[float, Quantity("-", 0.01, 1000.0)] = 1.0
    """-; revolutions of the encoder per revolution of the wing about its hinge"""
    zero_left: Annotated[float, Quantity("counts", -1e6, 1e6)] = 0.0
    """counts; counter with the left wing level"""
    zero_right: Annotated[float, Quantity("counts", -1e6, 1e6)] = 0.0
    """counts; counter with the right wing level"""
    sign_left: Annotated[float, Quantity("-", -1.0, 1.0)] = 1.0
    """-; 1 if the counts rise with the left wing, -1 if they fall"""
    sign_right: Annotated[float, Quantity("-", -1.0, 1.0)] = 1.0
    """-; 1 if the counts rise with the right wing, -1 if they fall"""
    rate_time: Annotated[float, Quantity("s", 0.0, 0.1)] = 0.003
    """s; time constant of the low-pass filter of the flap rate"""
    least_amplitude: Annotated[float, Quantity("rad", 0.01, 1.0)] = 0.05
    """rad; minimum amplitude of flapping"""
    hysteresis: Annotated[float, Quantity("-", 0.01, 0.9)] = 0.25
    """-; fraction of the amplitude beyond the middle at which a crossing is confirmed"""
    slowest: Annotated[float, Quantity("Hz", 0.1, 5.0)] = 0.8
    """Hz; minimum frequency of flapping"""
    fastest: Annotated[float, Quantity("Hz", 5.0, 50.0)] = 20.0
    """Hz; maximum frequency of flapping"""
    drive_lag: Annotated[float, Quantity("s", 0.0, 2.0)] = 0.0
    """s; lag of the motor speed relative to the throttle; not used for wings that follow an angle"""


class Commanded(NamedTuple):
    """Commanded stroke, used if both encoders are rejected."""

    frequency: float = 0.0
    """Hz; 0 without a flapping command"""
    phase: float = 0.0
    """rad; from 0 to 2 pi"""
    amplitude: float = 0.0
    """rad; 0 if the crank of a motor determines the stroke, without a commanded phase"""


NOTHING: Final = Commanded()
"""No flapping command."""


class Stroke(NamedTuple):
    """Last full stroke."""

    period: float = 0.0
    """s; 0 without flapping"""
    amplitude_left: float = 0.0
    """rad"""
    amplitude_right: float = 0.0
    """rad"""
    mean_angle: float = 0.0
    """rad; middle between the extremes, mean of both wings"""
    downstroke_ratio: float = 0.0
    """-; fraction of the period from the top to the bottom, mean of both wings"""
    downstroke_ratio_left: float = 0.0
    """-; left wing"""
    downstroke_ratio_right: float = 0.0
    """-; right wing"""


class Turn(NamedTuple):
    """Last top and last bottom of one wing, or of the mean of both."""

    high: float = 0.0
    """rad"""
    high_us: float = 0.0
    """us"""
    low: float = 0.0
    """rad"""
    low_us: float = 0.0
    """us"""


class Beat(NamedTuple):
    """Last crossings and reference of the phase."""

    anchor_us: float = 0.0
    """us; time of the last crossing, or of the start of the search for one"""
    anchor: float = 0.0
    """-; phase at that time, in turns"""
    up_us: float = -1.0
    """us; time of the last upward crossing, -1 before the first"""
    down_us: float = -1.0
    """us; time of the last downward crossing, -1 before the first"""
    split: float = -1.0
    """-; low-passed fraction of a stroke above the middle, -1 if unknown"""
    crossings: int = 0
    """-; confirmed crossings since the search began; from the second on they are between a true top and a true bottom
    """
    pace: float = 0.0
    """s; period of the present stroke, extrapolated from the last two strokes"""


class State(NamedTuple):
    """State of the wing measurement."""

    time_us: int = -1
    """us; time of the last sample, -1 before the first"""
    left: float = 0.0
    """rad; last angle"""
    right: float = 0.0
    """rad; last angle"""
    before_us: int = -1
    """us; time of the sample before the last"""
    left_before: float = 0.0
    """rad; angle before the last"""
    right_before: float = 0.0
    """rad; angle before the last"""
    rate_left: float = 0.0
    """rad/s"""
    rate_right: float = 0.0
    """rad/s"""
    side: int = 0
    """-; 1 above the middle, -1 below it, 0 unknown"""
    crossed_us: float = -1.0
    """us; time of the last unconfirmed crossing of the middle; -1 if none"""
    mean_turn: Turn = Turn()
    """mean of both wings"""
    left_turn: Turn = Turn()
    right_turn: Turn = Turn()
    beat: Beat = Beat()
    stroke: Stroke = Stroke()
    """last full stroke"""
    strokes: int = 0
    """-; number of full strokes since boot"""
    valid: int = 3
    """-; valid encoders in the last sample: 1 for the left, 2 for the right"""
    missed: int = 0
    """counts; missed counts at the last sample"""
    lock: stroke_lock.State = stroke_lock.NOTHING
    """lag of the stroke relative to the command"""
    turns: drive_turns.State = drive_turns.NOTHING
    """crank revolutions from the throttle"""


def angles(gains: Gains, left_counts: float, right_counts: float) -> tuple[float, float]:
    """Return the flap angles (rad), left and right, of the counts."""
    per_count = TWO_PI / (gains.counts_per_turn * gains.gear_ratio)
    left = (left_counts - gains.zero_left) * gains.sign_left * per_count
    return left, (right_counts - gains.zero_right) * gains.sign_right * per_count


def step(gains: Gains, state: State, counts: Counts, commanded: Commanded = NOTHING) -> tuple[State, WingState]:
    """Process one sample; a sample that is not later than the last one is ignored.

    Args:
        gains: calibration of the encoders and thresholds of flapping.
        state: result of the last step, ``State()`` at boot.
        counts: result of `avionics.sensing.encoders.step`.
        commanded: commanded stroke.
    """
    time_us, left, right, valid_left, valid_right, missed = counts
    left, right = angles(gains, left, right)
    valid = valid_left + 2 * valid_right
    if valid == 1:
        right = left
    elif valid == 2:
        left = right
    if valid != state.valid or missed != state.missed or state.time_us < 0:
        state = _taken_over(state, time_us, left, right, valid)._replace(missed=missed)
    if valid == 0:
        return _unmeasured(gains, state, counts, commanded)
    if time_us > state.time_us:
        before, dt = state.beat, (time_us - state.time_us) * 1e-6
        state = _advance(gains, state, time_us, left, right)
        if state.beat.crossings != before.crossings:
            state = state._replace(lock=_locked(state, commanded))
        if commanded.amplitude <= 0.0:
            state = state._replace(turns=_turns(gains, state, before, commanded.frequency, dt))
    return state, _message(state, counts, commanded)


def _locked(state: State, commanded: Commanded) -> stroke_lock.State:
    """Return the lag relative to the command after a crossing or a new search."""
    beat, period = state.beat, state.stroke.period
    if beat.crossings < 2 or commanded.amplitude <= 0.0:
        return stroke_lock.NOTHING
    since = (state.time_us - beat.anchor_us) * 1e-6
    lag = commanded.phase / TWO_PI - commanded.frequency * since - beat.anchor
    return stroke_lock.crossed(state.lock, lag, commanded.frequency * period)


def _turns(gains: Gains, state: State, before: Beat, frequency: float, dt: float) -> drive_turns.State:
    """Update the crank revolutions from the throttle after a sample.

    The sample is ``dt`` (s) after the last one; ``before`` is the beat at the last one.
    """
    turns = drive_turns.step(state.turns, frequency, gains.drive_lag, dt)
    if state.beat.crossings == before.crossings:
        return turns
    rising = state.side > 0  # it is above now
    whole = (before.up_us if rising else before.down_us) >= 0.0
    return drive_turns.crossed(turns, (state.time_us - state.beat.anchor_us) * 1e-6, rising, whole)


_new_state: Final = constructor(State)


def _advance(gains: Gains, state: State, time_us: int, left: float, right: float) -> State:
    (last_us, left_1, right_1, before_us, left_0, right_0, rate_left, rate_right, side, crossed_us,
     mean_turn, left_turn, right_turn, beat, stroke, strokes, valid, missed, lock, turns) = state  # fmt: skip
    # Differences over two intervals halve the quantization error of the encoder.
    span = (time_us - before_us) * 1e-6
    dt = (time_us - last_us) * 1e-6
    share = dt / (dt + gains.rate_time)
    rate_left += share * ((left - left_0) / span - rate_left)
    rate_right += share * ((right - right_0) / span - rate_right)

    # The last sample is an extreme, unless all three are equal at rest.
    if (left_1 - left_0) * (left - left_1) <= 0.0 and (left != left_1 or left_1 != left_0):
        left_turn = _turned(left_turn, side, (left_0, left_1, left), last_us, dt)
    if (right_1 - right_0) * (right - right_1) <= 0.0 and (right != right_1 or right_1 != right_0):
        right_turn = _turned(right_turn, side, (right_0, right_1, right), last_us, dt)
    mean_0, mean_1, mean = 0.5 * (left_0 + right_0), 0.5 * (left_1 + right_1), 0.5 * (left + right)
    if (mean_1 - mean_0) * (mean - mean_1) <= 0.0 and (mean != mean_1 or mean_1 != mean_0):
        mean_turn = _turned(mean_turn, side, (mean_0, mean_1, mean), last_us, dt)

    high, low = mean_turn.high, mean_turn.low
    if side == 0:
        side = _first_side(gains, mean, max(high, mean), min(low, mean))
        confirmed = False
    else:
        middle, margin = 0.5 * (high + low), 0.5 * gains.hysteresis * (high - low)
        above, above_1 = (mean - middle) * side, (mean_1 - middle) * side
        if above <= 0.0 < above_1:
            crossed_us = last_us + (time_us - last_us) * above_1 / (above_1 - above)
        confirmed = above < -margin
    state = _new_state(
        time_us, left, right, last_us, left_1, right_1, rate_left, rate_right, side, crossed_us,
        mean_turn, left_turn, right_turn, beat, stroke, strokes, valid, missed, lock, turns,
    )  # fmt: skip
    if confirmed:
        return _cross(gains, state)
    if (time_us - beat.anchor_us) * 1e-6 > SILENT_PERIODS * (stroke.period or 1.0 / gains.slowest):
        return _searching(state)
    return state


def _turned(turn: Turn, side: int, angles: tuple[float, float, float], last_us: int, dt: float) -> Turn:
    """Update the top or bottom by a parabola through three ``angles``.

    The middle angle is an extreme.
    """
    before, here, after = angles
    bend = before - 2.0 * here + after
    if bend == 0.0:
        return turn
    offset = 0.5 * (before - after) / bend
    value, when = here - 0.25 * (before - after) * offset, last_us + offset * dt * 1e6
    if bend < 0.0:
        return turn._replace(high=value, high_us=when) if side >= 0 and value > turn.high else turn
    return turn._replace(low=value, low_us=when) if side <= 0 and value < turn.low else turn


def _first_side(gains: Gains, mean: float, high: float, low: float) -> int:
    """Return the side of a wing after the start of a motion, 0 if it moved too little."""
    half = 0.5 * (high - low)
    beyond = mean - 0.5 * (high + low)
    if half < gains.least_amplitude or abs(beyond) <= gains.hysteresis * half:
        return 0
    return 1 if beyond > 0.0 else -1


def _cross(gains: Gains, state: State) -> State:
    """Process a confirmed crossing: the completed stroke and the phase reference."""
    rising = state.side < 0
    at = state.crossed_us if state.crossed_us >= 0.0 else float(state.time_us)
    turn, beat = state.mean_turn, state.beat
    if 0.5 * (turn.high - turn.low) < gains.least_amplitude:
        return _searching(state)
    if beat.crossings == 0:
        return _reversed(state, Beat(at, crossings=1), Stroke(), 0)
    since = beat.up_us if rising else beat.down_us
    period = (at - since) * 1e-6 if since >= 0.0 else 0.0
    if 0.0 < period < 1.0 / gains.fastest:
        return _reversed(state, beat, state.stroke, 0)
    if period > 1.0 / gains.slowest:
        period = 0.0
    stroke = _stroke(state, period, rising) if period else state.stroke
    # Four crossings give two periods, each with half a count of error, here as a time at the middle of a sine.
    blur = 2.0 * TWO_PI / (gains.counts_per_turn * gains.gear_ratio) * period / (pi * (turn.high - turn.low))
    following = _next_beat(beat, at, period, state.stroke.period, rising, blur)
    return _reversed(state, following, stroke, int(rising and period > 0.0))


def _next_beat(beat: Beat, at: float, period: float, before: float, rising: bool, blur: float) -> Beat:
    """Return the beat after a crossing at ``at`` (us).

    The crossing ended a stroke of ``period`` (s; 0 if none). A difference between two periods within the encoder
    resolution (``blur``, s) does not count as a change of the period, which is then between them.
    """
    _, _, up_us, down_us, split, crossings, _ = beat
    pace = period
    if crossings > STEADY_CROSSINGS and abs(period - before) < DRIFT * before:
        change = period - before
        blurred = max(-blur, min(blur, change))
        pace += TREND * (change - blurred) - 0.5 * blurred
    if rising:
        above = (down_us - up_us) * 1e-6 / period if period and down_us > up_us >= 0.0 else -1.0
        if split < 0.0 <= above:
            split = above
        elif above >= 0.0 and abs(period - before) < STEADY * before:
            split += SPLIT_SHARE * (above - split)
        return Beat(at, 0.0, at, down_us, split, crossings + 1, pace)
    above = (at - up_us) * 1e-6 / period if period and up_us >= 0.0 else 0.5
    return Beat(at, split if split >= 0.0 else above, up_us, at, split, crossings + 1, pace)


def _stroke(state: State, period: float, rising: bool) -> Stroke:
    left, right, mean = state.left_turn, state.right_turn, state.mean_turn
    return Stroke(
        period,
        0.5 * (left.high - left.low),
        0.5 * (right.high - right.low),
        0.5 * (mean.high + mean.low),
        _downstroke_ratio(mean, period, rising),
        _downstroke_ratio(left, period, rising),
        _downstroke_ratio(right, period, rising),
    )


def _downstroke_ratio(turn: Turn, period: float, rising: bool) -> float:
    """Return the fraction of the period from the top to the bottom.

    The last extreme may be either of them.
    """
    share = (turn.low_us - turn.high_us) * 1e-6 / period
    return max(0.0, min(1.0, share if rising else 1.0 + share))


def _reversed(state: State, beat: Beat, stroke: Stroke, more: int) -> State:
    """Change the side of the middle and restart the search for its extremes."""
    mean, now = 0.5 * (state.left + state.right), float(state.time_us)
    if state.side < 0:
        mean_turn = state.mean_turn._replace(high=mean, high_us=now)
        left_turn = state.left_turn._replace(high=state.left, high_us=now)
        right_turn = state.right_turn._replace(high=state.right, high_us=now)
    else:
        mean_turn = state.mean_turn._replace(low=mean, low_us=now)
        left_turn = state.left_turn._replace(low=state.left, low_us=now)
        right_turn = state.right_turn._replace(low=state.right, low_us=now)
    return state._replace(
        side=-state.side,
        crossed_us=-1.0,
        mean_turn=mean_turn,
        left_turn=left_turn,
        right_turn=right_turn,
        beat=beat,
        stroke=stroke,
        strokes=state.strokes + more,
    )


def _searching(state: State) -> State:
    """Restart the search for a stroke from the present angles."""
    left, right, now = state.left, state.right, float(state.time_us)
    mean = 0.5 * (left + right)
    return state._replace(
        side=0,
        crossed_us=-1.0,
        mean_turn=Turn(mean, now, mean, now),
        left_turn=Turn(left, now, left, now),
        right_turn=Turn(right, now, right, now),
        beat=Beat(now),
        stroke=Stroke(),
    )


def _taken_over(state: State, time_us: int, left: float, right: float, valid: int) -> State:
    """Return the state after a first sample or a change of the encoder status.

    A wing with a newly failed encoder takes over the history of the other, so that the stroke continues. Invalid
    crossings do not contribute to a period. After a time without any encoder the search for a stroke restarts.
    """
    if state.time_us < 0 or state.valid == 0:
        at = max(time_us, state.time_us)
        began = State(at, left, right, at, left, right, strokes=state.strokes, valid=valid)
        return _searching(began)
    if valid == 1:
        state = state._replace(
            right=state.left, right_before=state.left_before, right_turn=state.left_turn, mean_turn=state.left_turn
        )
    elif valid == 2:
        state = state._replace(
            left=state.right, left_before=state.right_before, left_turn=state.right_turn, mean_turn=state.right_turn
        )
    beat = state.beat._replace(up_us=-1.0, down_us=-1.0)
    return state._replace(valid=valid, beat=beat, lock=stroke_lock.NOTHING)


def _unmeasured(gains: Gains, state: State, counts: Counts, commanded: Commanded) -> tuple[State, WingState]:
    """Report the commanded stroke while both encoders are rejected."""
    state = state._replace(time_us=max(state.time_us, counts.time_us), rate_left=0.0, rate_right=0.0, stroke=Stroke())
    asked = gains.slowest <= commanded.frequency <= gains.fastest
    message = _message(state, counts, commanded)
    if asked:
        message = message._replace(phase=commanded.phase, frequency=commanded.frequency, flapping=1)
    return state, message


_new_wing_state: Final = constructor(WingState)


def _message(state: State, counts: Counts, commanded: Commanded) -> WingState:
    time_us, left, right, _, _, _, rate_left, rate_right, _, _, _, _, _, beat, stroke, strokes, _, _, lock, turns = (
        state
    )
    _, _, _, valid_left, valid_right, missed = counts
    period, amplitude_left, amplitude_right, mean_angle, ratio, ratio_left, ratio_right = stroke
    if period > 0.0:
        frequency, flapping = 1.0 / (beat.pace or period), 1
        measured = beat.anchor + (time_us - beat.anchor_us) * 1e-6 * frequency
        if commanded.amplitude <= 0.0 and drive_turns.follows(turns, commanded.frequency):
            frequency = drive_turns.frequency(turns)
            measured = drive_turns.phase(turns)
        phase = TWO_PI * stroke_lock.phase(lock, commanded.phase / TWO_PI, measured)
        if stroke_lock.follows(lock):
            frequency = commanded.frequency
    else:
        phase, frequency, flapping = 0.0, 0.0, 0
    return _new_wing_state(
        time_us, left, right, rate_left, rate_right, phase, frequency, amplitude_left, amplitude_right, mean_angle,
        ratio, strokes, flapping, ratio_left, ratio_right, valid_left, valid_right, missed,
    )  # fmt: skip
