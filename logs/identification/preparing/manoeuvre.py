"""Finding the manoeuvres of a flight and taking the wing's motion out of them."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter
from scipy.sparse import csr_array

from avionics.quantities import BadInput
from logs.identification.data import Aircraft, FlightData
from logs.identification.preparing.stroke import averaging_matrix, wing_period
from logs.identification.results import Array

OUTPUT_STEP = 0.02
"""s; between stroke averages: they hold nothing above the flapping frequency"""
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
    held: bool
    """-; the tail angle jumps at the samples (no lag) and is held between them"""
    raw: Array
    """(N, 4); pitch rate rad/s, specific forces x and z at the IMU m/s^2, pitch rad"""
    at: Array
    """s; (M,), of the stroke averages"""
    averaging: csr_array
    """-; (M, N), takes raw samples to stroke averages"""
    averages: Array
    """(M, 4); `raw` averaged"""
    period: float
    """s; mean wing period"""
    airspeed: float
    """m/s; mean over the raw samples"""
    start: float = 0.0
    """s; of the first raw sample, on the log's clock"""


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
    step = time[1] - time[0]
    whole = int(aircraft.tail_delay / step)
    share = aircraft.tail_delay / step - whole
    ago = np.concatenate((np.full(whole + 1, command[0]), command))
    delayed: Array = (1 - share) * ago[1 : len(command) + 1] + share * ago[: len(command)]
    if not aircraft.tail_time_constant:
        return delayed
    pole = np.exp(-step / aircraft.tail_time_constant)
    achieved: Array = lfilter([0.0, 1 - pole], [1.0, -pole], delayed, zi=[command[0]])[0]
    return achieved


def _tail_slope(time: Array, command: Array, aircraft: Aircraft) -> Array:
    constant = aircraft.tail_time_constant or 0.0
    low, high = max(constant - 1e-4, 0.0), constant + 1e-4
    ends = [tail_angle(time, command, aircraft._replace(tail_time_constant=c)) for c in (low, high)]
    slope: Array = (ends[1] - ends[0]) / (high - low)
    return slope


def find_manoeuvres(data: FlightData, aircraft: Aircraft) -> tuple[Manoeuvre, ...]:
    """Every complete elevator manoeuvre; one that repeats its input is cut before each repeat.

    Raises:
        BadInput: none is usable.
    """
    tail = tail_angle(data.time, data.elevator, aircraft)
    found = [_cut(data, tail, aircraft, span) for span in _spans(data)]
    usable = tuple(manoeuvre for manoeuvre in found if manoeuvre is not None)
    if not usable:
        raise BadInput("the log has no complete elevator manoeuvre flown with flapping wings")
    return usable


def dropped_manoeuvres(data: FlightData, manoeuvres: tuple[Manoeuvre, ...]) -> tuple[str, ...]:
    """Why manoeuvres that the log has are not among the usable ``manoeuvres``, one clause each."""
    used, told = {m.number for m in manoeuvres}, []
    for number in np.unique(data.manoeuvre[data.active > 0]):
        if int(number) not in used:
            why = "ended by an envelope limit" if _aborted(data, number) else "too short, or flown without flapping"
            told.append(f"manoeuvre {int(number)} left out: {why}")
    return tuple(told)


def _spans(data: FlightData) -> list[tuple[int, int]]:
    """First and last sample of each piece with one input in it."""
    active = (data.active > 0) & (data.aborted == 0)
    label = np.where(active, data.manoeuvre + 1, 0)
    edges = np.flatnonzero(np.diff(label)) + 1
    bounds = np.concatenate(([0], edges, [len(label)]))
    spans: list[tuple[int, int]] = []
    for first, last in pairwise(bounds):
        if label[first] and not _aborted(data, label[first] - 1):
            spans += _pieces(data, int(first), int(last))
    return spans


def _aborted(data: FlightData, number: float) -> bool:
    return bool(np.any(data.aborted[data.manoeuvre == number]))


def _pieces(data: FlightData, first: int, last: int) -> list[tuple[int, int]]:
    """A manoeuvre cut one wing period before each repeat of its input; steps closer than that are one input."""
    busy = np.flatnonzero(np.abs(data.excitation[first:last]) > 1e-9) + first
    if not len(busy):
        return []
    step = data.time[1] - data.time[0]
    lead = round(_mean_period(data, first, last) / step) if last - first > 1 else 0
    onsets = busy[np.concatenate(([True], np.diff(busy) > 3 * lead))]
    starts = [first, *(int(onset) - lead for onset in onsets[1:])]
    return list(zip(starts, [*starts[1:], last], strict=True))


def _mean_period(data: FlightData, first: int, last: int) -> float:
    strokes = data.strokes[last - 1] - data.strokes[first]
    return float((data.time[last - 1] - data.time[first]) / max(strokes, 1.0))


def _cut(data: FlightData, tail: Array, aircraft: Aircraft, span: tuple[int, int]) -> Manoeuvre | None:
    """The piece ``span``, half a stroke longer on both sides where the record is; None where it is too short."""
    first, last = span
    if data.strokes[last - 1] - data.strokes[first] < LEAST_STROKES:
        return None
    at = np.arange(data.time[first], data.time[last - 1], OUTPUT_STEP)
    period = wing_period(data.time, data.strokes, at)
    inside = np.isfinite(period)
    at, period = at[inside], period[inside]
    reach = slice(
        int(np.searchsorted(data.time, at[0] - period[0], side="left")),
        int(np.searchsorted(data.time, at[-1] + period[-1], side="right")),
    )
    time = data.time[reach]
    raw = np.column_stack([c[reach] for c in (data.pitch_rate, data.accel_x, data.accel_z, data.pitch)])
    zero, held = time[0], not aircraft.tail_time_constant
    averaging = averaging_matrix(time, period, at)
    rate = np.gradient(tail, data.time[1] - data.time[0])
    slope = _tail_slope(data.time, data.elevator, aircraft)
    number = int(data.manoeuvre[first])
    return Manoeuvre(
        number, time - zero, data.elevator[reach] - tail[first], tail[reach] - tail[first], rate[reach], slope[reach],
        held, raw, at - zero, averaging, averaging @ raw, float(np.mean(period)),
        float(np.mean(data.airspeed[reach])), float(zero),
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
        raise BadInput(f"mean airspeed in the manoeuvres is {airspeed:.2f} m/s: no forward flight to identify")
    climb = float(np.mean(data.climb_rate[during]))
    angle = pitch - float(np.arcsin(np.clip(climb / airspeed, -1, 1)))
    elevator = float(np.mean(data.elevator[during]))
    return Reference(airspeed * float(np.cos(angle)), airspeed * float(np.sin(angle)), pitch, airspeed, elevator)
