"""Finding the manoeuvres of a flight and taking the wing's motion out of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from logs.identification.data.flight import Aircraft, FlightData, JoinedFlight
from logs.identification.data.lag import behind
from logs.identification.data.maneuver_detection import manoeuvre_spans, was_aborted
from logs.identification.data.stroke_average import averaging_matrix, wing_period
from logs.identification.results import Array
from wingbeat.errors import InputError

OUTPUT_STEP = 0.02
"""s; between stroke averages: they hold nothing above the flapping frequency"""
LAG_STEP = 1e-4
"""s; half the difference of time constants that tells how the tail angle changes with them"""
LEAST_STROKES = 3.0
"""-; a window shorter than this says nothing of a mode slower than the flapping"""


class Manoeuvre(NamedTuple):
    """One input and the response to it, from half a stroke before the first average to half one after the last."""

    number: int
    """-; as the log counts"""
    time: Array
    """s; (N,), of the raw samples, from 0"""
    command: Array
    """rad; (N,), elevator command minus its value at the start"""
    tail: Array
    """rad; (N,), achieved tail angle minus its value at the start"""
    tail_rate: Array
    """rad/s; (N,)"""
    tail_slope: Array
    """rad/s; (N,), change of the tail angle with the tail's time constant"""
    strokes: Array
    """-; (N,), of the wings, on the flight's count: the phase is what is behind the point"""
    held: bool
    """-; the tail angle jumps at the samples (no lag) and is held between them"""
    raw: Array
    """rad/s, m/s^2, m/s^2, rad; (N, 4), pitch rate, specific forces x and z at the IMU, pitch"""
    at: Array
    """s; (M,), of the stroke averages"""
    averaging: csr_array
    """-; (M, N), takes raw samples to stroke averages"""
    averages: Array
    """as `raw`; (M, 4), averaged"""
    period: float
    """s; mean wing period"""
    airspeed: float
    """m/s; mean over the raw samples"""
    start: float
    """s; of the first raw sample, on the log's clock"""
    averaging_to_end: csr_array
    """-; (L, N), as ``averaging``, and on until the manoeuvre ends: the last averages reach half a stroke beyond"""
    flight: JoinedFlight | None = None
    """the one of several flights that it is from; None where there is but one"""

    @property
    def begin(self) -> float:
        """Of the first stroke average's first sample, s on the log's clock."""
        return self.start + float(self.at[0]) - self.period / 2

    @property
    def name(self) -> str:
        """Number and begin as its own log has them, and which log that is where there are several."""
        if self.flight is None:
            return f"manoeuvre {self.number} at {self.begin:.1f} s"
        begin = self.flight.own_time(self.begin)
        return f"manoeuvre {self.flight.own(self.number)} at {begin:.1f} s of {self.flight.name}"


class Reference(NamedTuple):
    """The steady flight about which the model is linear: the mean over the manoeuvres."""

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
    """Achieved tail angle at the samples (N,) from the held ``command`` (N,), after delay and first-order lag."""
    return behind(
        command, float(time[1] - time[0]), aircraft.tail_delay, aircraft.tail_time_constant or 0.0, held=True
    )


def _tail_slope(time: Array, command: Array, aircraft: Aircraft) -> Array:
    """Change of the tail angle (rad/s; (N,)) with its time constant.

    From none at all to a lag that a sampling interval does not show is a jump: from none it is taken to one interval.
    """
    constant = aircraft.tail_time_constant or 0.0
    low, high = constant - LAG_STEP, constant + LAG_STEP
    if low <= 0.0:
        low, high = 0.0, max(constant, float(time[1] - time[0]))
    ends = [tail_angle(time, command, aircraft._replace(tail_time_constant=c)) for c in (low, high)]
    slope: Array = (ends[1] - ends[0]) / (high - low)
    return slope


def find_manoeuvres(data: FlightData, aircraft: Aircraft) -> tuple[Manoeuvre, ...]:
    """Every complete elevator manoeuvre; one that repeats its input is cut before each repeat.

    Raises:
        InputError: none is usable.
    """
    tail = tail_angle(data.time, data.elevator, aircraft)
    found = [_cut(data, tail, aircraft, piece) for piece in _all_pieces(data)]
    usable = tuple(manoeuvre for manoeuvre in found if manoeuvre is not None)
    if not usable:
        raise InputError("the log has no complete elevator manoeuvre flown with flapping wings")
    return usable


def dropped_manoeuvres(data: FlightData, manoeuvres: tuple[Manoeuvre, ...]) -> tuple[str, ...]:
    """Why manoeuvres that the log has are not among the usable ``manoeuvres``, one clause each."""
    used, told = {m.number for m in manoeuvres}, []
    for number in np.unique(data.manoeuvre[data.active > 0]):
        if int(number) not in used:
            aborted = was_aborted(data.manoeuvre, data.aborted, number)
            why = "ended by an envelope limit" if aborted else "too short, or flown without flapping"
            first = float(data.time[np.argmax(data.manoeuvre == number)])
            flight = data.flight_at(first)
            which = f"{int(number)}" if flight is None else f"{flight.own(int(number))} of {flight.name}"
            told.append(f"manoeuvre {which} left out: {why}")
    return tuple(told)


class _Piece(NamedTuple):
    """One input and the response to it, in samples of the flight."""

    first: int
    last: int
    """behind the piece: where the next input is due, or the manoeuvre ends"""
    end: int
    """behind the manoeuvre: from here on the loops fly again, and move more than the elevator"""


def _all_pieces(data: FlightData) -> list[_Piece]:
    whole = manoeuvre_spans(data.active, data.manoeuvre, data.aborted)
    return [piece for span in whole for piece in _pieces(data, span.start, span.stop)]


def _pieces(data: FlightData, first: int, last: int) -> list[_Piece]:
    """A manoeuvre cut one wing period before each repeat of its input; steps closer than that are one input."""
    busy = np.flatnonzero(np.abs(data.excitation[first:last]) > 1e-9) + first
    if not len(busy):
        return []
    step = data.time[1] - data.time[0]
    lead = round(_mean_period(data, first, last) / step) if last - first > 1 else 0
    onsets = busy[np.concatenate(([True], np.diff(busy) > 3 * lead))]
    starts = [first, *(int(onset) - lead for onset in onsets[1:])]
    return [_Piece(*span, last) for span in zip(starts, [*starts[1:], last], strict=True)]


def _mean_period(data: FlightData, first: int, last: int) -> float:
    strokes = data.strokes[last - 1] - data.strokes[first]
    return float((data.time[last - 1] - data.time[first]) / max(strokes, 1.0))


def _cut(data: FlightData, tail: Array, aircraft: Aircraft, piece: _Piece) -> Manoeuvre | None:
    """The ``piece`` with half a stroke before it where the record has it; None where it is too short.

    Its averages hold nothing from behind the manoeuvre's end.
    """
    first, last, end = piece
    if data.strokes[last - 1] - data.strokes[first] < LEAST_STROKES:
        return None
    at = np.arange(data.time[first], data.time[last - 1], OUTPUT_STEP)
    period = wing_period(data.time, data.strokes, at)
    inside = np.isfinite(period)
    at, period = at[inside], period[inside]
    within = int(np.sum(at + period / 2 <= data.time[end - 1]))
    if not within:
        return None
    # Where the wings slow down, an average further in may begin before the first one, or end behind the last.
    step = data.time[1] - data.time[0]
    begin = min(at[0] - period[0], np.min(at - period / 2) - step)
    until = max(at[-1] + period[-1], np.max(at + period / 2) + step)
    reach = slice(
        int(np.searchsorted(data.time, begin, side="left")), int(np.searchsorted(data.time, until, side="right"))
    )
    time = data.time[reach]
    raw = np.column_stack([c[reach] for c in (data.pitch_rate, data.accel_x, data.accel_z, data.pitch)])
    zero, held = time[0], not aircraft.tail_time_constant
    to_end = averaging_matrix(time, period, at)
    averaging = to_end[:within]
    rate = np.gradient(tail, step)
    slope = _tail_slope(data.time, data.elevator, aircraft)
    number = int(data.manoeuvre[first])
    return Manoeuvre(
        number, time - zero, data.elevator[reach] - tail[first], tail[reach] - tail[first], rate[reach], slope[reach],
        data.strokes[reach], held, raw, at[:within] - zero, averaging, averaging @ raw, float(np.mean(period)),
        float(np.mean(data.airspeed[reach])), float(zero), to_end, data.flight_at(float(data.time[first])),
    )  # fmt: skip


def lagged(manoeuvre: Manoeuvre, aircraft: Aircraft) -> Manoeuvre:
    """The manoeuvre with the tail angle that another lag or delay makes of its command."""
    tail = tail_angle(manoeuvre.time, manoeuvre.command, aircraft)
    rate = np.gradient(tail, manoeuvre.time[1] - manoeuvre.time[0])
    slope = _tail_slope(manoeuvre.time, manoeuvre.command, aircraft)
    return manoeuvre._replace(tail=tail, tail_rate=rate, tail_slope=slope, held=not aircraft.tail_time_constant)


def reference_of(data: FlightData, manoeuvres: tuple[Manoeuvre, ...]) -> Reference:
    """Mean flight condition over the manoeuvres; the angle of attack from pitch and flight-path angle."""
    during = np.isin(data.manoeuvre, [m.number for m in manoeuvres]) & (data.active > 0)
    airspeed, pitch = float(np.mean(data.airspeed[during])), float(np.mean(data.pitch[during]))
    if airspeed < 1.0:
        raise InputError(f"mean airspeed in the manoeuvres is {airspeed:.2f} m/s: no forward flight to identify")
    climb = float(np.mean(data.climb_rate[during]))
    angle = pitch - float(np.arcsin(np.clip(climb / airspeed, -1, 1)))
    elevator = float(np.mean(data.elevator[during]))
    return Reference(airspeed * float(np.cos(angle)), airspeed * float(np.sin(angle)), pitch, airspeed, elevator)
