"""Identification inputs inside a flight envelope.

The shapes are doublets, 3-2-1-1 multisteps, frequency sweeps and multisines. A maneuver consists of settling, input
and settling, with the loops frozen at their trim or active. Between repeats the loops are active for a recovery time.
The start times are distributed over the wing stroke by the golden ratio, so that the response to the input is not
correlated with the flapping.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Annotated, Final, NamedTuple

from avionics.guidance import multisine
from avionics.guidance.mission import Channel, Excitation, Shape
from avionics.messages import ExcitationStatus
from wingbeat.records import constructor
from wingbeat.units import Quantity

GOLDEN_RATIO: Final = 0.6180339887498949
RESOLUTION: Final = 1e-6
"""s; resolution of the timestamps; tolerance for rounding of summed time steps at an edge"""
SEGMENTS: Final[dict[Shape, tuple[tuple[int, float], ...]]] = {
    Shape.DOUBLET: ((1, 1.0), (1, -1.0)),
    Shape.MULTISTEP_3211: ((3, 1.0), (2, -1.0), (1, 1.0), (1, -1.0)),
}
"""(length in widths, sign) of each step of a shape"""
FOLDED: Final = 0.2
"""-; tolerance, in strokes, within which a period counts as a whole number of strokes"""
SWEEPS = (Shape.LINEAR_SWEEP, Shape.LOGARITHMIC_SWEEP)
Inputs = tuple[float, float, float]
"""elevator (rad), throttle (-), rudder (rad)"""
NOTHING: Inputs = (0.0, 0.0, 0.0)


class Gains(NamedTuple):
    """Envelope and timing of the identification inputs."""

    recovery: Annotated[float, Quantity("s", 0.0, 60.0)]
    """s; recovery time with active loops before each maneuver"""
    spread: Annotated[float, Quantity("s", 0.0, 5.0)] = 0.25
    """s; maximum start delay; the fraction differs for each maneuver. Default: one stroke at 4 Hz"""
    fade: Annotated[float, Quantity("s", 0.0, 30.0)] = 1.0
    """s; fade-in and fade-out time of a sweep, limited to half its duration. Default: a sweep begins and ends within
    one to four strokes, without a step"""
    pitch_max: Annotated[float, Quantity("rad", 0.02, 1.5)] = 0.5
    """rad; change of pitch since the start above which the maneuver aborts. Default: below the stall"""
    roll_max: Annotated[float, Quantity("rad", 0.05, 1.5)] = 0.8
    """rad; bank above which the maneuver aborts. Default: below the onset of a spiral"""
    airspeed_min: Annotated[float, Quantity("m/s", 0.0, 20.0)] = 4.0
    """m/s; airspeed below which the maneuver aborts. Default: above the stall"""
    airspeed_max: Annotated[float, Quantity("m/s", 1.0, 40.0)] = 13.0
    """m/s; airspeed above which the maneuver aborts. Default: well above the cruise"""
    altitude_max: Annotated[float, Quantity("m", 0.5, 100.0)] = 8.0
    """m; change of altitude since the start above which the maneuver aborts. Default: a fifth of the flight altitude
    """
    altitude_floor: Annotated[float, Quantity("m", 0.0, 500.0)] = 12.0
    """m; altitude below which no maneuver starts or continues. Default: margin for a recovery"""


class Phase(IntEnum):
    """Phase of a maneuver."""

    IDLE = 0
    RECOVER = 1
    SETTLE = 2
    INPUT = 3
    AFTER = 4


IDLE, SETTLE = Phase.IDLE, Phase.SETTLE
"""Cached members: access to an enum member costs as much as a call."""


class State(NamedTuple):
    """State of the excitation."""

    phase: int = Phase.IDLE
    """-; see `Phase`"""
    elapsed: float = 0.0
    """s; time since the phase began"""
    repeats_left: int = 0
    """-; remaining maneuvers"""
    manoeuvre: int = 0
    """-; number of maneuvers since boot"""
    pitch: float = 0.0
    """rad; pitch at the start"""
    altitude: float = 0.0
    """m; altitude at the start"""
    aborted: int = 0
    """-; 1 if the last maneuver was aborted"""
    finished: int = 0
    """-; number of excitations finished or aborted since boot"""
    requested_input: Excitation | None = None
    """-; active input; None while idle"""
    lines: tuple[multisine.Lines, ...] = ()
    """rad/s, rad, rad or -; sine components of a multisine on elevator, throttle and rudder"""


class EnvelopeState(NamedTuple):
    """Quantities monitored by the envelope."""

    pitch: float
    """rad; stroke-filtered pitch"""
    roll: float
    """rad"""
    airspeed: float
    """m/s"""
    altitude: float
    """m"""


def duration(excitation: Excitation) -> float:
    """Return the duration (s) of the input without settling times."""
    segments = SEGMENTS.get(excitation.shape)
    return excitation.width * (sum(length for length, _ in segments) if segments else 1.0)


def steps(shape: Shape, width: float, elapsed: float) -> float:
    """Return a unit doublet or multistep at ``elapsed`` s: -1, 0 or 1."""
    edge = 0.0
    for length, sign in SEGMENTS[shape]:
        edge += length * width
        if 0.0 <= elapsed < edge - RESOLUTION:
            return sign
    return 0.0


def sweep(excitation: Excitation, fade: float, elapsed: float) -> float:
    """Return a sweep of unit amplitude ``elapsed`` s after its start.

    ``fade`` (s) is the rise and fall time of its envelope.
    """
    low, high, length = excitation.low, excitation.high, excitation.width
    share = elapsed / length
    if not 0.0 <= share <= 1.0:
        return 0.0
    if excitation.shape == Shape.LOGARITHMIC_SWEEP and low != high:
        rate = math.log(high / low)
        turns = low * length * math.expm1(rate * share) / rate
    else:
        turns = length * share * (low + 0.5 * (high - low) * share)
    return _envelope(min(fade, 0.5 * length), elapsed, length - elapsed) * math.sin(math.tau * turns)


def _envelope(fade: float, since: float, left: float) -> float:
    """Return a raised cosine from 0 to 1 over ``fade`` s at both ends."""
    near = min(since, left)
    return 1.0 if near >= fade else 0.5 - 0.5 * math.cos(math.pi * near / fade)


def spectrum(excitation: Excitation) -> tuple[multisine.Lines, ...]:
    """Return the sine components of a multisine on each channel.

    The result is empty for other shapes. The first call for an input takes about 12 ms for each channel; later calls
    use a cache. The code that loads or receives an input calls this function (`avionics.missions.check_mission`), so
    that no tick is delayed.
    """
    if excitation.shape != Shape.MULTISINE:
        return ()
    amplitudes = excitation.amplitudes()
    used = [channel for channel in Channel if amplitudes[channel]]
    first, last = harmonics(excitation)
    dealt = multisine.channel_harmonics(first, last, len(used))
    return tuple(
        multisine.design(dealt[used.index(channel)], excitation.width, amplitudes[channel]) if channel in used else ()
        for channel in Channel
    )


def harmonics(excitation: Excitation) -> tuple[int, int]:
    """Return the lowest and the highest harmonic in the band of a multisine."""
    return (
        math.ceil(excitation.low * excitation.width - RESOLUTION),
        math.floor(excitation.high * excitation.width + RESOLUTION),
    )


def unfolding_period(excitation: Excitation, frequency: float) -> float:
    """Return a multisine period (s) without aliasing by the flapping, or 0.

    The result is 0 if the period needs no change. The wings modulate an input to the flapping ``frequency`` (Hz)
    minus the frequency of the input. If the flapping frequency is a multiple of the line spacing, the image of one
    line coincides with another line, and averages over strokes cannot separate them. A period longer by half a stroke
    places the images midway between the lines.
    """
    if excitation.shape != Shape.MULTISINE or frequency <= 0.0:
        return 0.0
    first, last = harmonics(excitation)
    turns = frequency * excitation.width
    apart = abs(turns - round(turns))
    if apart > FOLDED or not 2 * first <= round(turns) <= 2 * last:
        return 0.0
    return (round(turns) + 0.5) / frequency


def running(state: State) -> int:
    """Return 1 while a maneuver runs, including its settling times."""
    return int(state.phase >= SETTLE)


def recovering(state: State) -> bool:
    """Return whether the loops establish the trim for a maneuver with frozen loops."""
    return state.requested_input is not None and state.phase == Phase.RECOVER and not state.requested_input.loops


def frozen(state: State) -> int:
    """Return 1 while the altitude and pitch loops are frozen at their trim."""
    return int(state.requested_input is not None and state.phase >= SETTLE and not state.requested_input.loops)


def roll_frozen(state: State) -> int:
    """Return 1 while the roll loop is frozen at its trim.

    It is frozen during rudder inputs, because an active roll loop would oppose them.
    """
    return int(
        frozen(state)
        and state.requested_input is not None
        and state.requested_input.amplitudes()[Channel.RUDDER] != 0.0
    )


def start(state: State, excitation: Excitation) -> State:
    """Begin an excitation; an active one is replaced."""
    return state._replace(
        phase=int(Phase.RECOVER),
        elapsed=0.0,
        repeats_left=excitation.repeats,
        aborted=0,
        requested_input=excitation,
        lines=spectrum(excitation),
    )


def stop(state: State) -> State:
    """End the active excitation and count it as finished; the loops resume at once."""
    return state if state.phase == IDLE else _finish(state, aborted=0)


def _finish(state: State, aborted: int) -> State:
    return state._replace(
        phase=int(Phase.IDLE),
        elapsed=0.0,
        repeats_left=0,
        aborted=aborted,
        finished=state.finished + 1,
        requested_input=None,
        lines=(),
    )


_new_excitation_status: Final = constructor(ExcitationStatus)


def step(
    gains: Gains, state: State, time_us: int, dt: float, requested: bool, envelope: EnvelopeState
) -> tuple[State, ExcitationStatus]:
    """Advance by one step of ``dt`` (s).

    An active excitation ends at once if it is no longer ``requested``.
    """
    if state.requested_input is None or not requested:
        state = stop(state)
        return state, _new_excitation_status(time_us, 0, state.manoeuvre, 0.0, 0.0, 0.0, state.aborted)
    state = _advance(gains, state._replace(elapsed=state.elapsed + dt), state.requested_input, envelope)
    if outside(gains, state, envelope):
        state = _finish(state, aborted=1)
    elevator, throttle, rudder = inputs(gains, state)
    return state, ExcitationStatus(
        time_us, running(state), state.manoeuvre, elevator, throttle, rudder, state.aborted
    )


def inputs(gains: Gains, state: State) -> Inputs:
    """Return the present input increments to elevator, throttle and rudder."""
    requested_input, elapsed = state.requested_input, state.elapsed
    if state.phase != Phase.INPUT or requested_input is None:
        return NOTHING
    if requested_input.shape == Shape.MULTISINE:
        elevator, throttle, rudder = (multisine.value(lines, elapsed) for lines in state.lines)
        return elevator, throttle, rudder
    swept = requested_input.shape in SWEEPS
    unit = (
        sweep(requested_input, gains.fade, elapsed)
        if swept
        else steps(requested_input.shape, requested_input.width, elapsed)
    )
    elevator, throttle, rudder = requested_input.amplitudes()
    return elevator * unit, throttle * unit, rudder * unit


def outside(gains: Gains, state: State, envelope: EnvelopeState) -> bool:
    """Return whether a maneuver has left its envelope; a NaN counts as outside."""
    return running(state) == 1 and not (
        abs(envelope.pitch - state.pitch) <= gains.pitch_max
        and abs(envelope.roll) <= gains.roll_max
        and gains.airspeed_min <= envelope.airspeed <= gains.airspeed_max
        and abs(envelope.altitude - state.altitude) <= gains.altitude_max
        and envelope.altitude >= gains.altitude_floor
    )


def _advance(gains: Gains, state: State, excitation: Excitation, envelope: EnvelopeState) -> State:
    """Enter the next phase if the present one is complete."""
    length = _phase_length(gains, state, excitation)
    if state.elapsed < length - RESOLUTION:
        return state
    if state.phase == Phase.RECOVER:
        return state._replace(
            phase=int(Phase.SETTLE),
            elapsed=0.0,
            manoeuvre=state.manoeuvre + 1,
            pitch=envelope.pitch,
            altitude=envelope.altitude,
        )
    if state.phase in (Phase.SETTLE, Phase.INPUT):
        return state._replace(phase=state.phase + 1, elapsed=0.0)
    if state.repeats_left > 1:
        return state._replace(phase=int(Phase.RECOVER), elapsed=0.0, repeats_left=state.repeats_left - 1)
    return _finish(state, aborted=0)


def _phase_length(gains: Gains, state: State, excitation: Excitation) -> float:
    if state.phase == Phase.RECOVER:
        return gains.recovery
    if state.phase == Phase.INPUT:
        return duration(excitation)
    if state.phase == Phase.SETTLE:
        return excitation.settle + gains.spread * (state.manoeuvre * GOLDEN_RATIO % 1.0)
    return excitation.settle
