"""Resampling, and finite Fourier transforms at chosen frequencies.

Linear between samples, without extrapolation. To a lower rate, after a linear-phase low-pass (Kaiser's window;
Kaiser, Proc. IEEE Int. Symposium on Circuits and Systems, 1974) with a pass band to 0.6 of the new Nyquist frequency
and -60 dB for what aliases into it. Half its length, about five new samples, is lost at both ends and at gaps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import CZT, firwin, kaiserord, lfilter, oaconvolve
from scipy.sparse import csr_array

from logs.identification.data.experiment import Experiment, runs
from logs.identification.results import Array
from logs.strokes import interval_mean, time_at
from wingbeat.errors import InputError

PASSED = 0.6
"""-; of the new Nyquist frequency"""
STOPPED_DB = 60.0
UNEVEN = 1e-3
"""-; of a step, by which samples of an even time base may differ"""
GAP_STEPS = 1.5
"""-; steps between adjacent samples, at most"""


class Channel(NamedTuple):
    """A signal as it was measured."""

    name: str
    unit: str
    time: Array
    """s; (N,), increasing"""
    values: Array
    """as the unit; (N,), NaN if not measured"""


def filled(values: Array, longest: int) -> Array:
    """``values`` (N,) with inner gaps of up to ``longest`` samples interpolated linearly."""
    out, places = values.copy(), np.arange(len(values))
    known = np.isfinite(values)
    for gap in runs(np.isnan(values)):
        if gap.start > 0 and gap.stop < len(values) and gap.stop - gap.start <= longest:
            out[gap] = np.interp(places[gap], places[known], values[known])
    return out


def interpolated(time: Array, values: Array, at: Array, longest: float = 0.0) -> Array:
    """``values`` (N,) at the times ``at`` (s; M,), linear between samples at increasing ``time`` (s; N,).

    NaN outside the record, and in gaps: between two measured samples further apart than ``longest`` s (for 0, than
    one and a half median steps).
    """
    good = np.isfinite(values)
    known, measured = time[good], values[good]
    if len(known) < 2:
        return np.full(len(at), np.nan)
    widest = max(longest, GAP_STEPS * float(np.median(np.diff(time))))
    out: Array = np.interp(at, known, measured, left=np.nan, right=np.nan)
    after = np.clip(np.searchsorted(known, at, side="left"), 1, len(known) - 1)
    apart = known[after] - known[after - 1] > widest
    met = (known[after] == at) | (known[after - 1] == at)
    out[apart & ~met] = np.nan
    return out


def even(channel: Channel, at: Array, longest_gap: float) -> Array:
    """The channel at the equally spaced times ``at`` (s; M,), low-passed before if they are sparser; NaN in gaps.

    Gaps up to ``longest_gap`` s are interpolated linearly.

    Raises:
        InputError: fewer than two samples, or time that does not increase.
    """
    if len(channel.time) < 2 or np.any(np.diff(channel.time) <= 0):
        raise InputError(f"{channel.name}: time must rise over two samples or more")
    old, new = float(np.median(np.diff(channel.time))), float(at[1] - at[0])
    if new < 1.2 * old:
        return interpolated(channel.time, channel.values, at, longest_gap)
    base = channel.time[0] + old * np.arange(int((channel.time[-1] - channel.time[0]) / old + 1e-6) + 1)
    dense = interpolated(channel.time, channel.values, base, longest_gap)
    return interpolated(base, _low_passed(dense, old / new), at)


def _low_passed(values: Array, ratio: float) -> Array:
    """``values`` (N,) low-passed for a rate lower by ``ratio``; NaN near gaps and ends."""
    width, beta = kaiserord(STOPPED_DB, 2 * (1 - PASSED) * ratio)
    taps = firwin(width + 1 - width % 2, ratio, window=("kaiser", beta))
    half = len(taps) // 2
    missing = ~np.isfinite(values)
    passed: Array = (
        oaconvolve(np.where(missing, 0.0, values), taps, mode="same") if len(values) > 1 else values.copy()
    )
    counted = np.concatenate(([0], np.cumsum(missing)))
    places = np.arange(len(values))
    first, last = np.clip(places - half, 0, None), np.clip(places + half + 1, None, len(values))
    passed[(counted[last] > counted[first]) | (places < half) | (places >= len(values) - half)] = np.nan
    return passed


def experiment_of(name: str, channels: Sequence[Channel], step: float, longest_gap: float) -> Experiment:
    """One even time base, ``step`` s apart, from the first sample of any channel to the last; NaN in gaps.

    Raises:
        InputError: no channel, a name twice, or a channel that cannot be resampled.
    """
    names = [channel.name for channel in channels]
    if not names or len(set(names)) < len(names):
        raise InputError(f"{name}: channels must be given, each name once")
    if not step > 0:
        raise InputError(f"{name}: a step of {step:g} s")
    begin, end = min(c.time[0] for c in channels), max(c.time[-1] for c in channels)
    time = begin + step * np.arange(int((end - begin) / step + 1e-6) + 1)
    if len(time) < 2:
        raise InputError(f"{name}: the record is shorter than one step of {step:g} s")
    signals = {channel.name: even(channel, time, longest_gap) for channel in channels}
    return Experiment(name, time, signals, {channel.name: channel.unit for channel in channels})


def down_sampled(experiment: Experiment, step: float) -> Experiment:
    """The experiment on a time base of ``step`` s, low-passed before.

    Raises:
        InputError: the step is shorter than the experiment's, or the record than two of them.
    """
    if step < experiment.step:
        raise InputError(
            f"{experiment.name}: a step of {step:g} s is shorter than the measured {experiment.step:g} s"
        )
    pairs = experiment.signals.items()
    channels = [Channel(name, experiment.units[name], experiment.time, values) for name, values in pairs]
    return experiment_of(experiment.name, channels, step, 0.0)


def bridged(experiment: Experiment, names: Sequence[str], longest: int) -> Experiment:
    """The experiment with gaps of up to ``longest`` samples in the signals ``names`` interpolated, as by `filled`."""
    return experiment._replace(
        signals=dict(experiment.signals) | {name: filled(experiment.signals[name], longest) for name in names}
    )


def measured_pieces(experiment: Experiment, names: Sequence[str], least: int) -> tuple[Experiment, ...]:
    """The pieces of the experiment, of ``least`` samples or more, in which every signal of ``names`` was measured.

    Several are named NAME, part 1, NAME, part 2, ...
    """
    known = np.ones(len(experiment.time), bool)
    for name in names:
        known &= np.isfinite(experiment.signals[name])
    pieces = [cut(experiment, run) for run in runs(known) if run.stop - run.start >= least]
    labels = [f", part {number + 1}" if len(pieces) > 1 else "" for number in range(len(pieces))]
    return tuple(one._replace(name=one.name + label) for one, label in zip(pieces, labels, strict=True))


def whole_records(
    experiment: Experiment, names: Sequence[str], longest_gap: float, least: float
) -> tuple[Experiment, ...]:
    """`measured_pieces` of ``least`` s or more, after interpolation of gaps up to ``longest_gap`` s in ``names``.

    Raises:
        InputError: a signal is missing, or no piece is left.
    """
    missing = [name for name in names if name not in experiment.signals]
    if missing:
        raise InputError(f"{experiment.name} has no signal {', '.join(missing)}")
    pieces: tuple[Experiment, ...] = ()
    if len(experiment.time) > 1:
        step = experiment.step
        joined = bridged(experiment, names, int(longest_gap / step + 1e-6))
        pieces = measured_pieces(joined, names, math.ceil(least / step - 1e-6) + 1)
    if not pieces:
        raise InputError(f"{experiment.name}: {', '.join(names)} are nowhere measured together for {least:g} s")
    return pieces


def cut(experiment: Experiment, span: slice) -> Experiment:
    """The samples ``span`` of the experiment."""
    signals = {name: values[span] for name, values in experiment.signals.items()}
    return experiment._replace(time=experiment.time[span], signals=signals)


SHORTEST_LAG = 1e-3
"""-; of a sampling interval: a shorter lag is zero"""


def behind(values: Array, step: float, delay: float, lag: float, *, zoh: bool) -> Array:
    """``values`` (N,), ``step`` s apart, after a ``delay`` (s) and a time constant ``lag`` (s).

    With ``zoh`` (zero-order hold) they are constant from each sample to the next, as commands are, else linear
    between samples; a delay of a fraction of a step is interpolated linearly. After a negative delay, a lead, the
    last value remains.
    """
    if not len(values):
        return values.copy()
    places = np.arange(len(values), dtype=np.float64)
    late: Array = np.interp(places - delay / step, places, values)
    if lag <= SHORTEST_LAG * step:
        return late
    pole = np.exp(-step / lag)
    old = 1.0 if zoh else (1.0 - pole) * lag / step
    followed: Array = lfilter([1.0 - old, old - pole], [1.0, -pole], late, zi=[old * late[0]])[0]
    return followed


def wing_period(time: Array, strokes: Array, at: Array) -> Array:
    """Measured wing period (s) around each time of ``at`` (M,); NaN within half a stroke of the record's ends."""
    now = np.interp(at, time, strokes)
    return time_at(time, strokes, now + 0.5) - time_at(time, strokes, now - 0.5)


def stroke_average(time: Array, values: Array, period: Array, at: Array) -> Array:
    """Moving average of ``values`` (N,) or (N, k) over one wing ``period`` (M,) around each time of ``at`` (M,)."""
    return interval_mean(time, values, at - period / 2, at + period / 2)


def averaging_matrix(time: Array, period: Array, at: Array) -> csr_array:
    """The moving average of `stroke_average` as a sparse matrix (M, N), for signals that come again and again.

    ``time`` (N,) is equally spaced, and every average lies inside it.
    """
    step = float(time[1] - time[0])
    start, stop = ((at + side * period / 2 - time[0]) / step for side in (-1, 1))
    reach = np.arange(int(np.max(stop - start)) + 3)
    columns = np.floor(start).astype(int)[:, None] + reach
    weights = _under_hat(stop[:, None] - columns) - _under_hat(start[:, None] - columns)
    rows = np.broadcast_to(np.arange(len(at))[:, None], columns.shape)
    inside = (weights > 0) & (columns < len(time))
    scaled = weights * step / period[:, None]
    return csr_array((scaled[inside], (rows[inside], columns[inside])), shape=(len(at), len(time)))


def _under_hat(position: Array) -> Array:
    """Area of the triangle of base 2 and height 1 about 0, up to ``position``: linear interpolation's weight."""
    clipped = np.clip(position, -1, 1)
    return np.where(clipped < 0, (1 + clipped) ** 2 / 2, 1 - (1 - clipped) ** 2 / 2)


EQUAL = 1e-9
"""-; largest difference between spacings of equally spaced frequencies, relative to the highest"""


def check_frequencies(frequencies: Array, step: float) -> Array:
    """``frequencies`` (F,) in Hz, sorted.

    Raises:
        InputError: none, or one that is not between 0 and half the sampling rate.
    """
    ordered = np.unique(np.asarray(frequencies, dtype=np.float64))
    half = 0.5 / step
    if not len(ordered) or not np.all(np.isfinite(ordered)) or ordered[0] <= 0 or ordered[-1] >= half:
        raise InputError(f"frequencies must lie between 0 and half the sampling rate, {half:g} Hz")
    return ordered


def transform(columns: Array, frequencies: Array, step: float) -> Array:
    """Finite Fourier transform (F, k) of ``columns`` (N, k) at ``frequencies`` (F,) in Hz; their unit times s.

    Sum over samples of x exp(-j 2 pi f t) dt, by the chirp z-transform if the frequencies are equally spaced.
    """
    count, spacing = len(columns), _spacing(frequencies)
    if spacing is None:
        kernel = np.exp(-2j * np.pi * np.outer(frequencies, np.arange(count) * step))
        return np.asarray(kernel @ columns * step)
    turn = 2j * np.pi * step
    chirp = CZT(count, len(frequencies), np.exp(-turn * spacing), np.exp(turn * frequencies[0]))
    return np.asarray(chirp(columns, axis=0) * step)


def in_band(columns: Array, frequencies: Array, step: float) -> Array:
    """Re(F^H F x) (N, k): the parts of ``columns`` (N, k) at ``frequencies`` (F,) in Hz, in the time domain.

    Scaled so that a signal inside the band is unchanged if the frequencies are one over the length apart.
    """
    count, spacing = len(columns), _spacing(frequencies)
    spectrum = transform(columns, frequencies, step)
    weight = 2.0 / (count * step)
    if spacing is None:
        kernel = np.exp(2j * np.pi * np.outer(np.arange(count) * step, frequencies))
        return np.asarray((kernel @ spectrum).real * weight)
    turn = 2j * np.pi * step
    chirp = CZT(len(frequencies), count, np.exp(turn * spacing))
    shift = np.exp(turn * frequencies[0] * np.arange(count))
    return np.asarray((chirp(spectrum, axis=0) * shift[:, None]).real * weight)


def _spacing(frequencies: Array) -> float | None:
    """Distance in Hz of equally spaced frequencies, None for others."""
    if len(frequencies) < 2:
        return None
    gaps = np.diff(frequencies)
    return float(gaps.mean()) if np.ptp(gaps) <= EQUAL * frequencies[-1] else None
