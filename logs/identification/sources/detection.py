"""Detection of wing strokes and elevator inputs in logs without topics for them.

Averages over a stroke need its length, not its start: the phase of the fundamental of any periodic signal is enough,
a wing angle or the specific force. An input is a movement of the elevator from rest to rest: doublets,
3-2-1-1 and pulses. A stabilization loop moves the elevator all the time, so its commands are not inputs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, find_peaks, hilbert, sosfiltfilt, welch

from logs.identification.results import Array
from wingbeat.errors import InputError

MIN_FREQUENCY, MAX_FREQUENCY = 1.5, 30.0
"""Hz; of flapping"""
RESOLUTION = 0.25
"""Hz; of the spectrum"""
LINE = 30.0
"""-; of the median of the spectrum, above which a peak is a line"""
ROUNDING = 1e-9
"""1/Hz; of the mean square: rounding errors of a straight line"""
FUNDAMENTAL = 0.02
"""-; of the strongest line: least power of its fundamental"""
BAND = 0.35
"""-; of the flapping frequency, to either side: band of the fundamental"""
RATE_STROKES = 3.0
"""-; strokes over which their rate is averaged: a maneuver shakes the body too"""
REST_AMPLITUDE = 0.2
"""-; of the usual amplitude, below which the wings rest"""
QUICK = 0.1
"""s; in which the elevator moves by `MIN_STEP` at least"""
MIN_STEP = 0.02
"""rad; a smaller movement is trim"""
GAP = 0.5
"""s; steps closer together are one input"""
MAX_DURATION = 2.5
"""s; a longer movement is control or trim"""
REST = 0.4
"""s; least rest of the elevator before and after an input"""
MAX_REST = 1.0, 2.0
"""s; greatest rest that is used before and after it"""
REST_RANGE = 0.1
"""-; of the input's amplitude: range of the elevator at rest"""
MIN_STROKE_RATE = 0.75
"""-; of the usual stroke rate, below which it is no flapping flight"""


def strokes_in(time: Array, signal: Array) -> Array:
    """Strokes (N,) since the first sample, never decreasing, from a ``signal`` (N,) that flapping repeats.

    ``time`` (N,) in s, equally spaced.

    Raises:
        InputError: no periodic component in the range of flapping.
    """
    step = float(time[1] - time[0])
    frequency = flapping_frequency(step, signal)
    low, high = (1 - BAND) * frequency, min((1 + BAND) * frequency, 0.45 / step)
    shaking = hilbert(sosfiltfilt(butter(2, (low, high), "bandpass", fs=1 / step, output="sos"), signal))
    amplitude = np.abs(shaking)
    cycles = np.diff(np.unwrap(np.angle(shaking)), prepend=np.angle(shaking[0])) / (2 * np.pi)
    cycles[0] = 0.0
    flapping = amplitude > REST_AMPLITUDE * np.quantile(amplitude, 0.9)
    rate = uniform_filter1d(np.where(flapping, cycles, 0.0), round(RATE_STROKES / (frequency * step)), mode="nearest")
    strokes: Array = np.maximum.accumulate(np.cumsum(rate))
    return strokes


def flapping_frequency(step: float, signal: Array) -> float:
    """Hz; fundamental of a periodic ``signal`` (N,) sampled every ``step`` s.

    Raises:
        InputError: no periodic component in the range of flapping.
    """
    length = min(round(1 / (RESOLUTION * step)), len(signal))
    at, power = welch(signal, 1 / step, nperseg=length, detrend="linear")
    inside = (at >= MIN_FREQUENCY) & (at <= MAX_FREQUENCY)
    at, power = at[inside], power[inside]
    lines, _ = find_peaks(power) if len(power) else (np.zeros(0, int), {})
    rounding = ROUNDING * float(np.mean(np.square(signal)))
    lines = lines[power[lines] > LINE * np.median(power) + rounding] if len(lines) else lines
    if not len(lines):
        raise InputError("nothing in it repeats itself as wings do")
    strongest = lines[np.argmax(power[lines])]
    ratio = at[strongest] / at[lines]
    harmonic = (np.abs(ratio - np.round(ratio)) < RESOLUTION / at[lines]) & (ratio > 0.9)
    fundamental = harmonic & (power[lines] > FUNDAMENTAL * power[strongest])
    return float(at[lines][fundamental].min())


class Inputs(NamedTuple):
    """Detected inputs as in the excitation topic, every array (N,)."""

    active: Array
    """-; 1 from the rest before an input to that after it"""
    manoeuvre: Array
    """-; number of the input, from 1; 0 where there is none"""
    excitation: Array
    """rad; elevator minus its value at rest before"""


class _Span(NamedTuple):
    """Samples of one input."""

    start: int
    """first of the rest before"""
    first: int
    last: int
    """of the movement"""
    stop: int
    """after the rest that follows"""


def detect_inputs(time: Array, elevator: Array, strokes: Array) -> Inputs:
    """The inputs in the ``elevator`` command (rad) flown with flapping wings; ``time`` (s) equally spaced, all (N,).

    Raises:
        InputError: there is none.
    """
    step = float(time[1] - time[0])
    spans = [span for first, last in _movements(elevator, step) if (span := _at_rest(elevator, step, first, last))]
    rates = [float(strokes[span.stop - 1] - strokes[span.start]) / (span.stop - span.start) for span in spans]
    flapping = [span for span, rate in zip(spans, rates, strict=True) if rate > MIN_STROKE_RATE * max(rates)]
    active, number, excitation = (np.zeros(len(time)) for _ in range(3))
    for count, span in enumerate(flapping, 1):
        active[span.start : span.stop] = 1.0
        number[span.start : span.stop] = count
        moved = slice(span.first, span.last + 1)
        excitation[moved] = elevator[moved] - np.mean(elevator[span.start : span.first])
    if not flapping:
        raise InputError("its elevator nowhere moves quickly from rest to rest in flapping flight")
    return Inputs(active, number, excitation)


def _movements(elevator: Array, step: float) -> list[tuple[int, int]]:
    """First and last sample of each quick movement, with slower parts before and after."""
    lag = max(round(QUICK / step), 1)
    change = np.abs(elevator[lag:] - elevator[:-lag])
    quick = np.flatnonzero(change > MIN_STEP)
    if not len(quick):
        return []
    ends = np.flatnonzero(np.diff(quick) * step > GAP)
    firsts, lasts = quick[[0, *(ends + 1)]], quick[[*ends, -1]]
    return [(int(first), int(last) + lag) for first, last in zip(firsts, lasts, strict=True)]


def _at_rest(elevator: Array, step: float, first: int, last: int) -> _Span | None:
    """A movement with the rest before and after it; None if there is no rest, or it lasts too long."""
    least, before, after = (round(seconds / step) for seconds in (REST, *MAX_REST))
    if first < least or last + least >= len(elevator) or (last - first) * step > MAX_DURATION:
        return None
    base = float(np.median(elevator[first - least : first]))
    size = float(np.max(np.abs(elevator[first : last + 1] - base)))
    earlier = _rest_length(elevator[max(first - before, 0) : first][::-1], REST_RANGE * size)
    later = _rest_length(elevator[last + 1 : last + 1 + after], REST_RANGE * size)
    return _Span(first - earlier, first, last, last + 1 + later) if min(earlier, later) >= least else None


def _rest_length(elevator: Array, within: float) -> int:
    """How many samples, from the first on, lie within so much (rad) of each other."""
    spread = np.maximum.accumulate(elevator) - np.minimum.accumulate(elevator)
    return int(np.argmax(spread > within)) if np.any(spread > within) else len(elevator)
