"""Strokes of a wing from its angle, the stream and the force that was measured, ready for Malladi's Eq. 19.

A flat wing that flaps by ``flap`` about an axis along the body's x axis, in a stream of airspeed V at the angle of
attack alpha: a section at the distance y from that axis moves through the air by V cos(alpha) along the chord and by
y flap' - V sin(alpha) cos(flap) along the wing's normal. Lift and drag of both wings add up along the body's x axis
and, by cos(flap), along its z axis; what they do sideways cancels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.data.experiment import longest_run, runs
from logs.identification.data.smoothing import MIN_FOURIER, POWER, fourier_smoothing
from logs.identification.models.stroke_averaged import StrokeRecord, stroke_record
from logs.identification.results import Array
from logs.strokes import strokes_of, time_at
from wingbeat.errors import InputError

INSTANTS = 128
"""-; of a stroke, between samples of the same half along a line, force and pressures alike"""
LEAST_PER_STROKE = 8.0
"""-; samples of a stroke that a series can follow"""
PASSES = 2
"""-; of the smoother over the angle"""
HIGHEST = 0.499
"""-; of the sampling rate, to which the cut-off of an angle without noise is lowered"""
SURE = 2.0
"""-; standard errors of the flap rate within which nobody knows which half of the stroke a sample is of"""
ROUNDING = 1e-9
"""-; of the greatest flap rate, below which it is zero"""
SECTIONS = 8
"""-; of each straight piece of a planform; strips of equal width, 20 of them, were 0.03 % off in C_L"""


class Planform(NamedTuple):
    """One wing as sections: their sums are its integrals, by Gauss and Legendre."""

    distance: Array
    """m; (n,), of each section from the flapping axis"""
    area: Array
    """m^2; (n,)"""


class Flapped(NamedTuple):
    """What was measured of flapping wings, N equally spaced instants, NaN where nothing was."""

    time: Array
    """s; (N,)"""
    flap: Array
    """rad; (N,), of both wings, wing up positive"""
    airspeed: Array
    """m/s; (N,)"""
    alpha: Array
    """rad; (N,), of the body's x axis to the stream, nose up"""
    force: Array
    """N; (N, 2), of the air on the wings, forward along the body's x axis and up against its z axis"""
    density: float
    """kg/m^3"""
    wings: int = 2
    """-; that the force is of"""


class MeasuredStrokes(NamedTuple):
    """Whole strokes of one record."""

    begin: Array
    """s; (M,)"""
    end: Array
    """s; (M,)"""
    records: tuple[StrokeRecord, ...]
    forces: tuple[Array, ...]
    """(N, 2) N of each stroke; forward and up, body axes"""
    others: tuple[tuple[StrokeRecord, ...], ...] = ()
    """the records once more for every thing that the flap rate may have wrong in all strokes alike"""


def planform_of(outline: tuple[tuple[float, float], ...]) -> Planform:
    """Sections of a wing from its ``outline``: pairs of distance from the flapping axis and chord there, m, rising.

    Raises:
        InputError: fewer than two pairs, distances that do not rise from 0 on, a chord below zero, or no area.
    """
    table = np.asarray(outline, dtype=np.float64).reshape(-1, 2)
    if len(table) < 2 or np.any(np.diff(table[:, 0]) <= 0) or table[0, 0] < 0:
        raise InputError("a planform is two pairs or more of distance from the flapping axis (m, rising) and chord")
    if np.any(table[:, 1] < 0) or not np.any(table[:, 1] > 0):
        raise InputError("a planform's chords (m) are 0 or more, and one above 0")
    nodes, weights = np.polynomial.legendre.leggauss(SECTIONS)
    half = np.diff(table[:, 0])[:, None] / 2
    distance = (table[:-1, :1] + half * (1 + nodes)).ravel()
    return Planform(distance, np.interp(distance, table[:, 0], table[:, 1]) * (half * weights).ravel())


def strokes_by_angle(time: Array, flap: Array) -> tuple[Array, Array]:
    """Begins and ends (M,) in s of whole strokes: from one upward pass of the stroke's middle to the next.

    A gap in the angle ends a stroke that nobody knows the end of.
    """
    known = np.isfinite(flap)
    if known.sum() < 2:
        return np.zeros(0), np.zeros(0)
    middle = float(np.quantile(flap[known], 0.95) + np.quantile(flap[known], 0.05)) / 2
    reach = float(np.quantile(flap[known], 0.95) - np.quantile(flap[known], 0.05)) / 4
    cuts, low = [], False
    for at in range(1, len(flap)):
        if not (known[at] and known[at - 1]):
            cuts.append(np.nan)
            low = False
            continue
        low = low or flap[at - 1] < middle - reach
        if low and flap[at - 1] < middle <= flap[at]:
            share = (middle - flap[at - 1]) / (flap[at] - flap[at - 1])
            cuts.append(time[at - 1] + share * (time[at] - time[at - 1]))
            low = False
    begin, end = np.array(cuts[:-1]), np.array(cuts[1:])
    whole = np.isfinite(begin) & np.isfinite(end)
    return begin[whole], end[whole]


def strokes_by_count(time: Array, count: Array) -> tuple[Array, Array]:
    """Begins and ends (M,) in s of whole strokes by a ``count`` (N,) that rises by 1 in each."""
    known = np.isfinite(count)
    if known.sum() < 2:
        return np.zeros(0), np.zeros(0)
    strokes = strokes_of(2 * np.pi * count[known])
    cuts = time_at(time[known], strokes, np.arange(np.ceil(strokes[0]), np.floor(strokes[-1]) + 1))
    return cuts[:-1], cuts[1:]


class WingMotion(NamedTuple):
    """The wings' angle freed of noise."""

    flap: Array
    """rad; (N,), NaN where it was not measured or a piece of the record is too short"""
    rate: Array
    """rad/s; (N,)"""
    error: float
    """rad/s; standard error of the rate by the noise that was taken off"""
    bent: Array
    """rad/s; (N,), what another pass of the smoother would take off the rate"""


def wing_motion(flap: Array, step: float) -> WingMotion:
    """Angle and rate from ``flap`` (N,) in rad, ``step`` s apart: Fourier smoothing, run again on what it left.

    Pressures go with the square of the rate, and between neighbors an angle's noise is a rate of any size: 0.6 deg
    at 1000 Hz, 18 rad/s a sample. So the rate is that of the record's sine series up to where noise takes over
    (Morelli 1995). Its Wiener gain g takes a thousandth of the stroke with the noise; 1 - (1 - g)^2 of the second
    pass (Tukey's twicing, Exploratory Data Analysis, 1977, chapter 16) takes a millionth. Pieces between gaps share
    the longest one's cut-off.
    """
    smooth, rate, bent = (np.full(len(flap), np.nan) for _ in range(3))
    pieces = [run for run in runs(np.isfinite(flap)) if run.stop - run.start >= MIN_FOURIER]
    if not pieces:
        return WingMotion(smooth, rate, 0.0, bent)
    cut_off = min(fourier_smoothing(flap[longest_run(np.isfinite(flap))], step).cut_off, HIGHEST / step)
    errors = []
    for piece in pieces:
        left, count = flap[piece], piece.stop - piece.start
        values, slopes = np.zeros(count), np.zeros(count)
        for _ in range(PASSES):
            found = fourier_smoothing(left, step, cut_off).smoothed
            values, slopes, left = values + found.values, slopes + found.rates, left - found.values
        smooth[piece], rate[piece] = values, slopes
        bent[piece] = fourier_smoothing(left, step, cut_off).smoothed.rates
        errors.append(_rate_error(left, step, cut_off))
    return WingMotion(smooth, rate, float(np.sqrt(np.mean(np.square(errors)))), bent)


def _rate_error(left: Array, step: float, cut_off: float) -> float:
    """Standard error in rad/s of the series' slope, by what the passes ``left`` (N,) of the angle as white noise."""
    count = len(left)
    turning = np.pi * np.arange(1, count - 1) / (step * (count - 1))
    gain = 1 - (1 - 1 / (1 + (turning / (2 * np.pi * cut_off)) ** POWER)) ** PASSES
    noise = float(left @ left) / max(count - 2 - float(np.sum(gain)), 1.0)
    return float(np.sqrt(noise * np.sum((gain * turning) ** 2) / (count - 1)))


def measured_strokes(record: Flapped, wing: Planform, cuts: tuple[Array, Array]) -> MeasuredStrokes:
    """The strokes between ``cuts`` (begins and ends, s) of which every sample was measured.

    Raises:
        InputError: too few samples to a stroke.
    """
    columns = np.column_stack((record.flap, record.airspeed, record.alpha, record.force))
    step = float(record.time[-1] - record.time[0]) / (len(record.time) - 1)
    motion = wing_motion(record.flap, step)
    known = np.isfinite(columns).all(axis=1) & np.isfinite(motion.rate)
    versions = _pressures(record, motion, wing)
    strokes, spans = [], []
    for begin, end in zip(*cuts, strict=True):
        if (end - begin) / step < LEAST_PER_STROKE:
            raise InputError(
                f"a stroke has {(end - begin) / step:.1f} samples; {LEAST_PER_STROKE:g} are needed to follow it"
            )
        near = (record.time >= begin - 3 * step) & (record.time <= end + 3 * step)
        if np.all(known[near]):
            strokes.append(_stroke(record, motion, versions, near, (begin, end)))
            spans.append((begin, end))
    table = np.array(spans, dtype=np.float64).reshape(-1, 2)
    records = tuple(tuple(one[0][place] for one in strokes) for place in range(len(versions)))
    return MeasuredStrokes(table[:, 0], table[:, 1], records[0], tuple(one[1] for one in strokes), records[1:])


def _pressures(record: Flapped, motion: WingMotion, wing: Planform) -> tuple[Array, ...]:
    """(N, 4) N each; pressures of Eq. 19 at every sample, those of lift and of drag along the body's x and z axes.

    The first are those of the motion. The others are what they would be were its rate bent less, and what its noise
    adds to them on average, for they go with its square: what the coefficients have wrong by either.
    """
    central, less_bent, above, below = (
        _pressure(record, motion.flap, rate, wing)
        for rate in (motion.rate, motion.rate + motion.bent, motion.rate + motion.error, motion.rate - motion.error)
    )
    return central, less_bent, (above + below) / 2


def _pressure(record: Flapped, flap: Array, rate: Array, wing: Planform) -> Array:
    """(N, 4) N; pressures of Eq. 18 and 19 of both wings at this angle (rad) and rate (rad/s)."""
    shape = (len(flap), len(wing.distance))
    along = np.broadcast_to((record.airspeed * np.cos(record.alpha))[:, None], shape)
    normal = rate[:, None] * wing.distance - (record.airspeed * np.sin(record.alpha) * np.cos(flap))[:, None]
    plane = stroke_record(1.0, np.stack([along, normal], axis=2), wing.area, record.density, rate < 0.0)
    turned = record.wings * np.column_stack((np.ones(len(flap)), np.cos(flap)))
    return np.hstack((plane.lift_pressure * turned, plane.drag_pressure * turned))


def _stroke(
    record: Flapped,
    motion: WingMotion,
    versions: tuple[Array, ...],
    near: NDArray[np.bool_],
    span: tuple[float, float],
) -> tuple[tuple[StrokeRecord, ...], Array]:
    """Pressures of Eq. 19 along the body's x and z axes by every version of them, and the force, of one stroke.

    Both are known at the samples, and go from there to the instants along the same lines: what a line leaves of a
    curve, 3 % at ten samples to a stroke, is the same in both and in no coefficient.
    """
    time, period, rate = record.time[near], span[1] - span[0], motion.rate[near]
    at = span[0] + period * np.arange(INSTANTS) / INSTANTS
    down = np.interp(at, time, rate) < 0.0
    table = np.hstack([*(one[near] for one in versions), record.force[near]])
    told = _by_half(at, down, time, rate, max(SURE * motion.error, ROUNDING * float(np.max(np.abs(rate)))), table)
    starts = 4 * np.arange(len(versions))
    records = tuple(StrokeRecord(period, told[:, i : i + 2], told[:, i + 2 : i + 4], down) for i in starts)
    return records, told[:, -2:]


def _by_half(at: Array, down: NDArray[np.bool_], time: Array, rate: Array, unsure: float, table: Array) -> Array:
    """(M, k); ``table`` (N, k) at the instants ``at`` (s; M,), between samples of the same half of the stroke.

    A sample whose rate is below ``unsure`` rad/s is of neither: what the force does at a reversal is not shared out
    between two coefficients.
    """
    told = np.empty((len(at), table.shape[1]))
    for half in (False, True):
        own = ((rate < 0.0) == half) & (np.abs(rate) > unsure)
        if not own.any():
            return np.full(told.shape, np.nan)
        for column in range(table.shape[1]):
            told[down == half, column] = np.interp(at[down == half], time[own], table[own, column])
    return told
