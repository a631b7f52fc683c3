"""Identification inputs: doublets and 3-2-1-1 multisteps, flown inside an envelope.

A manoeuvre is: settle, input, settle, with the altitude and pitch loops frozen at their trim. Between
repeats the loops fly for a recovery time. The start is spread over the wing stroke by the golden ratio, so
that the response to the input does not line up with the flapping.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated, NamedTuple

from avionics.guidance.mission import Channel, Excitation, Shape
from avionics.messages import ExcitationStatus
from avionics.quantities import Quantity

GOLDEN_RATIO = 0.6180339887498949
RESOLUTION = 1e-6
"""s; of the time stamps, so that a sum of steps that misses an edge by rounding still meets it"""
SEGMENTS: dict[Shape, tuple[tuple[int, float], ...]] = {
    Shape.DOUBLET: ((1, 1.0), (1, -1.0)),
    Shape.MULTISTEP_3211: ((3, 1.0), (2, -1.0), (1, 1.0), (1, -1.0)),
}
"""(length in widths, sign) of each step of a shape"""


class Gains(NamedTuple):
    """Envelope and pacing of the identification inputs."""

    recovery: Annotated[float, Quantity("s", 0.0, 60.0)]
    """s; the loops fly before each manoeuvre"""
    spread: Annotated[float, Quantity("s", 0.0, 5.0)]
    """s; the start is delayed by up to this, a different share each time"""
    pitch_max: Annotated[float, Quantity("rad", 0.02, 1.5)]
    """rad; a greater change of pitch since the start aborts"""
    roll_max: Annotated[float, Quantity("rad", 0.05, 1.5)]
    """rad; a greater bank aborts"""
    airspeed_min: Annotated[float, Quantity("m/s", 0.0, 20.0)]
    """m/s; less airspeed aborts"""
    airspeed_max: Annotated[float, Quantity("m/s", 1.0, 40.0)]
    """m/s; more airspeed aborts"""
    altitude_max: Annotated[float, Quantity("m", 0.5, 100.0)]
    """m; a greater change of altitude since the start aborts"""
    altitude_floor: Annotated[float, Quantity("m", 0.0, 500.0)]
    """m; no manoeuvre starts or goes on below it"""


class Phase(IntEnum):
    """Where a manoeuvre is."""

    IDLE = 0
    RECOVER = 1
    SETTLE = 2
    INPUT = 3
    AFTER = 4


class State(NamedTuple):
    """What the excitation remembers."""

    phase: int = Phase.IDLE
    """-; see `Phase`"""
    elapsed: float = 0.0
    """s; since the phase began"""
    repeats_left: int = 0
    """-; manoeuvres still to fly"""
    manoeuvre: int = 0
    """-; manoeuvres since boot"""
    pitch: float = 0.0
    """rad; at the start"""
    altitude: float = 0.0
    """m; at the start"""
    aborted: int = 0
    """-; 1 when the last manoeuvre was aborted"""
    finished: int = 0
    """-; excitations finished or aborted since boot"""


class Flown(NamedTuple):
    """What the envelope looks at."""

    pitch: float
    """rad; stroke-filtered"""
    roll: float
    """rad"""
    airspeed: float
    """m/s"""
    altitude: float
    """m"""


def duration(shape: Shape, width: float) -> float:
    """Length of the input alone, in s."""
    return width * sum(length for length, _ in SEGMENTS[shape])


def value(shape: Shape, width: float, elapsed: float) -> float:
    """The input of unit amplitude ``elapsed`` s after its start: -1, 0 or 1."""
    edge = 0.0
    for length, sign in SEGMENTS[shape]:
        edge += length * width
        if 0.0 <= elapsed < edge - RESOLUTION:
            return sign
    return 0.0


def frozen(state: State) -> int:
    """1 while the altitude and pitch loops are to hold their trim."""
    return int(state.phase >= Phase.SETTLE)


def start(state: State, repeats: int) -> State:
    """Begin an excitation of ``repeats`` manoeuvres; one that runs is replaced."""
    return state._replace(phase=int(Phase.RECOVER), elapsed=0.0, repeats_left=repeats, aborted=0)


def stop(state: State) -> State:
    """End whatever runs, counted as finished; the loops fly again at once."""
    return state if state.phase == Phase.IDLE else _finish(state, aborted=0)


def _finish(state: State, aborted: int) -> State:
    return state._replace(
        phase=int(Phase.IDLE), elapsed=0.0, repeats_left=0, aborted=aborted, finished=state.finished + 1
    )


def step(
    gains: Gains, state: State, time_us: int, dt: float, excitation: Excitation | None, flown: Flown
) -> tuple[State, ExcitationStatus]:
    """One step; ``excitation`` is what `start` began, None when there is none."""
    if state.phase == Phase.IDLE or excitation is None:
        state = stop(state)
        return state, ExcitationStatus(time_us, 0, state.manoeuvre, 0.0, 0.0, 0.0, state.aborted)
    state = _advance(gains, state._replace(elapsed=state.elapsed + dt), excitation, flown)
    if outside(gains, state, flown):
        state = _finish(state, aborted=1)
    amplitude = 0.0
    if state.phase == Phase.INPUT:
        amplitude = excitation.amplitude * value(excitation.shape, excitation.width, state.elapsed)
    return state, _status(state, time_us, excitation.channel, amplitude)


def _status(state: State, time_us: int, channel: Channel, amplitude: float) -> ExcitationStatus:
    elevator, throttle, rudder = (amplitude if channel == which else 0.0 for which in Channel)
    return ExcitationStatus(time_us, frozen(state), state.manoeuvre, elevator, throttle, rudder, state.aborted)


def outside(gains: Gains, state: State, flown: Flown) -> bool:
    """Whether a frozen manoeuvre has left its envelope."""
    return frozen(state) == 1 and (
        abs(flown.pitch - state.pitch) > gains.pitch_max
        or abs(flown.roll) > gains.roll_max
        or not gains.airspeed_min <= flown.airspeed <= gains.airspeed_max
        or abs(flown.altitude - state.altitude) > gains.altitude_max
        or flown.altitude < gains.altitude_floor
    )


def _advance(gains: Gains, state: State, excitation: Excitation, flown: Flown) -> State:
    """Go to the next phase when the present one is over."""
    length = _phase_length(gains, state, excitation)
    if state.elapsed < length - RESOLUTION:
        return state
    if state.phase == Phase.RECOVER:
        return state._replace(
            phase=int(Phase.SETTLE),
            elapsed=0.0,
            manoeuvre=state.manoeuvre + 1,
            pitch=flown.pitch,
            altitude=flown.altitude,
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
        return duration(excitation.shape, excitation.width)
    if state.phase == Phase.SETTLE:
        return excitation.settle + gains.spread * (state.manoeuvre * GOLDEN_RATIO % 1.0)
    return excitation.settle
