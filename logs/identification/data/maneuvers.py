"""Maneuvers of a flapping flight: found by the logged excitation, as records of stroke averages.

Outputs and inputs are averaged over exactly one measured wing period. For a linear time-invariant model averaging
commutes with the dynamics, so that the averages are an ordinary record of the same model.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.flight import Aircraft, FlightData, JoinedFlight
from logs.identification.data.lag import behind
from logs.identification.data.maneuver_detection import maneuver_spans, was_aborted
from logs.identification.data.stroke_average import averaging_matrix, wing_period
from logs.identification.results import Array
from wingbeat.errors import InputError

OUTPUT_STEP = 0.01
"""s; between stroke averages"""
MIN_STROKES = 3.0
"""-; of a window: a shorter one does not show a mode slower than the flapping"""
ELEVATOR = "delta_e"
UNITS = {
    ELEVATOR: "rad", "q": "rad/s", "a_x": "m/s^2", "a_z": "m/s^2", "theta": "rad", "q_dot": "rad/s^2",
    "airspeed": "m/s",
}  # fmt: skip
"""signals of a maneuver's experiment; the elevator is the change of its command from the start"""


class Maneuver(NamedTuple):
    """One input and the response to it."""

    number: int
    """-; as the log counts"""
    experiment: Experiment
    """stroke averages of `UNITS`, `OUTPUT_STEP` apart, until the control loops resume"""
    period: float
    """s; mean wing period"""
    airspeed: float
    """m/s; mean"""
    begin: float
    """s; of the first stroke average's first sample, on the log's clock"""
    command_time: Array
    """s; (N,), of the samples that are averaged, from the first"""
    command: Array
    """rad; (N,), elevator command minus its value at the start"""
    flight: JoinedFlight | None = None
    """the one of several flights that it is from; None for a single one"""

    @property
    def name(self) -> str:
        """Number, begin and log of the maneuver."""
        return self.experiment.name


class Reference(NamedTuple):
    """Flight condition about which the model is linear: the mean over the maneuvers."""

    u: float
    """m/s; airspeed along FRD x"""
    w: float
    """m/s; airspeed along FRD z"""
    pitch: float
    """rad"""
    airspeed: float
    """m/s"""
    elevator: float = 0.0
    """rad; commanded"""


def tail_angle(time: Array, command: Array, aircraft: Aircraft) -> Array:
    """Achieved tail angle (N,) after delay and lag, of a ``command`` (N,) under zero-order hold."""
    lag = aircraft.tail_time_constant or 0.0
    return behind(command, float(time[1] - time[0]), aircraft.tail_delay, lag, held=True)


def find_maneuvers(data: FlightData) -> tuple[Maneuver, ...]:
    """Every complete elevator maneuver; one that repeats its input is cut before each repeat.

    Raises:
        InputError: none is usable.
    """
    windows = [one for span in maneuver_spans(data.active, data.manoeuvre, data.aborted) for one in _cut(data, span)]
    found = tuple(one for one in (_averaged(data, window) for window in windows) if one is not None)
    if not found:
        raise InputError("the log has no complete elevator maneuver flown with flapping wings")
    return found


def dropped_maneuvers(data: FlightData, maneuvers: tuple[Maneuver, ...]) -> tuple[str, ...]:
    """Why maneuvers of the log are not among the usable ``maneuvers``, one clause each."""
    used, reasons = {m.number for m in maneuvers}, []
    for number in np.unique(data.manoeuvre[data.active > 0]):
        if int(number) not in used:
            aborted = was_aborted(data.manoeuvre, data.aborted, number)
            why = "ended by an envelope limit" if aborted else "too short, or flown without flapping"
            flight = data.flight_at(float(data.time[np.argmax(data.manoeuvre == number)]))
            which = f"{int(number)}" if flight is None else f"{flight.own(int(number))} of {flight.name}"
            reasons.append(f"maneuver {which} left out: {why}")
    return tuple(reasons)


def reference_of(data: FlightData, maneuvers: tuple[Maneuver, ...]) -> Reference:
    """Mean flight condition over the maneuvers; the angle of attack from pitch and flight-path angle.

    Raises:
        InputError: there is no forward flight.
    """
    during = np.isin(data.manoeuvre, [m.number for m in maneuvers]) & (data.active > 0)
    airspeed, pitch = float(np.mean(data.airspeed[during])), float(np.mean(data.pitch[during]))
    if airspeed < 1.0:
        raise InputError(f"mean airspeed in the maneuvers is {airspeed:.2f} m/s: no forward flight to identify")
    climb = float(np.mean(data.climb_rate[during]))
    angle = pitch - float(np.arcsin(np.clip(climb / airspeed, -1, 1)))
    elevator = float(np.mean(data.elevator[during]))
    return Reference(airspeed * float(np.cos(angle)), airspeed * float(np.sin(angle)), pitch, airspeed, elevator)


def _cut(data: FlightData, span: slice) -> list[slice]:
    """A maneuver cut one wing period before each repeat of its input; steps closer than that are one input."""
    busy = np.flatnonzero(np.abs(data.excitation[span]) > 1e-9) + span.start
    if not len(busy):
        return []
    step = data.time[1] - data.time[0]
    strokes = max(data.strokes[span.stop - 1] - data.strokes[span.start], 1.0)
    lead = round(float((data.time[span.stop - 1] - data.time[span.start]) / strokes) / step)
    onsets = busy[np.concatenate(([True], np.diff(busy) > 3 * lead))]
    starts = [span.start, *(int(onset) - lead for onset in onsets[1:])]
    return [slice(a, b) for a, b in zip(starts, [*starts[1:], span.stop], strict=True)]


def _averaged(data: FlightData, window: slice) -> Maneuver | None:
    """Stroke averages centered in the ``window`` that end with it; None if it has too few strokes."""
    first, last = window.start, window.stop
    if data.strokes[last - 1] - data.strokes[first] < MIN_STROKES:
        return None
    step = float(data.time[1] - data.time[0])
    at = np.arange(data.time[first], data.time[last - 1], OUTPUT_STEP)
    period = wing_period(data.time, data.strokes, at)
    inside = np.isfinite(period)
    at, period = at[inside], period[inside]
    within = at + period / 2 <= data.time[last - 1]
    at, period = at[within], period[within]
    if len(at) < 2:
        return None
    begin, until = np.min(at - period / 2) - 2 * step, np.max(at + period / 2) + 2 * step
    reach = slice(int(np.searchsorted(data.time, begin)), int(np.searchsorted(data.time, until, side="right")))
    time, command = data.time[reach], data.elevator[reach]
    columns = (data.pitch_rate, data.accel_x, data.accel_z, data.pitch, np.gradient(data.pitch_rate, step),
               data.airspeed)  # fmt: skip
    averages = averaging_matrix(time, period, at) @ np.column_stack([column[reach] for column in columns])
    # A command acts from its sample on: its mean over a step is the sample, half a step later.
    elevator = averaging_matrix(time + step / 2, period, at) @ (command - command[0])
    signals = dict(zip(UNITS, np.column_stack((elevator, averages)).T, strict=True))
    number, flight = int(data.manoeuvre[first]), data.flight_at(float(data.time[first]))
    start = float(at[0] - period[0] / 2)
    name = (
        f"maneuver {number} at {start:.1f} s"
        if flight is None
        else f"maneuver {flight.own(number)} at {flight.own_time(start):.1f} s of {flight.name}"
    )
    return Maneuver(
        number, Experiment(name, at, signals, UNITS), float(np.mean(period)), float(np.mean(data.airspeed[reach])),
        start, time - time[0], command - command[0], flight,
    )  # fmt: skip
